//! Some minutes with more than a fault a second: what the run gets over, and what it takes of the machine before and after.

use crate::part::{Expectation, Part, digits, table, verdict};
use crate::runs::{End, LOG, Place};
use crate::sample::Sample;
use crate::trace::{Command, Trace};
use serde_json::Value;
use std::fmt::Write as _;
use std::time::{Duration, Instant};

/// Undisturbed time before the faults, and behind them, s.
const CALM_S: [u64; 2] = [8, 52];
/// When the first sample is taken, and how often then, s.
const SAMPLE_S: f64 = 5.0;
/// Faults in ten minutes: kills of one process, of both controllers at once (two each), and halts.
const IN_TEN_MINUTES: [u64; 3] = [880, 60, 200];
/// Lengths of the halts, ms: as many of each.
const HALTS_MS: [u64; 5] = [20, 35, 50, 65, 80];
/// From where on the operator slides to and fro, and how often, s.
const SLIDES_S: (f64, f64) = (10.2, 2.0);
/// Where to, m.
const TARGETS_M: [f64; 2] = [-0.02, -0.18];
/// What may have been added to each count of things held from the first sample to the last.
const MORE: u64 = 8;
/// What may have been added to the resident memory of a process, kB.
const MORE_KB: u64 = 32 * 1024;
/// The scenario.
const FILE: &str = "soak.toml";

/// What may grow with the first losses.
const SUPERVISOR_FILES: &str = "open files of the supervisor";
/// By so many: with the first loss of each process the supervisor's senders meet its successor, and keep what they opened for it.
const FIRST_LOSSES: u64 = 32;

/// A figure's name, what it is of a sample, and by how much it may grow.
type Figure = (&'static str, fn(&Sample) -> u64, u64);

/// Makes the part.
pub(crate) fn make(minutes: u64) -> Part {
    let place = Place::new();
    let duration_s = minutes * 60 + CALM_S[0] + CALM_S[1];
    let floor = place.run(&["scenarios", "floor"], Duration::from_secs(60));
    std::fs::write(place.path(FILE), scenario(&floor.out, minutes)).expect("a scenario");
    eprintln!("soak: {duration_s} s");
    let begun = Instant::now();
    let mut run = place.start(&["run", FILE, "--log", LOG, "--summary-json", "run.json"]);
    let pid = run.pid();
    let mut samples: Vec<Sample> = Vec::new();
    // Twice as long, for what slips.
    let limit = Duration::from_secs(2 * duration_s + 60);
    while !run.has_ended() && begun.elapsed() < limit {
        let at_s = begun.elapsed().as_secs_f64();
        if at_s >= SAMPLE_S * (samples.len() + 1) as f64 {
            // One that cannot be had just now can a moment later.
            samples.extend(Sample::take(pid, at_s));
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    let end = run.finish(Duration::ZERO);
    let trace = Trace::read(&place.path(LOG));
    let expectations = expect(&end, &samples, trace.missing(duration_s as usize * 1000));
    let text = format!("{}\n{}\n{}", verdict(&expectations), figures(&end, &trace, minutes), held(&samples));
    Part { tables: vec![("soak", text)], expectations }
}

/// The floor scenario, longer, with more of the operator, and with faults.
fn scenario(floor: &str, minutes: u64) -> String {
    let duration_s = minutes * 60 + CALM_S[0] + CALM_S[1];
    let mut text = String::new();
    for line in floor.lines() {
        match line.split_once('=') {
            Some((key, _)) if key.trim() == "duration_s" => text.push_str(&format!("duration_s = {duration_s}.0\n")),
            _ => text.extend([line, "\n"]),
        }
    }
    // Writing to a string cannot fail.
    let (mut at_s, mut target) = (SLIDES_S.0, TARGETS_M.iter().cycle());
    while at_s + SLIDES_S.1 < duration_s as f64 {
        let x = target.next().copied().unwrap_or_default();
        let _ = writeln!(text, "\n[[operator]]\nat_s = {at_s:.1}\ntarget_position_m = [{x:?}, 0.05, 0.012]");
        at_s += SLIDES_S.1;
    }
    let _ = writeln!(text, "\n[supervisor]\nrestart_budget = 100000\nrestart_backoff_ms = 0");
    let [kills, both, halts] = IN_TEN_MINUTES.map(|count| (count * minutes).div_ceil(10));
    let one = "[\"controller\", \"standby\", \"planner\"]";
    let mut fault = |kind: &str, process: &str, more: &str, count: u64| {
        let (from, to) = (CALM_S[0], CALM_S[0] + minutes * 60);
        let random = format!("{{ count = {count}, from_s = {from}.0, to_s = {to}.0 }}");
        let _ = writeln!(text, "\n[[fault]]\nkind = \"{kind}\"\nprocess = {process}\n{more}random = {random}");
    };
    fault("kill", one, "", kills);
    fault("kill", "\"controllers\"", "", both);
    for for_ms in HALTS_MS {
        fault("stop", one, &format!("for_ms = {for_ms}\n"), halts.div_ceil(HALTS_MS.len() as u64));
    }
    text
}

fn number(summary: &Value, path: &str) -> Option<f64> {
    summary.pointer(path)?.as_f64()
}

/// What the run got over.
fn figures(end: &End, trace: &Trace, minutes: u64) -> String {
    let count = |path: &str| digits(number(&end.summary, path), 0);
    let losses = end.summary.pointer("/losses/processes").and_then(Value::as_array).cloned().unwrap_or_default();
    let lost = |loss: &Value| {
        let longest = digits(loss["longest_ms"].as_f64(), 1);
        (
            format!("{} lost", loss["process"].as_str().unwrap_or("?")),
            format!("{} times, back within {longest} ms", loss["times"]),
        )
    };
    let outages = trace.outages();
    let longest = outages.iter().map(ExactSizeIterator::len).max();
    let silent = longest_silence(trace);
    let mut rows = vec![
        ("minutes with faults".to_owned(), minutes.to_string()),
        ("completed".to_owned(), end.word()),
        ("faults on purpose".to_owned(), count("/losses/injected")),
    ];
    rows.extend(losses.iter().map(lost));
    rows.extend([
        ("ticks lost by the recorder".to_owned(), count("/recorder/lost")),
        ("ticks missed".to_owned(), count("/timing/missed_ticks")),
        ("ticks braked".to_owned(), count("/timing/brake_ticks")),
        ("ticks slipped".to_owned(), count("/timing/late_ticks")),
        ("brakes and stops".to_owned(), count("/incidents/count")),
        ("times without fresh torque".to_owned(), outages.len().to_string()),
        ("the longest of them, ms".to_owned(), digits(longest.map(|ticks| ticks as f64), 0)),
        ("longest time without any answer, ms".to_owned(), silent.to_string()),
        ("stolen by the host, ms".to_owned(), count("/timing/steal_ms")),
    ]);
    table(&["figure", "found"], &rows.into_iter().map(|(name, found)| vec![name, found]).collect::<Vec<_>>())
}

/// Most ticks in a row that nobody answered, after the first torque.
fn longest_silence(trace: &Trace) -> usize {
    let (mut longest, mut now) = (0, 0);
    for tick in trace.ticks.iter().skip(trace.first) {
        now = if tick.command.as_ref().is_none_or(Command::answered) { 0 } else { now + 1 };
        longest = longest.max(now);
    }
    longest
}

/// What the run takes of the machine: the first sample, the one in the middle, the last.
fn held(samples: &[Sample]) -> String {
    let middle = samples.len() / 2;
    let chosen: Vec<&Sample> = [samples.first(), samples.get(middle), samples.last()].into_iter().flatten().collect();
    let mut head = vec!["held".to_owned()];
    head.extend(chosen.iter().map(|sample| format!("at {:.0} s", sample.at_s)));
    let row = |name: &str, figure: &dyn Fn(&Sample) -> u64| {
        let mut cells = vec![name.to_owned()];
        cells.extend(chosen.iter().map(|sample| figure(sample).to_string()));
        cells
    };
    let rows = [
        row("supervisor: resident memory, kB", &|s: &Sample| s.supervisor.rss_kb),
        row("supervisor: threads", &|s: &Sample| s.supervisor.threads),
        row("supervisor: open files", &|s: &Sample| s.supervisor.files),
        row("plant: resident memory, kB", &|s: &Sample| s.plant.rss_kb),
        row("plant: threads", &|s: &Sample| s.plant.threads),
        row("plant: open files", &|s: &Sample| s.plant.files),
        row("files in shared memory", &|s: &Sample| s.shared),
        row("taken by them, kB", &|s: &Sample| s.shared_bytes / 1024),
        row("entries of the run's folder", &|s: &Sample| s.entries),
    ];
    table(&head.iter().map(String::as_str).collect::<Vec<_>>(), &rows)
}

fn expect(end: &End, samples: &[Sample], missing: usize) -> Vec<Expectation> {
    let lost = number(&end.summary, "/recorder/lost");
    let figures: [Figure; 8] = [
        ("threads of the supervisor", |s| s.supervisor.threads, MORE),
        ("threads of the plant", |s| s.plant.threads, MORE),
        (SUPERVISOR_FILES, |s| s.supervisor.files, MORE),
        ("open files of the plant", |s| s.plant.files, MORE),
        ("files in shared memory", |s| s.shared, MORE),
        ("entries of the run's folder", |s| s.entries, MORE),
        ("resident memory of the supervisor, kB", |s| s.supervisor.rss_kb, MORE_KB),
        ("resident memory of the plant, kB", |s| s.plant.rss_kb, MORE_KB),
    ];
    let completed = end.completed();
    let mut all = vec![
        Expectation::new("the soak completes", "yes", end.word(), completed),
        Expectation::new("ticks lost by the recorder", "0", digits(lost, 0), lost == Some(0.0)),
        Expectation::new("ticks missing in the log", "0", missing.to_string(), missing == 0),
    ];
    for (name, figure, more) in figures {
        let [before, middle, after] =
            [samples.first(), samples.get(samples.len() / 2), samples.last()].map(|s| s.map_or(0, figure));
        // What the first losses leave open once is no growth: behind the middle there is none of it.
        let once = if name == SUPERVISOR_FILES { FIRST_LOSSES } else { more };
        let reached = samples.len() > 2 && after <= before + once && after <= middle + more;
        let found = format!("{before} before, {middle} in the middle, {after} after");
        let expected = if once == more {
            format!("{more} more at most")
        } else {
            format!("{once} more at most, of them {more} behind the middle")
        };
        all.push(Expectation::new(name, &expected, found, reached));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::{IN_TEN_MINUTES, scenario};
    use hapfic_config::{FaultKind, FaultTarget, Settings};

    #[test]
    fn the_scenario_is_one_with_all_its_faults() {
        let floor = include_str!("../../../../config/scenarios/floor.toml");
        let settings = Settings::from_str(&scenario(floor, 10), "soak", None, &[]).unwrap();
        assert_eq!(settings.duration_ticks, 660_000);
        assert_eq!(settings.supervisor.restart_budget, 100_000);
        let count = |kind, target: Option<FaultTarget>| {
            settings.faults.iter().filter(|f| f.kind == kind && target.is_none_or(|target| f.target == target)).count() as u64
        };
        let [kills, both, halts] = IN_TEN_MINUTES;
        assert_eq!(count(FaultKind::Kill, Some(FaultTarget::Controllers)), both);
        assert_eq!(count(FaultKind::Kill, None), kills + both);
        assert_eq!(count(FaultKind::Stop, None), halts);
        // A kill of both is two.
        assert_eq!(kills + 2 * both, 1000);
    }
}
