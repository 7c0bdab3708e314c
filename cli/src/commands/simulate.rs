//! `hapfic simulate`: the whole stack in one process, for parameter studies.
//!
//! The laws are those of the processes, called in the order of lockstep (`simulation.rs`). So the metrics equal those
//! of `hapfic run --clock lockstep` to the last bit. There is no shared memory and no clock, and a log only on request.

mod text;

use crate::output::{OutputKind, check_output};
use crate::{CommandOutcome, log_line, print};
use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use hapfic_config::Settings;
use hapfic_plant::Plant;
use hapfic_simulation::recording::Recording;
use hapfic_simulation::study::{Done, End, study};
use hapfic_simulation::sweep::Grid;
use hapfic_simulation::{figures, pool};
use hapfic_supervisor::children::{external_command, started};
use serde_json::{Value, json};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Arguments of `hapfic simulate`.
#[derive(Args, Debug)]
pub struct SimulateArgs {
    /// Name of an embedded scenario, or path of a file.
    #[arg(default_value = "floor")]
    pub scenario: String,
    /// Simulated time of each run; replaces the scenario's [s].
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub duration: Option<f64>,
    /// Replace a value: `controller.taper=0.1`, `operator.2.desired_force=[0, 0, 80]`.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Run once with each value: `controller.taper=0.1,0.2` or `controller.taper=0.05:0.25:5`; several sweeps are
    /// combined.
    #[arg(long, value_name = "KEY=VALUES")]
    pub sweep: Vec<String>,
    /// Number of simulations in parallel; the number of cores if not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Write a log, as `hapfic run --clock lockstep` does; for a single run only.
    #[arg(long, value_name = "FILE", conflicts_with = "sweep")]
    pub log: Option<PathBuf>,
    /// Write all metrics as a table: a line for each run once it and all earlier ones have ended.
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Replace output files of another kind.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON object at the end instead of text.
    #[arg(long)]
    pub json: bool,
}

/// Checks all runs, then simulates them.
///
/// A run of a sweep that fails is a result; a single run that fails is a failure of the command.
pub fn simulate(args: &SimulateArgs) -> Result<CommandOutcome> {
    match CheckedStudy::new(args) {
        Ok(prepared) => prepared.run(args),
        Err(e) => Ok(CommandOutcome::Rejected(e)),
    }
}

/// Checked arguments, with all that invalid ones could make fail.
struct CheckedStudy {
    grid: Grid,
    /// Settings of each run.
    settings: Vec<Settings>,
    jobs: usize,
    /// Number of usable cores that the jobs keep busy.
    cores: usize,
    csv: Option<CsvFile>,
    recording: Option<Recording>,
    stop: Arc<AtomicBool>,
}

impl CheckedStudy {
    fn new(args: &SimulateArgs) -> Result<Self> {
        let grid = Grid::read(&args.sweep)?;
        let mut fixed = args.set.clone();
        if let Some(duration) = args.duration {
            fixed.push(format!("duration_s={duration:?}"));
        }
        let settings: Vec<_> =
            (0..grid.len()).map(|run| load(&args.scenario, &fixed, &grid.overrides(run))).collect::<Result<_>>()?;
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let jobs = args.jobs.map_or(cores, usize::from).min(settings.len());
        ensure!(
            args.log.is_none() || args.log != args.csv,
            "--csv {}: found the log's file, expected another one",
            args.csv.as_deref().unwrap_or(Path::new("")).display()
        );
        let input = [Path::new(&args.scenario)];
        for (option, path, kind) in [("--log", &args.log, OutputKind::Log), ("--csv", &args.csv, OutputKind::Csv("simulated_s"))]
        {
            if let Some(path) = path {
                check_output(option, path, kind, &input, args.force)?;
            }
        }
        let csv = args.csv.as_deref().map(CsvFile::open).transpose()?;
        let recording = match (&args.log, settings.first()) {
            (Some(log), Some(settings)) => match Recording::create(&args.scenario, settings, log) {
                Ok(recording) => Some(recording),
                Err(e) => {
                    csv.into_iter().for_each(CsvFile::discard);
                    return Err(e);
                }
            },
            _ => None,
        };
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            // The second signal ends the program immediately.
            signal_hook::flag::register_conditional_shutdown(signal, 3, Arc::clone(&stop)).context("cannot handle signals")?;
            signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot handle signals")?;
        }
        Ok(Self { grid, settings, jobs, cores: jobs.min(cores), csv, recording, stop })
    }

    fn run(self, args: &SimulateArgs) -> Result<CommandOutcome> {
        if let Some(csv) = &self.csv {
            csv.begin(&figures::csv_head(self.grid.sweeps().iter().map(|sweep| sweep.key.as_str())))?;
        }
        let begun = Instant::now();
        if self.grid.sweeps().is_empty() { self.one(args, begun) } else { self.all(args, begun) }
    }

    /// Simulates a single run.
    fn one(self, args: &SimulateArgs, begun: Instant) -> Result<CommandOutcome> {
        let Self { settings, csv, mut recording, stop, .. } = self;
        let [settings] = settings.as_slice() else { bail!("found {} runs, expected one", settings.len()) };
        let done = study(settings, &stop, recording.as_mut())?;
        let logged = recording.map(Recording::finish).transpose()?;
        let wall_s = begun.elapsed().as_secs_f64();
        if let Some(csv) = &csv {
            csv.append(&figures::csv_line(&[], &done))?;
        }
        if args.json {
            let run = figures::object(std::iter::empty(), &done);
            print_json(args, vec![run], &StudyTotals { simulated_s: done.simulated_s(), wall_s, jobs: 1, cores: 1, runs: 1 })?;
        } else {
            print(text::single(&args.scenario, &done).trim_end());
            if let (Some(log), Some(totals)) = (&args.log, logged) {
                let messages: u64 = hapfic_log::Topic::ALL.iter().map(|topic| totals.messages(*topic)).sum();
                let megabytes = totals.file_bytes as f64 / 1e6;
                print(&format!("  {:<18} {messages} messages, {megabytes:.1} MB: {}", "log", log.display()));
            }
            print(&text::speed(1, done.simulated_s(), wall_s, [1; 2]));
        }
        Ok(if done.end == End::Completed { CommandOutcome::Done } else { CommandOutcome::Failed })
    }

    /// Simulates all runs of a sweep.
    fn all(self, args: &SimulateArgs, begun: Instant) -> Result<CommandOutcome> {
        let Self { grid, settings, jobs, cores, csv, stop, .. } = self;
        let table = text::SweepTable::new(&grid);
        if !args.json {
            print(&table.head(&grid));
        }
        let (mut simulated_s, mut failed, mut objects) = (0.0, 0, Vec::new());
        let work = |run: usize| match study(&settings[run], &stop, None) {
            Ok(Done { end: End::Stopped, .. }) => None,
            other => Some(other),
        };
        let give = |run: usize, done: Result<Done, _>| {
            let (values, done) = (grid.values(run), done?);
            simulated_s += done.simulated_s();
            failed += usize::from(done.end != End::Completed);
            if let Some(csv) = &csv {
                csv.append(&figures::csv_line(&values, &done))?;
            }
            if args.json {
                let keys = grid.sweeps().iter().map(|sweep| sweep.key.as_str());
                objects.push(figures::object(keys.zip(values), &done));
            } else {
                print(&table.row(&values, &done));
            }
            Ok(())
        };
        let given = pool::in_order(settings.len(), jobs, &stop, work, give)?;
        let wall_s = begun.elapsed().as_secs_f64();
        if args.json {
            print_json(args, objects, &StudyTotals { simulated_s, wall_s, jobs, cores, runs: settings.len() })?;
        } else {
            print(&text::speed(given, simulated_s, wall_s, [jobs, cores]));
        }
        if failed > 0 {
            log_line(&format!("hapfic: {failed} of {given} runs did not complete; the table lists the causes"));
        }
        if given < settings.len() {
            log_line(&format!("hapfic: interrupted after {given} of {} runs", settings.len()));
            return Ok(CommandOutcome::Failed);
        }
        Ok(CommandOutcome::Done)
    }
}

/// Loads and checks the settings of a run.
fn load(scenario: &str, fixed: &[String], swept: &[String]) -> Result<Settings> {
    let overrides: Vec<String> = fixed.iter().chain(swept).cloned().collect();
    let settings = Settings::load(scenario, &overrides)?;
    let what = || format!("{scenario} {}", swept.join(" ")).trim_end().to_owned();
    Plant::new(&settings).with_context(what)?;
    ensure!(
        settings.faults.is_empty(),
        "{}: fault: found {} of them, expected none: there are no processes that could fail. Hint: use `hapfic run --clock \
         lockstep`, or --set 'fault=[]'",
        what(),
        settings.faults.len()
    );
    if let Some(process) = started(&settings).iter().find(|process| external_command(&settings.processes, **process).is_some()) {
        bail!(
            "{}: processes: found an external process for the {process}, expected none: there are no processes. Hint: use \
             `hapfic run --clock lockstep`",
            what()
        );
    }
    Ok(settings)
}

/// File of the table. Opened with the checks, so that an unwritable path costs no run; emptied at the first run.
struct CsvFile {
    file: File,
    path: PathBuf,
    existed: bool,
}

impl CsvFile {
    fn open(path: &Path) -> Result<Self> {
        let existed = path.exists();
        let file =
            File::options().write(true).create(true).truncate(false).open(path).with_context(|| {
                format!("--csv {}: cannot be written, expected a path in a folder that exists", path.display())
            })?;
        Ok(Self { file, path: path.to_owned(), existed })
    }

    fn begin(&self, head: &str) -> Result<()> {
        // Fails on a device or a pipe, which has no length.
        let _ = self.file.set_len(0);
        self.append(head)
    }

    /// Appends a line in one write.
    fn append(&self, line: &str) -> Result<()> {
        (&self.file).write_all(line.as_bytes()).with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Removes the file if it is new: no run was started.
    fn discard(self) {
        if !self.existed {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Totals of a study.
struct StudyTotals {
    simulated_s: f64,
    wall_s: f64,
    jobs: usize,
    cores: usize,
    /// Number of requested runs.
    runs: usize,
}

fn print_json(args: &SimulateArgs, runs: Vec<Value>, totals: &StudyTotals) -> Result<()> {
    let speed = text::rate(totals.simulated_s, totals.wall_s);
    let object = json!({
        "scenario": args.scenario,
        "asked_runs": totals.runs,
        "jobs": totals.jobs,
        "simulated_s": totals.simulated_s,
        "wall_s": totals.wall_s,
        "speed": speed,
        "speed_per_core": speed / totals.cores as f64,
        "log": args.log,
        "runs": runs,
    });
    print(&serde_json::to_string_pretty(&object)?);
    Ok(())
}
