//! `fuzz TARGET|all --seconds N`: executes decoders with mutated inputs. Ends with 1 if a decoder panics, hangs, or
//! takes too much memory.
//!
//! Each campaign is a process of its own with a limit of 1 GiB, so an abort ends that campaign alone. The tool saves
//! the input of each finding in `fuzz-findings/TARGET-HASH`. Once its cause is fixed, the file belongs into
//! `tests/corpus/TARGET/`, since the tests execute that corpus. `--seconds 0` executes a corpus and nothing else.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "fuzz/arguments.rs"]
mod arguments;
#[path = "fuzz/worker.rs"]
mod worker;

use arguments::Arguments;
use hapfic_tests::fuzz::{FuzzTarget, save};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};

/// Folder for inputs with a finding.
const FINDINGS: &str = "fuzz-findings";
/// Exit code for an invalid command line.
const BAD_INPUT: u8 = 2;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.first().is_some_and(|first| first == worker::COMMAND) {
        return worker::main(&arguments[1..]);
    }
    match Arguments::read(&arguments) {
        Ok(arguments) => match run(&arguments) {
            Ok(0) => ExitCode::SUCCESS,
            Ok(_) => ExitCode::FAILURE,
            Err(error) => {
                print_error(&format!("fuzz: {error}"));
                ExitCode::FAILURE
            }
        },
        Err(message) => {
            print_error(&message);
            ExitCode::from(BAD_INPUT)
        }
    }
}

/// Runs all campaigns and prints their results. Returns the number of findings.
fn run(arguments: &Arguments) -> std::io::Result<u64> {
    print(&format!("{:<9} {:>10} {:>9} {:>9} {:>7} {:>9}", "target", "executions", "per s", "accepted", "shapes", "findings"));
    let mut total = 0;
    for target in &arguments.targets {
        let scratch = tempfile::Builder::new().prefix("fuzz-").tempdir_in(fast_folder())?;
        let workers: Vec<Child> =
            (0..arguments.jobs).map(|job| start(target, arguments, job, scratch.path())).collect::<std::io::Result<_>>()?;
        let (mut executions, mut accepted, mut findings, mut rate) = (0, 0, 0, 0.0);
        let (mut shapes, mut reports) = (BTreeSet::new(), BTreeSet::new());
        for (job, worker) in workers.into_iter().enumerate() {
            let output = worker.wait_with_output()?;
            let result: Option<worker::WorkerResult> = serde_json::from_slice::<serde_json::Value>(&output.stdout)
                .ok()
                .and_then(|value| worker::WorkerResult::read(&value));
            if let Some(result) = result {
                executions += result.executions;
                accepted += result.accepted;
                findings += result.finding_count;
                rate += result.executions as f64 / result.seconds.max(1e-3);
                shapes.extend(result.shapes);
                reports.extend(result.findings);
            } else {
                findings += 1;
                let input = std::fs::read(worker::input_file(scratch.path(), job)).unwrap_or_default();
                let file = save(Path::new(FINDINGS), target.name, &input)?;
                let cause = String::from_utf8_lossy(&output.stderr).trim().to_owned();
                reports.insert(format!("{}: {} ({cause})", file.display(), output.status));
            }
        }
        let name = target.name;
        print(&format!("{name:<9} {executions:>10} {rate:>9.0} {accepted:>9} {:>7} {findings:>9}", shapes.len()));
        reports.iter().for_each(|finding| print(&format!("  {finding}")));
        total += findings;
    }
    Ok(total)
}

/// Starts the process of a campaign.
fn start(target: &FuzzTarget, arguments: &Arguments, job: usize, scratch: &Path) -> std::io::Result<Child> {
    Command::new(std::env::current_exe()?)
        .args([worker::COMMAND, target.name])
        .args([arguments.seconds.to_string(), arguments.seed.wrapping_add(job as u64).to_string(), job.to_string()])
        .args([arguments.corpus.as_path(), scratch, Path::new(FINDINGS)])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
}

/// Folder in memory, if there is one: a recovery waits for the disk.
fn fast_folder() -> std::path::PathBuf {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() }
}

/// Prints a line to standard output. A closed pipe is no failure.
fn print(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
}

/// Prints a line to standard error.
fn print_error(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}
