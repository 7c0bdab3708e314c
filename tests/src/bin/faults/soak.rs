//! Soak: some minutes with more than one fault a second, and the resources of the run before and after.

use crate::part::{DocumentPart, Expectation, digits, table, verdict};
use crate::runs::{LOG, RunFolder, RunResult};
use crate::sample::ResourceSample;
use crate::trace::{Trace, TraceCommand};
use serde_json::Value;
use std::fmt::Write as _;
use std::time::{Duration, Instant};

/// Undisturbed time before and after the faults [s].
const UNDISTURBED_S: [u64; 2] = [8, 52];
/// Time of the first sample, and interval of the others [s].
const SAMPLE_S: f64 = 5.0;
/// Faults in ten minutes: kills of one process, kills of both controllers (two each), and halts.
const IN_TEN_MINUTES: [u64; 3] = [880, 60, 200];
/// Durations of the halts, equally frequent [ms].
const HALTS_MS: [u64; 5] = [20, 35, 50, 65, 80];
/// Time of the first slide, and interval of the others [s].
const SLIDES_S: (f64, f64) = (10.2, 2.0);
/// Positions x of the slides, alternating [m].
const TARGETS_M: [f64; 2] = [-0.02, -0.18];
/// Largest growth of each count from the first sample to the last.
const COUNT_GROWTH: u64 = 8;
/// Largest growth of the resident memory of a process [kB].
const MEMORY_GROWTH_KB: u64 = 32 * 1024;
/// Scenario of the soak.
const SCENARIO_FILE: &str = "soak.toml";

/// Size of a part of the log [MB].
const PART_MB: u32 = 20;

/// Name of a resource, its value in a sample, and its largest growth.
type ResourceLimit = (&'static str, fn(&ResourceSample) -> u64, u64);

/// Makes the part.
pub(crate) fn make(minutes: u64) -> DocumentPart {
    let folder = RunFolder::new();
    let duration_s = minutes * 60 + UNDISTURBED_S[0] + UNDISTURBED_S[1];
    let floor = folder.run(&["scenarios", "floor"], Duration::from_secs(60));
    std::fs::write(folder.path(SCENARIO_FILE), scenario(&floor.out, minutes)).expect("a scenario");
    eprintln!("soak: {duration_s} s");
    let begun = Instant::now();
    let mut run = folder.start(&["run", SCENARIO_FILE, "--log", LOG, "--summary-json", "run.json"]);
    let pid = run.pid();
    let mut samples: Vec<ResourceSample> = Vec::new();
    // Twice as long, since time may slip.
    let limit = Duration::from_secs(2 * duration_s + 60);
    while !run.has_ended() && begun.elapsed() < limit {
        let at_s = begun.elapsed().as_secs_f64();
        if at_s >= SAMPLE_S * (samples.len() + 1) as f64 {
            // A failed sample repeats at the next poll.
            samples.extend(ResourceSample::take(pid, at_s));
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    let end = run.finish(Duration::ZERO);
    let trace = Trace::read(&folder.path(LOG));
    let expectations = expect(&end, &samples, trace.missing(duration_s as usize * 1000));
    let text = format!("{}\n{}\n{}", verdict(&expectations), losses(&end, &trace, minutes), resources(&samples));
    DocumentPart { tables: vec![("soak", text)], expectations }
}

/// Returns the floor scenario with a longer duration, more changes of the operator, and faults.
fn scenario(floor: &str, minutes: u64) -> String {
    let duration_s = minutes * 60 + UNDISTURBED_S[0] + UNDISTURBED_S[1];
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
    let _ = writeln!(text, "\n[recorder]\npart_mb = {PART_MB}");
    let [kills, both, halts] = IN_TEN_MINUTES.map(|count| (count * minutes).div_ceil(10));
    let any = "[\"controller\", \"standby\", \"planner\", \"gate\", \"spare_gate\", \"recorder\", \"supervisor\"]";
    let halted = "[\"controller\", \"standby\", \"planner\", \"gate\", \"spare_gate\", \"recorder\"]";
    let mut fault = |kind: &str, process: &str, more: &str, count: u64| {
        let (from, to) = (UNDISTURBED_S[0], UNDISTURBED_S[0] + minutes * 60);
        let random = format!("{{ count = {count}, from_s = {from}.0, to_s = {to}.0 }}");
        let _ = writeln!(text, "\n[[fault]]\nkind = \"{kind}\"\nprocess = {process}\n{more}random = {random}");
    };
    fault("kill", any, "", kills);
    fault("kill", "\"controllers\"", "", both);
    for for_ms in HALTS_MS {
        fault("stop", halted, &format!("for_ms = {for_ms}\n"), halts.div_ceil(HALTS_MS.len() as u64));
    }
    text
}

fn number(summary: &Value, path: &str) -> Option<f64> {
    summary.pointer(path)?.as_f64()
}

/// Table of the losses and their consequences.
fn losses(end: &RunResult, trace: &Trace, minutes: u64) -> String {
    let count = |path: &str| digits(number(&end.summary, path), 0);
    let losses = end.summary.pointer("/losses/processes").and_then(Value::as_array).cloned().unwrap_or_default();
    let lost = |loss: &Value| {
        let longest = digits(loss["longest_ms"].as_f64(), 1);
        (
            format!("{} lost", loss["process"].as_str().unwrap_or("?")),
            format!("{} times, recovered within {longest} ms", loss["times"]),
        )
    };
    let outages = trace.outages();
    let longest = outages.iter().map(ExactSizeIterator::len).max();
    let unanswered = longest_unanswered(trace);
    let mut rows = vec![
        ("minutes with faults".to_owned(), minutes.to_string()),
        ("completed".to_owned(), end.outcome_text()),
        ("injected faults".to_owned(), count("/losses/injected")),
    ];
    rows.extend(losses.iter().map(lost));
    rows.extend([
        ("ticks lost by the recorder".to_owned(), count("/recorder/lost")),
        ("ticks missed".to_owned(), count("/timing/missed_ticks")),
        ("ticks braked".to_owned(), count("/timing/brake_ticks")),
        ("ticks slipped".to_owned(), count("/timing/late_ticks")),
        ("brakes and stops".to_owned(), count("/incidents/count")),
        ("outages of fresh torque".to_owned(), outages.len().to_string()),
        ("longest outage, ms".to_owned(), digits(longest.map(|ticks| ticks as f64), 0)),
        ("longest time without an answered tick, ms".to_owned(), unanswered.to_string()),
        ("steal time, ms".to_owned(), count("/timing/steal_ms")),
    ]);
    table(&["figure", "found"], &rows.into_iter().map(|(name, found)| vec![name, found]).collect::<Vec<_>>())
}

/// Largest number of consecutive unanswered ticks after the first torque.
fn longest_unanswered(trace: &Trace) -> usize {
    let (mut longest, mut now) = (0, 0);
    for tick in trace.ticks.iter().skip(trace.first) {
        now = if tick.command.as_ref().is_none_or(TraceCommand::answered) { 0 } else { now + 1 };
        longest = longest.max(now);
    }
    longest
}

/// Table of the resources: first, middle and last sample.
fn resources(samples: &[ResourceSample]) -> String {
    let middle = samples.len() / 2;
    let chosen: Vec<&ResourceSample> = [samples.first(), samples.get(middle), samples.last()].into_iter().flatten().collect();
    let mut head = vec!["resource".to_owned()];
    head.extend(chosen.iter().map(|sample| format!("at {:.0} s", sample.at_s)));
    let row = |name: &str, figure: &dyn Fn(&ResourceSample) -> u64| {
        let mut cells = vec![name.to_owned()];
        cells.extend(chosen.iter().map(|sample| figure(sample).to_string()));
        cells
    };
    let rows = [
        row("launcher: resident memory, kB", &|s: &ResourceSample| s.launcher.rss_kb),
        row("launcher: threads", &|s: &ResourceSample| s.launcher.threads),
        row("launcher: open files", &|s: &ResourceSample| s.launcher.files),
        row("plant: resident memory, kB", &|s: &ResourceSample| s.plant.rss_kb),
        row("plant: threads", &|s: &ResourceSample| s.plant.threads),
        row("plant: open files", &|s: &ResourceSample| s.plant.files),
        row("supervisor: resident memory, kB", &|s: &ResourceSample| s.supervisor.rss_kb),
        row("supervisor: open files", &|s: &ResourceSample| s.supervisor.files),
        row("gate: resident memory, kB", &|s: &ResourceSample| s.gates[0].rss_kb),
        row("spare gate: resident memory, kB", &|s: &ResourceSample| s.gates[1].rss_kb),
        row("recorder: resident memory, kB", &|s: &ResourceSample| s.recorder.rss_kb),
        row("files in shared memory", &|s: &ResourceSample| s.shared),
        row("size of these files, kB", &|s: &ResourceSample| s.shared_bytes / 1024),
        row("entries of the run's folder", &|s: &ResourceSample| s.entries),
    ];
    table(&head.iter().map(String::as_str).collect::<Vec<_>>(), &rows)
}

fn expect(end: &RunResult, samples: &[ResourceSample], missing: usize) -> Vec<Expectation> {
    let lost = number(&end.summary, "/recorder/lost");
    let resources: [ResourceLimit; 11] = [
        ("threads of the launcher", |s| s.launcher.threads, COUNT_GROWTH),
        ("threads of the plant", |s| s.plant.threads, COUNT_GROWTH),
        ("open files of the launcher", |s| s.launcher.files, COUNT_GROWTH),
        ("open files of the plant", |s| s.plant.files, COUNT_GROWTH),
        ("files in shared memory", |s| s.shared, COUNT_GROWTH),
        ("entries of the run's folder", |s| s.entries, COUNT_GROWTH),
        ("resident memory of the launcher, kB", |s| s.launcher.rss_kb, MEMORY_GROWTH_KB),
        ("resident memory of the supervisor, kB", |s| s.supervisor.rss_kb, MEMORY_GROWTH_KB),
        ("resident memory of the gates, kB", |s| s.gates.iter().map(|gate| gate.rss_kb).sum(), MEMORY_GROWTH_KB),
        ("resident memory of the recorder, kB", |s| s.recorder.rss_kb, MEMORY_GROWTH_KB),
        ("resident memory of the plant, kB", |s| s.plant.rss_kb, MEMORY_GROWTH_KB),
    ];
    // A lost recorder takes some 30 ticks with it.
    let uncounted = missing.saturating_sub(lost.unwrap_or(0.0) as usize);
    let completed = end.completed();
    let mut all = vec![
        Expectation::new("the soak completes", "yes", end.outcome_text(), completed),
        Expectation::new("ticks missing in the log that the summary does not count", "0", uncounted.to_string(), uncounted == 0),
    ];
    for (name, value, growth) in resources {
        let [before, middle, after] =
            [samples.first(), samples.get(samples.len() / 2), samples.last()].map(|s| s.map_or(0, value));
        let reached = samples.len() > 2 && after <= before + growth && after <= middle + growth;
        let found = format!("{before} before, {middle} in the middle, {after} after");
        all.push(Expectation::new(name, &format!("{growth} more at most"), found, reached));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::{IN_TEN_MINUTES, PART_MB, scenario};
    use hapfic_config::{FaultKind, FaultTarget, Settings};

    #[test]
    fn scenario_ten_minutes_has_all_faults() {
        let floor = include_str!("../../../../config/scenarios/floor.toml");
        let settings = Settings::from_str(&scenario(floor, 10), "soak", None, &[]).unwrap();
        assert_eq!(settings.duration_ticks, 660_000);
        assert_eq!((settings.supervisor.restart_budget, settings.recorder.part_mb), (100_000, Some(PART_MB)));
        let count = |kind, target: Option<FaultTarget>| {
            settings.faults.iter().filter(|f| f.kind == kind && target.is_none_or(|target| f.target == target)).count() as u64
        };
        let [kills, both, halts] = IN_TEN_MINUTES;
        assert_eq!(count(FaultKind::Kill, Some(FaultTarget::Controllers)), both);
        assert_eq!(count(FaultKind::Kill, None), kills + both);
        assert_eq!(count(FaultKind::Stop, None), halts);
        // A kill of both controllers counts twice.
        assert_eq!(kills + 2 * both, 1000);
    }
}
