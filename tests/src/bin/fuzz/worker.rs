//! Worker: the process of one campaign.

use hapfic_tests::fuzz::{CampaignBudget, CampaignOptions, campaign, target_named};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// First argument of a worker process.
pub const COMMAND: &str = "worker";
/// Memory of a campaign beside that of the program at its start [bytes].
const MEMORY: u64 = 1 << 30;
/// Exit code for a campaign that could not run.
const FAILED: u8 = 3;

/// Result of a worker, printed as JSON at its end.
#[derive(Debug)]
pub struct WorkerResult {
    /// Number of executions.
    pub executions: u64,
    /// Executions with an accepted input.
    pub accepted: u64,
    /// Duration [s].
    pub seconds: f64,
    /// Number of findings, repeated kinds included.
    pub finding_count: u64,
    /// Shapes of the rejections.
    pub shapes: Vec<String>,
    /// Findings, one of each kind: file and cause.
    pub findings: Vec<String>,
}

impl WorkerResult {
    /// Reads the output of a worker.
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

/// File with the current input of a worker.
pub fn input_file(scratch: &Path, job: usize) -> PathBuf {
    scratch.join(format!("{job}.input"))
}

/// Runs a campaign. Arguments: target, seconds, seed, job, corpus, scratch, findings.
pub fn main(arguments: &[String]) -> ExitCode {
    match work(arguments) {
        Ok(result) => {
            let _ = writeln!(std::io::stdout(), "{result}");
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
        return Err("worker: found other arguments, expected seven; only `fuzz` starts a worker".to_owned());
    };
    let number = |text: &String| text.parse::<u64>().map_err(|error| format!("worker: {text}: {error}"));
    let target = target_named(target).ok_or_else(|| format!("worker: found no target {target}"))?;
    let job = usize::try_from(number(job)?).map_err(|error| error.to_string())?;
    let scratch = Path::new(scratch);
    let own = scratch.join(job.to_string());
    std::fs::create_dir(&own).map_err(|error| format!("worker: {}: {error}", own.display()))?;
    limit_memory();
    let options = CampaignOptions {
        budget: CampaignBudget::Time(Duration::from_secs(number(seconds)?)),
        seed: number(seed)?,
        corpus: PathBuf::from(corpus),
        scratch: own,
        findings: PathBuf::from(findings),
        input_file: Some(input_file(scratch, job)),
    };
    let result = campaign(target, &options).map_err(|error| format!("worker: {error}"))?;
    let findings: Vec<String> =
        result.findings.iter().map(|finding| format!("{}: {}", finding.file.display(), finding.what)).collect();
    Ok(json!({
        "executions": result.executions,
        "accepted": result.accepted,
        "seconds": result.elapsed.as_secs_f64(),
        "finding_count": result.finding_count,
        "shapes": result.shapes,
        "findings": findings,
    }))
}

/// Limits the memory, so an execution that allocates too much aborts. Sets no limit if the system reports no size.
fn limit_memory() {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = status.lines().find_map(|line| line.strip_prefix("VmSize:")?.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    if let Some(kib) = kib {
        let limit = getrlimit(Resource::As);
        let _ = setrlimit(Resource::As, Rlimit { current: Some(kib * 1024 + MEMORY), ..limit });
    }
}
