//! `hapfic bench latency`: a run of the real stack, interleaved with the chains of the comparison.

use super::arguments::LatencyArgs;
use super::chains::{ChainKind, ChainResults, Chains, ThreadPlacement, chain_kinds, missing_privileges};
use super::load::Load;
use super::output_paths::{TemporaryFolder, check};
use super::results::{BenchResults, MeasurementSetup, host_observations};
use super::stack::{RunTiming, StackRun};
use super::steal::StealMonitor;
use super::ticks::Ticks;
use super::{figure, table};
use crate::output::{OutputKind, check_output};
use crate::{CommandOutcome, log_line, print};
use anyhow::{Context, Result};
use hapfic_config::Settings;
use hapfic_diagnostics::cause::Span;
use hapfic_ipc::clock;
use hapfic_messages::{Command, PERIOD_NS, Request, State};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Warm-up of the chains of this program, and of those of peers [s].
const WARM_UP_S: [u64; 2] = [2, 6];
/// Excess of the run over warm-up and measurement: start of the run, and late results [s].
const MARGIN_S: u64 = 3;
/// Interval at which the steal time is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
const NS_PER_S: u64 = 1_000_000_000;

/// Measures, and prints the results.
pub(super) fn latency(args: &LatencyArgs) -> Result<CommandOutcome> {
    let (settings, kinds) = match prepare(args) {
        Ok(prepared) => prepared,
        Err(e) => return Ok(CommandOutcome::Rejected(e)),
    };
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot handle signals")?;
    }
    let Some(results) = measure(args, &settings, &kinds, &stop)? else {
        log_line("hapfic: interrupted, no results");
        return Ok(CommandOutcome::Failed);
    };
    print(table::text(&results).trim_end());
    if let Some(path) = &args.json {
        let text = serde_json::to_vec_pretty(&results)?;
        std::fs::write(path, text).with_context(|| format!("--json {}: cannot be written", path.display()))?;
    }
    if let Some(path) = &args.plot {
        figure::write(&results, path)?;
    }
    Ok(if results.completed { CommandOutcome::Done } else { CommandOutcome::Failed })
}

/// Checks the arguments, and loads the scenario and the kinds of chains.
fn prepare(args: &LatencyArgs) -> Result<(Settings, Vec<ChainKind>)> {
    let mut overrides = args.set.clone();
    overrides.push(format!("duration_s={:?}", duration_s(args) as f64));
    let settings = Settings::load(&args.scenario, &overrides)?;
    if let Some(path) = &args.json {
        check("--json", path, None)?;
    }
    if let Some(path) = &args.plot {
        check("--plot", path, Some("png"))?;
    }
    let input = [Path::new(&args.scenario)];
    for (option, path, kind) in [("--json", &args.json, OutputKind::Json("about")), ("--plot", &args.plot, OutputKind::Picture)] {
        if let Some(path) = path {
            check_output(option, path, kind, &input, args.force)?;
        }
    }
    Ok((settings, chain_kinds(&args.peers)?))
}

fn warm_up_s(args: &LatencyArgs) -> u64 {
    WARM_UP_S[usize::from(!args.peers.is_empty())]
}

fn duration_s(args: &LatencyArgs) -> u64 {
    warm_up_s(args) + args.seconds + MARGIN_S
}

/// Measures; `None` if interrupted. All started processes end with this function, in the reverse order of declaration.
fn measure(args: &LatencyArgs, settings: &Settings, kinds: &[ChainKind], stop: &AtomicBool) -> Result<Option<BenchResults>> {
    let folder = TemporaryFolder::make()?;
    let longest = Duration::from_secs(2 * duration_s(args) + 60);
    let load_average = load_average();
    let load = if args.load { Load::start(longest)? } else { Load::NONE };
    let mut stack = StackRun::start(args, duration_s(args), &folder)?;
    let Some(found) = stack.find(stop)? else { return Ok(None) };
    let placement = ThreadPlacement::new(settings, found);
    let span = span(found, clock::now_ns(), warm_up_s(args), args.seconds);
    let mut monitors: Vec<_> = placement.distinct_cores().into_iter().map(StealMonitor::new).collect();
    let mut chains = Chains::start(kinds, &placement, span.from_ns, args.seconds)?;
    if chains.ready(span.from_ns, stop)? {
        return Ok(None);
    }
    while clock::now_ns() < span.to_ns {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        monitors.iter_mut().for_each(StealMonitor::poll);
        stack.ensure_running()?;
        chains.receive(POLL_INTERVAL)?;
    }
    monitors.iter_mut().for_each(StealMonitor::poll);
    let Some(measured) = chains.finish(stop)? else { return Ok(None) };
    let Some(summary) = stack.finish(stop)? else { return Ok(None) };
    let busy = load.len();
    // The evaluation needs no load.
    drop(load);
    let mut not_granted = stack.missing_privileges();
    not_granted.extend(all_missing_privileges(&measured, kinds, &placement));
    let steals: Vec<_> = monitors.into_iter().flat_map(|monitor| monitor.steals).collect();
    let stolen_ms = steals.iter().map(|(_, ms)| ms).sum();
    let ticks = Ticks::read(stack.log())?;
    let stack_results = ticks.evaluate(span, &host_observations(&measured, steals));
    let names: Vec<_> = kinds.iter().map(|c| c.kind.clone()).collect();
    let results = BenchResults::new(setup(args, &placement, busy, load_average), span, stack_results, &measured, &names);
    let completed = summary["completed"].as_bool().unwrap_or(false);
    Ok(Some(BenchResults { completed, stolen_ms, not_granted, ..results }))
}

/// Time span of the measurement, which begins when the plant's timer is due.
fn span(found: RunTiming, now_ns: u64, warm_up_s: u64, seconds: u64) -> Span {
    let earliest = now_ns + warm_up_s * NS_PER_S;
    let periods = earliest.saturating_sub(found.due_ns).div_ceil(PERIOD_NS);
    let from_ns = found.due_ns + periods * PERIOD_NS;
    Span { from_ns, to_ns: from_ns + seconds * NS_PER_S }
}

fn all_missing_privileges(results: &ChainResults, kinds: &[ChainKind], placement: &ThreadPlacement) -> Vec<String> {
    let chains = kinds.iter().map(|c| c.kind.as_str()).zip(&results.chains);
    let reference_timers = results.reference_timers.iter().map(|timer| ("reference timer", timer));
    chains
        .chain([("timer", &results.timer)])
        .chain(reference_timers)
        .flat_map(|(name, measured)| missing_privileges(name, measured, placement))
        .collect()
}

/// Load average of the last minute; zero if the system does not report it.
fn load_average() -> f64 {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split_whitespace().next().and_then(|word| word.parse().ok()).unwrap_or(0.0)
}

fn setup(args: &LatencyArgs, placement: &ThreadPlacement, load: usize, load_average: f64) -> MeasurementSetup {
    let name = |file: &str| std::fs::read_to_string(format!("/proc/sys/kernel/{file}")).unwrap_or_default();
    MeasurementSetup {
        scenario: args.scenario.clone(),
        seconds: args.seconds,
        kernel: format!("{} {}", name("ostype").trim(), name("osrelease").trim()),
        cores: rustix::thread::sched_getaffinity(None).map_or(0, |set| set.count() as usize),
        on_cores: [placement.cores[0], placement.cores[1], placement.gate],
        chains_on_cores: placement.cores,
        priorities: placement.priorities,
        load,
        load_average,
        message_bytes: [size_of::<State>(), size_of::<Request>(), size_of::<Command>()],
        unix_s: clock::unix_ns() / NS_PER_S,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn span_begins_when_plant_timer_is_due() {
        let found = RunTiming { due_ns: 5_000_123, core: None, gate_core: None };
        let span = span(found, 7_654_321, 2, 3);
        assert_eq!((span.from_ns - found.due_ns) % PERIOD_NS, 0);
        assert!(span.from_ns >= 2_007_654_321 && span.from_ns < 2_008_654_321);
        assert_eq!(span.to_ns - span.from_ns, 3 * NS_PER_S);
    }
}
