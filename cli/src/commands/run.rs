//! `hapfic run`: runs a scenario and prints its summary.

use crate::output::{OutputKind, check_output};
use crate::{CommandOutcome, print};
use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use hapfic_config::Settings;
use hapfic_messages::{Clock, RealtimeMode};
use hapfic_supervisor::RunRequest;
use hapfic_supervisor::launch::{self, InvalidRequest};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Arguments of `hapfic run`.
#[derive(Args, Debug)]
pub struct RunArgs {
    /// Name of an embedded scenario, or path of a file.
    #[arg(default_value = "floor")]
    pub scenario: String,
    /// Clock of the run.
    #[arg(long, value_enum, default_value_t = ClockName::Realtime)]
    pub clock: ClockName,
    /// Simulated time; replaces the scenario's [s].
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub duration: Option<f64>,
    /// Seed; replaces the scenario's.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Path of the log; a file in `logs/` if not given.
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
    /// Replace a value: `controller.taper=0.1`, `operator.2.desired_force=[0, 0, 80]`.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Also write the summary as JSON.
    #[arg(long, value_name = "FILE")]
    pub summary_json: Option<PathBuf>,
    /// Replace output files of another kind.
    #[arg(long)]
    pub force: bool,
    /// Real-time privileges: take the available ones, require all, or request none.
    #[arg(long, value_enum, default_value_t = RealtimeName::Auto)]
    pub realtime: RealtimeName,
}

impl Default for RunArgs {
    fn default() -> Self {
        Self {
            scenario: "floor".to_owned(),
            clock: ClockName::Realtime,
            duration: None,
            seed: None,
            log: None,
            set: Vec::new(),
            summary_json: None,
            force: false,
            realtime: RealtimeName::Auto,
        }
    }
}

/// Clock of a run.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ClockName {
    /// An absolute timer of 1 kHz.
    Realtime,
    /// As fast as possible; the same bytes every time.
    Lockstep,
}

impl From<ClockName> for Clock {
    fn from(name: ClockName) -> Self {
        match name {
            ClockName::Realtime => Self::Realtime,
            ClockName::Lockstep => Self::Lockstep,
        }
    }
}

/// Use of real-time privileges.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum RealtimeName {
    /// Take the available ones, and list the missing ones.
    Auto,
    /// Do not start without all of them.
    Require,
    /// Request none.
    Off,
}

impl From<RealtimeName> for RealtimeMode {
    fn from(name: RealtimeName) -> Self {
        match name {
            RealtimeName::Auto => Self::Auto,
            RealtimeName::Require => Self::Require,
            RealtimeName::Off => Self::Off,
        }
    }
}

/// Runs a scenario and prints its summary.
pub fn run(args: &RunArgs, since: Instant) -> Result<CommandOutcome> {
    let mut overrides = args.set.clone();
    if let Some(duration) = args.duration {
        overrides.push(format!("duration_s={duration:?}"));
    }
    if let Some(seed) = args.seed {
        overrides.push(format!("seed={seed}"));
    }
    let settings = match Settings::load(&args.scenario, &overrides) {
        Ok(settings) => settings,
        Err(e) => return Ok(CommandOutcome::Rejected(e.into())),
    };
    let input = [Path::new(&args.scenario)];
    for (option, path, kind) in
        [("--log", &args.log, OutputKind::Log), ("--summary-json", &args.summary_json, OutputKind::Json("launch_s"))]
    {
        if let Some(path) = path
            && let Err(e) = check_output(option, path, kind, &input, args.force)
        {
            return Ok(CommandOutcome::Rejected(e));
        }
    }
    if args.log.is_some() && args.log == args.summary_json {
        return Ok(CommandOutcome::Rejected(anyhow::anyhow!("--summary-json: found the path of the log, expected another file")));
    }
    let summary_file = match args.summary_json.as_deref().map(SummaryFile::open).transpose() {
        Ok(file) => file,
        Err(e) => return Ok(CommandOutcome::Rejected(e)),
    };
    let request = RunRequest {
        scenario: args.scenario.clone(),
        settings,
        clock: args.clock.into(),
        realtime: args.realtime.into(),
        log: args.log.clone().unwrap_or_else(|| default_log(&args.scenario)),
        since,
    };
    let result = match launch::run(&request)? {
        Ok(result) => result,
        Err(InvalidRequest(e)) => {
            if let Some(file) = summary_file {
                file.discard();
            }
            return Ok(CommandOutcome::Rejected(e));
        }
    };
    let Some(result) = result else {
        if let Some(file) = summary_file {
            // Not the summary of an earlier run.
            file.write(&serde_json::to_string_pretty(&serde_json::json!({ "completed": false, "log": request.log }))?)?;
        }
        return Ok(CommandOutcome::Failed);
    };
    print(result.text.trim_end());
    if let Some(file) = summary_file {
        file.write(&result.json)?;
    }
    Ok(if result.completed { CommandOutcome::Done } else { CommandOutcome::Failed })
}

/// File of the JSON summary. Opened before the run, so that an unwritable path costs no run; emptied only after it.
struct SummaryFile {
    file: std::fs::File,
    path: PathBuf,
    existed: bool,
}

impl SummaryFile {
    fn open(path: &Path) -> Result<Self> {
        let existed = path.exists();
        let file = std::fs::File::options().write(true).create(true).truncate(false).open(path).with_context(|| {
            format!("--summary-json {}: cannot be written, expected a path in a folder that exists", path.display())
        })?;
        Ok(Self { file, path: path.to_owned(), existed })
    }

    fn write(&self, text: &str) -> Result<()> {
        // Fails on a device or a pipe, which has no length.
        let _ = self.file.set_len(0);
        (&self.file).write_all(text.as_bytes()).with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Removes the file if it is new: the run was rejected.
    fn discard(self) {
        if !self.existed {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Default path of the log, relative to the working directory: `logs/floor-20260131-154502-123456-1234.mcap` with the
/// microsecond and the process id. Runs in containers may share the folder, the second and the process id.
fn default_log(scenario: &str) -> PathBuf {
    let stem = Path::new(scenario).file_stem().and_then(|s| s.to_str()).unwrap_or("run");
    let now_ns = hapfic_ipc::clock::unix_ns();
    let (seconds, micros) = (now_ns / 1_000_000_000, now_ns / 1000 % 1_000_000);
    let (year, month, day) = hapfic_ipc::clock::date(seconds / 86_400);
    let (h, m, s) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    PathBuf::from(format!("logs/{stem}-{year:04}{month:02}{day:02}-{h:02}{m:02}{s:02}-{micros:06}-{}.mcap", std::process::id()))
}
