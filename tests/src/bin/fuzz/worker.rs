//! One campaign in a process of its own.

use hapfic_tests::fuzz::{Budget, Options, campaign, named};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// First argument of a worker.
pub const COMMAND: &str = "worker";
/// Memory a campaign may take beside what the program has at its start, bytes.
const MEMORY: u64 = 1 << 30;
/// The campaign could not be run.
const FAILED: u8 = 3;

/// What a worker tells at its end.
#[derive(Debug)]
pub struct Told {
    /// Executions.
    pub executions: u64,
    /// Of them accepted.
    pub accepted: u64,
    /// How long it took, s.
    pub seconds: f64,
    /// All findings.
    pub finding_count: u64,
    /// Different refusals.
    pub shapes: Vec<String>,
    /// Findings that differ: file and cause.
    pub findings: Vec<String>,
}

impl Told {
    /// From what a worker has written.
    pub fn read(value: &Value) -> Option<Self> {
        let list = |key: &str| -> Option<Vec<String>> {
            value.get(key)?.as_array()?.iter().map(|text| text.as_str().map(str::to_owned)).collect()
        };
        Some(Self {
            executions: value.get("executions")?.as_u64()?,
            accepted: value.get("accepted")?.as_u64()?,
            seconds: value.get("seconds")?.as_f64()?,
            finding_count: value.get("finding_count")?.as_u64()?,
            shapes: list("shapes")?,
            findings: list("findings")?,
        })
    }
}

/// The file in which a worker notes what it is about to execute.
pub fn notebook(scratch: &Path, job: usize) -> PathBuf {
    scratch.join(format!("{job}.input"))
}

/// Runs a campaign: target, seconds, seed, job, corpus, scratch, findings.
pub fn main(arguments: &[String]) -> ExitCode {
    match work(arguments) {
        Ok(told) => {
            let _ = writeln!(std::io::stdout(), "{told}");
            ExitCode::SUCCESS
        }
        Err(message) => {
            let _ = writeln!(std::io::stderr(), "{message}");
            ExitCode::from(FAILED)
        }
    }
}

fn work(arguments: &[String]) -> Result<Value, String> {
    let [target, seconds, seed, job, corpus, scratch, findings] = arguments else {
        return Err("worker: started by `fuzz` only".to_owned());
    };
    let number = |text: &String| text.parse::<u64>().map_err(|error| format!("worker: {text}: {error}"));
    let target = named(target).ok_or_else(|| format!("worker: no target {target}"))?;
    let job = usize::try_from(number(job)?).map_err(|error| error.to_string())?;
    let scratch = Path::new(scratch);
    let own = scratch.join(job.to_string());
    std::fs::create_dir(&own).map_err(|error| format!("worker: {}: {error}", own.display()))?;
    limit_memory();
    let options = Options {
        budget: Budget::Time(Duration::from_secs(number(seconds)?)),
        seed: number(seed)?,
        corpus: PathBuf::from(corpus),
        scratch: own,
        findings: PathBuf::from(findings),
        notebook: Some(notebook(scratch, job)),
    };
    let tally = campaign(target, &options).map_err(|error| format!("worker: {error}"))?;
    let findings: Vec<String> =
        tally.findings.iter().map(|finding| format!("{}: {}", finding.file.display(), finding.what)).collect();
    Ok(json!({
        "executions": tally.executions,
        "accepted": tally.accepted,
        "seconds": tally.elapsed.as_secs_f64(),
        "finding_count": tally.finding_count,
        "shapes": tally.shapes,
        "findings": findings,
    }))
}

/// From here on an execution that asks for too much memory aborts. Without a limit, if the system tells no size.
fn limit_memory() {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = status.lines().find_map(|line| line.strip_prefix("VmSize:")?.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    if let Some(kib) = kib {
        let limit = getrlimit(Resource::As);
        let _ = setrlimit(Resource::As, Rlimit { current: Some(kib * 1024 + MEMORY), ..limit });
    }
}
