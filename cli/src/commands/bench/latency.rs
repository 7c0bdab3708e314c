//! `hapfic bench latency`: one run of the real stack, the chains beside it, and what to make of both.

use super::arguments::LatencyArgs;
use super::chains::{Chains, Contender, Heard, Where, contenders, lacks};
use super::load::Load;
use super::output_paths::{Folder, check};
use super::results::{About, Results, seen};
use super::stack::{Found, Stack};
use super::steal::StealMonitor;
use super::ticks::Ticks;
use super::{figure, table};
use crate::{Outcome, log_line, print};
use anyhow::{Context, Result};
use hapfic_config::Settings;
use hapfic_diagnostics::cause::Span;
use hapfic_ipc::clock;
use hapfic_messages::{Command, PERIOD_NS, Request, State};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How long chains may take to get warm, s: those of this program, and others.
const WARM_UP_S: [u64; 2] = [2, 6];
/// How much longer the run is than warm-up and measurement, s: its own start, and what comes late.
const MARGIN_S: u64 = 3;
/// How often stolen time is looked at.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
const NS_PER_S: u64 = 1_000_000_000;

/// Measures, and prints what was found.
pub(super) fn latency(args: &LatencyArgs) -> Result<Outcome> {
    let (settings, kinds) = match prepare(args) {
        Ok(prepared) => prepared,
        Err(e) => return Ok(Outcome::Rejected(e)),
    };
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot handle signals")?;
    }
    let Some(results) = measure(args, &settings, &kinds, &stop)? else {
        log_line("hapfic: interrupted, nothing was measured");
        return Ok(Outcome::Failed);
    };
    print(table::text(&results).trim_end());
    if let Some(path) = &args.json {
        let text = serde_json::to_vec_pretty(&results)?;
        std::fs::write(path, text).with_context(|| format!("--json {}: cannot be written", path.display()))?;
    }
    if let Some(path) = &args.plot {
        figure::write(&results, path)?;
    }
    Ok(if results.completed { Outcome::Done } else { Outcome::Failed })
}

/// Everything that can fail because of what was asked for.
fn prepare(args: &LatencyArgs) -> Result<(Settings, Vec<Contender>)> {
    let mut overrides = args.set.clone();
    overrides.push(format!("duration_s={:?}", duration_s(args) as f64));
    let settings = Settings::load(&args.scenario, &overrides)?;
    if let Some(path) = &args.json {
        check("--json", path, None)?;
    }
    if let Some(path) = &args.plot {
        check("--plot", path, Some("png"))?;
    }
    Ok((settings, contenders(&args.peers)?))
}

fn warm_up_s(args: &LatencyArgs) -> u64 {
    WARM_UP_S[usize::from(!args.peers.is_empty())]
}

fn duration_s(args: &LatencyArgs) -> u64 {
    warm_up_s(args) + args.seconds + MARGIN_S
}

/// `None` if it was interrupted. Whatever was started ends with this, in the order of the declarations from the last to the first.
fn measure(args: &LatencyArgs, settings: &Settings, kinds: &[Contender], stop: &AtomicBool) -> Result<Option<Results>> {
    let folder = Folder::make()?;
    let longest = Duration::from_secs(2 * duration_s(args) + 60);
    let load = if args.load { Load::start(longest)? } else { Load::NONE };
    let mut stack = Stack::start(args, duration_s(args), &folder)?;
    let Some(found) = stack.find(stop)? else { return Ok(None) };
    let place = Where::new(settings, found);
    let span = span(found, clock::now_ns(), warm_up_s(args), args.seconds);
    let mut watches: Vec<_> = place.polled().into_iter().map(StealMonitor::new).collect();
    let mut chains = Chains::start(kinds, &place, span.from_ns, args.seconds)?;
    if chains.ready(span.from_ns, stop)? {
        return Ok(None);
    }
    while clock::now_ns() < span.to_ns {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        watches.iter_mut().for_each(StealMonitor::look);
        stack.ensure_running()?;
        chains.hear(POLL_INTERVAL)?;
    }
    watches.iter_mut().for_each(StealMonitor::look);
    let Some(heard) = chains.finish(stop)? else { return Ok(None) };
    let Some(summary) = stack.finish(stop)? else { return Ok(None) };
    let busy = load.len();
    // What is left is only reckoned.
    drop(load);
    let mut not_granted = stack.lacks();
    not_granted.extend(all_lacks(&heard, kinds, &place));
    let stolen: Vec<_> = watches.into_iter().flat_map(|watch| watch.stolen).collect();
    let stolen_ms = stolen.iter().map(|(_, ms)| ms).sum();
    let ticks = Ticks::read(stack.log())?;
    let figures = ticks.figures(span, &seen(&heard, stolen));
    let names: Vec<_> = kinds.iter().map(|c| c.kind.clone()).collect();
    let results = Results::new(about(args, &place, busy), span, figures, &heard, &names);
    let completed = summary["completed"].as_bool().unwrap_or(false);
    Ok(Some(Results { completed, stolen_ms, not_granted, ..results }))
}

/// The measurement: from when the plant's timer is due.
fn span(found: Found, now_ns: u64, warm_up_s: u64, seconds: u64) -> Span {
    let earliest = now_ns + warm_up_s * NS_PER_S;
    let periods = earliest.saturating_sub(found.due_ns).div_ceil(PERIOD_NS);
    let from_ns = found.due_ns + periods * PERIOD_NS;
    Span { from_ns, to_ns: from_ns + seconds * NS_PER_S }
}

fn all_lacks(heard: &Heard, kinds: &[Contender], place: &Where) -> Vec<String> {
    let chains = kinds.iter().map(|c| c.kind.as_str()).zip(&heard.chains);
    let witnesses = heard.witnesses.iter().map(|witness| ("witness", witness));
    chains.chain([("timer", &heard.timer)]).chain(witnesses).flat_map(|(name, measured)| lacks(name, measured, place)).collect()
}

fn about(args: &LatencyArgs, place: &Where, load: usize) -> About {
    let name = |file: &str| std::fs::read_to_string(format!("/proc/sys/kernel/{file}")).unwrap_or_default();
    About {
        scenario: args.scenario.clone(),
        seconds: args.seconds,
        kernel: format!("{} {}", name("ostype").trim(), name("osrelease").trim()),
        cores: rustix::thread::sched_getaffinity(None).map_or(0, |set| set.count() as usize),
        on_cores: [place.cores[0], place.cores[1], place.gate],
        chains_on_cores: place.cores,
        priorities: place.priorities,
        load,
        message_bytes: [size_of::<State>(), size_of::<Request>(), size_of::<Command>()],
        unix_s: clock::unix_ns() / NS_PER_S,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_measurement_begins_when_the_plant_is_due() {
        let found = Found { due_ns: 5_000_123, core: None, gate_core: None };
        let span = span(found, 7_654_321, 2, 3);
        assert_eq!((span.from_ns - found.due_ns) % PERIOD_NS, 0);
        assert!(span.from_ns >= 2_007_654_321 && span.from_ns < 2_008_654_321);
        assert_eq!(span.to_ns - span.from_ns, 3 * NS_PER_S);
    }
}
