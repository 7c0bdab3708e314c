//! Kills of the supervisor at any moment, seen from outside.

use crate::part::{Expectation, Part, digits, largest, median, table, verdict};
use crate::runs::{LOG, Place};
use crate::trace::Trace;
use hapfic_tests::remains_of;
use std::time::{Duration, Instant};

/// Kills, of them during the start, and the same of a quick part.
const KILLS: [(usize, usize); 2] = [(100, 40), (20, 8)];
/// The start, ms.
const START_MS: f64 = 150.0;
/// The latest kill, ms after the start of the program.
const LATEST_MS: f64 = 3000.0;
/// Of the moments.
const SEED: u64 = 11;
/// Longest that anything may go on running, ms.
const GONE_MS: f64 = 100.0;
/// Most that may be missing at the end of a log, s.
const MISSING_S: f64 = 0.1;
/// How long to look for what still runs.
const TIMEOUT: Duration = Duration::from_secs(10);
/// For how long nothing must be seen, at least: a process may be about to be started.
const QUIET: Duration = Duration::from_millis(100);
/// How long the next run, or a recovery, may take.
const LIMIT: Duration = Duration::from_secs(60);
/// What a recovery makes.
const RECOVERED: &str = "recovered.mcap";

/// What became of the log.
enum Log {
    /// There was none yet, or nothing in it.
    None,
    /// It has no command: the first tick was still to come.
    NoTick,
    /// What is missing at its end, s.
    Missing(f64),
    /// It cannot be recovered, or has gaps: why.
    Lost(String),
}

/// What came of a kill.
struct Killed {
    /// Until the last process was gone, ms.
    gone_ms: f64,
    /// What the next start, or its end, left.
    left: Vec<String>,
    /// The next start's exit code, if it was no good.
    next: Option<String>,
    log: Log,
}

/// Makes the part.
pub(crate) fn make(quick: bool) -> Part {
    let (kills, early) = KILLS[usize::from(quick)];
    let mut random = fastrand::Rng::with_seed(SEED);
    let place = Place::new();
    let mut all = Vec::new();
    for kill in 0..kills {
        let (from, to) = if kill < early { (0.0, START_MS) } else { (START_MS, LATEST_MS) };
        let delay_ms = from + random.f64() * (to - from);
        eprintln!("kill {} of {kills}: {delay_ms:.0} ms after the start", kill + 1);
        all.push((kill < early, once(&place, Duration::from_secs_f64(delay_ms * 1e-3))));
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
        "until the last process was gone, ms: median",
        "max",
        "next start works and removes the rest",
        "no log yet",
        "log without a tick",
        "log recovered",
        "missing at its end, s: median",
        "max",
    ];
    Part { tables: vec![("supervisor", format!("{}\n{}", verdict(&expectations), table(&head, &rows)))], expectations }
}

fn once(place: &Place, delay: Duration) -> Killed {
    for written in [LOG, RECOVERED] {
        let _ = std::fs::remove_file(place.path(written));
    }
    let begun = Instant::now();
    let run = place.start(&["run", "floor", "--duration", "60", "--log", LOG]);
    let pid = run.pid();
    std::thread::sleep(delay.saturating_sub(begun.elapsed()));
    let killed_ns = run.kill();
    let gone_ms = until_gone(pid, killed_ns);
    let end = place.run(&["run", "floor", "--duration", "0.3", "--log", "next.mcap"], LIMIT);
    let next =
        (end.code != Some(0)).then(|| format!("exit code {:?}: {}", end.code, end.err.lines().next_back().unwrap_or_default()));
    let mut left = remains_of(pid);
    if place.registrations() > 0 {
        left.push(format!("{} registrations", place.registrations()));
    }
    Killed { gone_ms, left, next, log: recovered(place, killed_ns) }
}

/// Looks until nothing of the run runs any more. Returns when that was, ms after the kill.
fn until_gone(pid: u32, killed_ns: u64) -> f64 {
    let begun = Instant::now();
    let mut gone_ns = None;
    loop {
        let looked_ns = hapfic_ipc::clock::now_ns();
        if remains_of(pid).iter().any(|name| name.starts_with("process")) {
            gone_ns = None;
        } else {
            gone_ns = gone_ns.or(Some(looked_ns));
        }
        let quiet = gone_ns.is_some_and(|gone| looked_ns - gone > QUIET.as_nanos() as u64);
        if quiet || begun.elapsed() > TIMEOUT {
            let gone_ns = gone_ns.unwrap_or(looked_ns);
            return gone_ns.saturating_sub(killed_ns) as f64 * 1e-6;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Recovers the log and compares its end with the moment of the kill.
fn recovered(place: &Place, killed_ns: u64) -> Log {
    if std::fs::metadata(place.path(LOG)).map_or(0, |file| file.len()) == 0 {
        return Log::None;
    }
    let end = place.run(&["recover", LOG, "--output", RECOVERED], LIMIT);
    if end.code == Some(2) && end.err.contains("nothing to recover") {
        return Log::None;
    }
    if end.code != Some(0) {
        return Log::Lost(format!("exit code {:?}: {}", end.code, end.err.lines().next_back().unwrap_or_default()));
    }
    // A log that is whole is not copied.
    let copy = place.path(RECOVERED);
    let trace = Trace::read(&if copy.exists() { copy } else { place.path(LOG) });
    if let Some(error) = trace.error {
        return Log::Lost(error);
    }
    let Some(last) = trace.last() else { return Log::NoTick };
    let missing = (0..=last).filter(|tick| trace.command(*tick).is_none()).count();
    if missing > 0 {
        return Log::Lost(format!("{missing} commands missing before tick {last}"));
    }
    // What was told of the tick comes after its command: without it, that of an earlier one, a tick earlier each.
    let told = (0..=last).rev().find_map(|tick| Some((tick, trace.ticks[tick].gated_ns?)));
    match told {
        Some((tick, stamp)) => {
            let stamp_s = stamp as f64 * 1e-9 + (last - tick) as f64 * 1e-3;
            Log::Missing((killed_ns as f64 * 1e-9 - stamp_s).max(0.0))
        }
        None => Log::Lost("no command has a time".to_owned()),
    }
}

fn missing(kills: &[&Killed]) -> Vec<f64> {
    let seconds = |kill: &&Killed| if let Log::Missing(seconds) = kill.log { Some(seconds) } else { None };
    kills.iter().filter_map(seconds).collect()
}

fn row(name: &str, kills: &[&Killed]) -> Vec<String> {
    let gone: Vec<f64> = kills.iter().map(|kill| kill.gone_ms).collect();
    let count = |wanted: &dyn Fn(&Killed) -> bool| kills.iter().filter(|kill| wanted(kill)).count().to_string();
    let missing = missing(kills);
    vec![
        name.to_owned(),
        kills.len().to_string(),
        digits(median(&gone), 1),
        digits(largest(&gone), 1),
        count(&|kill: &Killed| kill.next.is_none() && kill.left.is_empty()),
        count(&|kill: &Killed| matches!(kill.log, Log::None)),
        count(&|kill: &Killed| matches!(kill.log, Log::NoTick)),
        missing.len().to_string(),
        digits(median(&missing), 3),
        digits(largest(&missing), 3),
    ]
}

fn expect(kills: &[&Killed]) -> Vec<Expectation> {
    let gone: Vec<f64> = kills.iter().map(|kill| kill.gone_ms).collect();
    let missing = missing(kills);
    let bad: Vec<String> = kills
        .iter()
        .flat_map(|kill| kill.next.iter().cloned().chain(kill.left.iter().map(|left| format!("left: {left}"))))
        .collect();
    let lost: Vec<&str> =
        kills.iter().filter_map(|kill| if let Log::Lost(why) = &kill.log { Some(why.as_str()) } else { None }).collect();
    let first = |list: &[&str]| list.first().map_or("0".to_owned(), |first| format!("{}, the first: {first}", list.len()));
    vec![
        Expectation::new(
            "longest time anything goes on running after its supervisor was killed",
            &format!("{GONE_MS} ms at most"),
            format!("{} ms", digits(largest(&gone), 1)),
            largest(&gone).is_some_and(|ms| ms <= GONE_MS),
        ),
        Expectation::new(
            "next starts that fail or leave something of the killed run",
            "0",
            first(&bad.iter().map(String::as_str).collect::<Vec<_>>()),
            bad.is_empty(),
        ),
        Expectation::new("logs that cannot be recovered, or have gaps", "0", first(&lost), lost.is_empty()),
        Expectation::new(
            "most that is missing at the end of a recovered log",
            &format!("{MISSING_S} s"),
            format!("{} s", digits(largest(&missing), 3)),
            largest(&missing).is_some_and(|seconds| seconds <= MISSING_S),
        ),
    ]
}
