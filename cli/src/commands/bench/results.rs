//! Results of a measurement, for the table and for JSON.

use super::chains::ChainResults;
use super::ticks::StackResults;
use hapfic_diagnostics::cause::{Cause, Diagnosis, HostObservations, Span};
use hapfic_diagnostics::hops::HopQuantiles;
use hapfic_diagnostics::{ChainMeasurement, ChainQuantiles, Distribution, Ratio};
use serde::Serialize;

/// Setup of a measurement: scenario, machine and placement.
#[derive(Clone, Debug, Serialize)]
pub(super) struct MeasurementSetup {
    pub(super) scenario: String,
    /// Duration after the warm-up [s].
    pub(super) seconds: u64,
    /// Name and version of the kernel.
    pub(super) kernel: String,
    /// Number of usable cores.
    pub(super) cores: usize,
    /// Cores of plant, controller and gate; `None`: any.
    pub(super) on_cores: [Option<u32>; 3],
    /// Cores of the chains' three processes.
    pub(super) chains_on_cores: [Option<u32>; 3],
    /// Priorities of plant, controller and gate, and of the chains' three processes.
    pub(super) priorities: [u32; 3],
    /// Number of busy processes.
    pub(super) load: usize,
    /// Load average of the machine over the last minute, before the measurement: other programs than the stack.
    pub(super) load_average: f64,
    /// Lengths of state, request and command [bytes].
    pub(super) message_bytes: [usize; 3],
    /// Time of the evaluation since the Unix epoch [s].
    pub(super) unix_s: u64,
}

/// Summary of a chain of the comparison.
#[derive(Clone, Debug, Serialize)]
pub(super) struct ChainSummary {
    pub(super) name: String,
    /// Round trip: before sending -> answer received [us].
    pub(super) round_us: ChainQuantiles,
    /// Lateness of its driver's timer [us].
    pub(super) timer_us: ChainQuantiles,
    /// Number of messages without an answer in time.
    pub(super) unanswered: u64,
    /// Number of messages not sent, since the previous round trip outlasted their due time.
    pub(super) skipped: u64,
    #[serde(skip)]
    pub(super) round: Distribution,
}

/// Ratios of the stack's chain to another chain.
#[derive(Clone, Debug, Serialize)]
pub(super) struct ChainRatios {
    pub(super) name: String,
    pub(super) p50: Option<Ratio>,
    pub(super) p999: Option<Ratio>,
}

/// Summary of the missed ticks.
#[derive(Clone, Debug, Serialize)]
pub(super) struct MissSummary {
    pub(super) count: u64,
    pub(super) per_100_000: f64,
    /// Number by cause, in the order of the rules.
    pub(super) causes: [(Cause, u64); Cause::ALL.len()],
    pub(super) list: Vec<Diagnosis>,
}

/// Results of a measurement.
#[derive(Clone, Debug, Serialize)]
pub(super) struct BenchResults {
    pub(super) about: MeasurementSetup,
    /// Whether the run reached its end.
    pub(super) completed: bool,
    /// Number of measured ticks.
    pub(super) ticks: u64,
    /// Begin of writing the state -> plant has received the command [us].
    pub(super) stack_us: ChainQuantiles,
    /// State published -> plant has received the command [us].
    pub(super) published_us: ChainQuantiles,
    /// Number of commands after the plant's wait.
    pub(super) late: u64,
    pub(super) hops_us: Vec<HopQuantiles>,
    pub(super) chains: Vec<ChainSummary>,
    /// Lateness of a timer at the plant's priority [us].
    pub(super) timer_us: ChainQuantiles,
    pub(super) ratios: Vec<ChainRatios>,
    pub(super) missed: MissSummary,
    /// Steal time during the measurement [ms].
    pub(super) stolen_ms: u64,
    /// Number of heap allocations between receiving and sending, in all processes of the stack.
    pub(super) allocations: u64,
    /// Privileges that a process lacked.
    pub(super) not_granted: Vec<String>,
    #[serde(skip)]
    pub(super) stack: Distribution,
}

/// Collects the late wake-ups of the reference timers and the steal time.
pub(super) fn host_observations(measured_chains: &ChainResults, steals: Vec<(Span, u64)>) -> HostObservations {
    let late = |measured: &ChainMeasurement| -> Vec<Span> {
        measured.samples.iter().map(|s| Span { from_ns: s.due_ns, to_ns: s.wake_ns }).collect()
    };
    let mut late_timers: Vec<_> = measured_chains.reference_timers.iter().flat_map(late).collect();
    late_timers.extend(late(&measured_chains.timer));
    late_timers.sort_unstable_by_key(|span| span.from_ns);
    // Most samples are on time, which no diagnosis needs.
    late_timers.retain(|span| span.to_ns - span.from_ns > hapfic_diagnostics::cause::REFERENCE_LATE_NS / 4);
    HostObservations { late_timers, steals }
}

impl BenchResults {
    /// Combines the results of the stack and of the chains; `span` is the time of the measurement.
    pub(super) fn new(
        about: MeasurementSetup,
        span: Span,
        stack_results: StackResults,
        measured_chains: &ChainResults,
        names: &[String],
    ) -> Self {
        let chains: Vec<_> =
            measured_chains.chains.iter().zip(names).map(|(measured, name)| chain(measured, name, span)).collect();
        let stack = stack_results.hops.chain.clone();
        let ratios = |chain: &ChainSummary| ChainRatios {
            name: chain.name.clone(),
            p50: Ratio::of(0.5, &stack, &chain.round),
            p999: Ratio::of(0.999, &stack, &chain.round),
        };
        let mut timer = Distribution::default();
        measured_chains
            .timer
            .samples
            .iter()
            .filter_map(|s| Some((s, s.lateness_ns()?)))
            .for_each(|(s, ns)| timer.push(share(span, s.due_ns), ns));
        Self {
            about,
            completed: true,
            ticks: stack_results.ticks,
            stack_us: stack.quantiles(),
            published_us: stack_results.hops.published.quantiles(),
            late: stack_results.hops.late,
            hops_us: stack_results.hops.table(),
            ratios: chains.iter().map(ratios).collect(),
            chains,
            timer_us: timer.quantiles(),
            missed: MissSummary::new(stack_results.missed, stack_results.ticks),
            stolen_ms: 0,
            allocations: stack_results.allocations,
            not_granted: Vec::new(),
            stack,
        }
    }
}

impl MissSummary {
    fn new(list: Vec<Diagnosis>, ticks: u64) -> Self {
        let count = list.len() as u64;
        let causes = Cause::ALL.map(|cause| (cause, list.iter().filter(|diagnosis| diagnosis.cause == cause).count() as u64));
        Self { count, per_100_000: count as f64 * 1e5 / ticks.max(1) as f64, causes, list }
    }
}

fn share(span: Span, at_ns: u64) -> f64 {
    at_ns.saturating_sub(span.from_ns) as f64 / (span.to_ns - span.from_ns).max(1) as f64
}

fn chain(measured: &ChainMeasurement, name: &str, span: Span) -> ChainSummary {
    let (mut round, mut timer) = (Distribution::default(), Distribution::default());
    let (mut unanswered, mut skipped) = (0, 0);
    for sample in &measured.samples {
        let share = share(span, sample.due_ns);
        match sample.lateness_ns() {
            Some(ns) => timer.push(share, ns),
            None => {
                skipped += 1;
                continue;
            }
        }
        match sample.round_ns() {
            Some(ns) => round.push(share, ns),
            None => unanswered += 1,
        }
    }
    ChainSummary { name: name.to_owned(), round_us: round.quantiles(), timer_us: timer.quantiles(), unanswered, skipped, round }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use hapfic_diagnostics::ChainSample;
    use hapfic_diagnostics::cause::{MissKind, diagnose};
    use hapfic_diagnostics::hops::{Stamps, TickStamps};

    /// Sample of 1000 ticks of 60 us, one of them missed, and a chain of 50 us with one message unanswered and one not
    /// sent.
    pub(in super::super) fn sample_results() -> BenchResults {
        let span = Span { from_ns: 1_000_000_000, to_ns: 2_000_000_000 };
        let mut stack_results = StackResults { ticks: 1000, ..StackResults::default() };
        let mut samples = Vec::new();
        for i in 0..1000 {
            let due = span.from_ns + i * 1_000_000;
            let stamps = |wake: u64, publish: u64, latency_ns: u64| Stamps {
                due_ns: due + 10_000,
                wake_ns: due + wake,
                publish_ns: due + publish,
                latency_ns,
            };
            let tick = TickStamps {
                plant: stamps(8_000, 11_000, 59_000),
                controller: stamps(20_000, 30_000, 0),
                gate: stamps(40_000, 50_000, 0),
            };
            stack_results.hops.push(i as f64 / 1000.0, &tick);
            samples.push(match i {
                7 => ChainSample { due_ns: due, ..ChainSample::default() },
                6 => ChainSample { due_ns: due, wake_ns: due + 1, sent_ns: due + 2, end_ns: 0 },
                _ => ChainSample { due_ns: due, wake_ns: due + 5_000, sent_ns: due + 6_000, end_ns: due + 56_000 },
            });
        }
        let timer = |late_ns: u64| ChainMeasurement {
            kind: "timer".to_owned(),
            hops: 0,
            count: 1,
            granted: vec![7],
            samples: vec![ChainSample { due_ns: span.from_ns, wake_ns: span.from_ns + late_ns, ..ChainSample::default() }],
        };
        let futex = ChainMeasurement { kind: "futex".to_owned(), hops: 3, count: 1000, granted: vec![7; 3], samples };
        let measured_chains = ChainResults { chains: vec![futex], timer: timer(4_000), reference_timers: vec![timer(900_000)] };
        let window = Span { from_ns: span.from_ns + 500_000, to_ns: span.from_ns + 1_500_000 };
        let host = host_observations(&measured_chains, Vec::new());
        stack_results.missed.push(diagnose(0, MissKind::Unanswered, window, &TickStamps::default(), &host));
        let about = MeasurementSetup {
            scenario: "floor".to_owned(),
            seconds: 1,
            kernel: "Linux 6.1".to_owned(),
            cores: 2,
            on_cores: [Some(1), Some(1), Some(0)],
            chains_on_cores: [Some(1); 3],
            priorities: [80, 76, 78],
            load: 0,
            load_average: 0.25,
            message_bytes: [8, 16, 24],
            unix_s: 0,
        };
        BenchResults::new(about, span, stack_results, &measured_chains, &["futex".to_owned()])
    }

    #[test]
    fn ratios_divide_stack_by_chains() {
        let results = sample_results();
        let ratio = results.ratios[0].p50.map_or(0.0, |r| r.whole);
        assert!((ratio - 1.2).abs() < 0.01, "{ratio}");
        let chain = &results.chains[0];
        assert_eq!((chain.round_us.count, chain.unanswered, chain.skipped), (998, 1, 1));
        assert_eq!((results.timer_us.count, results.timer_us.max), (1, Some(4.0)));
        assert_eq!((results.missed.count, results.missed.per_100_000), (1, 100.0));
        assert_eq!(results.missed.causes, [(Cause::Steal, 0), (Cause::Machine, 1), (Cause::Stack, 0), (Cause::Unknown, 0)]);
    }
}
