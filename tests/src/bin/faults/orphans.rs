//! Kills of launcher and supervisor at random times, and their remains.

use crate::part::{DocumentPart, Expectation, digits, largest, median, table, verdict};
use crate::runs::{LOG, RunFolder};
use crate::trace::Trace;
use hapfic_tests::remains_of;
use std::time::{Duration, Instant};

/// Number of kills, and of kills during the start: full and quick.
const KILLS: [(usize, usize); 2] = [(100, 40), (20, 8)];
/// Duration of the start [ms].
const START_MS: f64 = 150.0;
/// Latest kill, from the start of the program [ms].
const LATEST_MS: f64 = 3000.0;
/// Seed of the kill times.
const SEED: u64 = 11;
/// Longest time from the kill to the end of the last process [ms]: the grace time of 2 s, the end of the run by the gates, and
/// what a busy machine takes.
const ALL_ENDED_MS: f64 = 8000.0;
/// Largest gap at the end of a log [s].
const MISSING_S: f64 = 0.1;
/// Time-out of the wait for the end of all processes.
const TIMEOUT: Duration = Duration::from_secs(30);
/// Shortest time without a process that counts as the end: another process may be starting.
const QUIET: Duration = Duration::from_millis(100);
/// Time limit of the next run, or of a recovery.
const LIMIT: Duration = Duration::from_secs(60);
/// Recovered log.
const RECOVERED: &str = "recovered.mcap";

/// State of the log after a recovery.
enum RecoveredLog {
    /// No log, or an empty one.
    None,
    /// No command: killed before the first tick.
    NoTick,
    /// Gap at its end [s].
    Missing(f64),
    /// Failed recovery, or gaps before the end, with the cause.
    Lost(String),
}

/// Result of a kill of launcher and supervisor.
struct OrphanResult {
    /// Time from the kill to the end of the last process [ms].
    ended_ms: f64,
    /// Remains after the next run.
    remains: Vec<String>,
    /// Error of the next run.
    next: Option<String>,
    log: RecoveredLog,
}

/// Makes the part.
pub(crate) fn make(quick: bool) -> DocumentPart {
    let (kills, early) = KILLS[usize::from(quick)];
    let mut random = fastrand::Rng::with_seed(SEED);
    let folder = RunFolder::new();
    let mut all = Vec::new();
    for kill in 0..kills {
        let (from, to) = if kill < early { (0.0, START_MS) } else { (START_MS, LATEST_MS) };
        let delay_ms = from + random.f64() * (to - from);
        eprintln!("kill {} of {kills}: {delay_ms:.0} ms after the start", kill + 1);
        all.push((kill < early, measure_kill(&folder, Duration::from_secs_f64(delay_ms * 1e-3))));
    }
    let groups = [("during the start", true), ("later", false)];
    let rows: Vec<_> = groups
        .into_iter()
        .map(|(name, early)| row(name, &all.iter().filter(|kill| kill.0 == early).map(|kill| &kill.1).collect::<Vec<_>>()))
        .collect();
    let expectations = expect(&all.iter().map(|kill| &kill.1).collect::<Vec<_>>());
    let head = [
        "killed",
        "kills",
        "until the last process ended, ms: median",
        "max",
        "next start works and cleans up",
        "no log yet",
        "log without a tick",
        "log recovered",
        "missing at its end, s: median",
        "max",
    ];
    DocumentPart { tables: vec![("supervisor", format!("{}\n{}", verdict(&expectations), table(&head, &rows)))], expectations }
}

fn measure_kill(folder: &RunFolder, delay: Duration) -> OrphanResult {
    for written in [LOG, RECOVERED] {
        let _ = std::fs::remove_file(folder.path(written));
    }
    let begun = Instant::now();
    let run = folder.start(&["run", "floor", "--duration", "60", "--log", LOG]);
    let pid = run.pid();
    std::thread::sleep(delay.saturating_sub(begun.elapsed()));
    let killed_ns = run.kill_with_supervisor();
    let ended_ms = until_ended(pid, killed_ns);
    let end = folder.run(&["run", "floor", "--duration", "0.3", "--log", "next.mcap"], LIMIT);
    let next =
        (end.code != Some(0)).then(|| format!("exit code {:?}: {}", end.code, end.err.lines().next_back().unwrap_or_default()));
    let mut remains = remains_of(pid);
    if folder.registrations() > 0 {
        remains.push(format!("{} registrations", folder.registrations()));
    }
    OrphanResult { ended_ms, remains, next, log: recovered(folder, killed_ns) }
}

/// Waits until all processes of the run have ended. Returns the time from the kill until then [ms].
fn until_ended(pid: u32, killed_ns: u64) -> f64 {
    let begun = Instant::now();
    let mut ended_ns = None;
    loop {
        let now_ns = hapfic_ipc::clock::now_ns();
        if remains_of(pid).iter().any(|name| name.starts_with("process")) {
            ended_ns = None;
        } else {
            ended_ns = ended_ns.or(Some(now_ns));
        }
        let quiet = ended_ns.is_some_and(|ended| now_ns - ended > QUIET.as_nanos() as u64);
        if quiet || begun.elapsed() > TIMEOUT {
            let ended_ns = ended_ns.unwrap_or(now_ns);
            return ended_ns.saturating_sub(killed_ns) as f64 * 1e-6;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Recovers the log and compares its end with the time of the kill.
fn recovered(folder: &RunFolder, killed_ns: u64) -> RecoveredLog {
    if std::fs::metadata(folder.path(LOG)).map_or(0, |file| file.len()) == 0 {
        return RecoveredLog::None;
    }
    let end = folder.run(&["recover", LOG, "--output", RECOVERED], LIMIT);
    if end.code == Some(2) && end.err.contains("nothing to recover") {
        return RecoveredLog::None;
    }
    if end.code != Some(0) {
        return RecoveredLog::Lost(format!("exit code {:?}: {}", end.code, end.err.lines().next_back().unwrap_or_default()));
    }
    // `recover` does not copy a whole log.
    let copy = folder.path(RECOVERED);
    let trace = Trace::read(&if copy.exists() { copy } else { folder.path(LOG) });
    if let Some(error) = trace.error {
        return RecoveredLog::Lost(error);
    }
    let Some(last) = trace.last() else { return RecoveredLog::NoTick };
    let missing = (0..=last).filter(|tick| trace.command(*tick).is_none()).count();
    if missing > 0 {
        return RecoveredLog::Lost(format!("{missing} commands missing before tick {last}"));
    }
    // The timing of a tick follows its command. If it is missing, the time of an earlier command counts, plus a period
    // a tick.
    let stamped = (0..=last).rev().find_map(|tick| Some((tick, trace.ticks[tick].command_ns?)));
    match stamped {
        Some((tick, stamp)) => {
            let stamp_s = stamp as f64 * 1e-9 + (last - tick) as f64 * 1e-3;
            RecoveredLog::Missing((killed_ns as f64 * 1e-9 - stamp_s).max(0.0))
        }
        None => RecoveredLog::Lost("found no command with a time".to_owned()),
    }
}

fn missing(kills: &[&OrphanResult]) -> Vec<f64> {
    let seconds = |kill: &&OrphanResult| if let RecoveredLog::Missing(seconds) = kill.log { Some(seconds) } else { None };
    kills.iter().filter_map(seconds).collect()
}

fn row(name: &str, kills: &[&OrphanResult]) -> Vec<String> {
    let ended: Vec<f64> = kills.iter().map(|kill| kill.ended_ms).collect();
    let count = |which: &dyn Fn(&OrphanResult) -> bool| kills.iter().filter(|kill| which(kill)).count().to_string();
    let missing = missing(kills);
    vec![
        name.to_owned(),
        kills.len().to_string(),
        digits(median(&ended), 1),
        digits(largest(&ended), 1),
        count(&|kill: &OrphanResult| kill.next.is_none() && kill.remains.is_empty()),
        count(&|kill: &OrphanResult| matches!(kill.log, RecoveredLog::None)),
        count(&|kill: &OrphanResult| matches!(kill.log, RecoveredLog::NoTick)),
        missing.len().to_string(),
        digits(median(&missing), 3),
        digits(largest(&missing), 3),
    ]
}

fn expect(kills: &[&OrphanResult]) -> Vec<Expectation> {
    let ended: Vec<f64> = kills.iter().map(|kill| kill.ended_ms).collect();
    let missing = missing(kills);
    let failures: Vec<String> = kills
        .iter()
        .flat_map(|kill| kill.next.iter().cloned().chain(kill.remains.iter().map(|name| format!("left: {name}"))))
        .collect();
    let lost: Vec<&str> = kills
        .iter()
        .filter_map(|kill| if let RecoveredLog::Lost(cause) = &kill.log { Some(cause.as_str()) } else { None })
        .collect();
    let first = |list: &[&str]| list.first().map_or("0".to_owned(), |first| format!("{}, the first: {first}", list.len()));
    vec![
        Expectation::new(
            "longest time from the kill of launcher and supervisor to the end of its last process",
            &format!("{ALL_ENDED_MS} ms at most"),
            format!("{} ms", digits(largest(&ended), 1)),
            largest(&ended).is_some_and(|ms| ms <= ALL_ENDED_MS),
        ),
        Expectation::new(
            "next starts that fail, or leave remains of the killed run",
            "0",
            first(&failures.iter().map(String::as_str).collect::<Vec<_>>()),
            failures.is_empty(),
        ),
        Expectation::new("logs that cannot be recovered, or have gaps", "0", first(&lost), lost.is_empty()),
        Expectation::new(
            "largest gap at the end of a recovered log",
            &format!("{MISSING_S} s"),
            format!("{} s", digits(largest(&missing), 3)),
            largest(&missing).is_some_and(|seconds| seconds <= MISSING_S),
        ),
    ]
}
