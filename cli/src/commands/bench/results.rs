//! What came of a measurement: for people and, with the same content, for programs.

use super::chains::ChainResults;
use super::ticks::Figures;
use hapfic_diagnostics::cause::{Cause, Seen, Span, Verdict};
use hapfic_diagnostics::hops::PartQuantiles;
use hapfic_diagnostics::{ChainQuantiles, Distribution, Measured, Ratio};
use serde::Serialize;

/// What was measured, and where.
#[derive(Clone, Debug, Serialize)]
pub(super) struct About {
    pub(super) scenario: String,
    /// How long, s; what was before is a warm-up and does not count.
    pub(super) seconds: u64,
    /// The system's name and version.
    pub(super) kernel: String,
    /// Cores that may be used.
    pub(super) cores: usize,
    /// Cores of plant, controller and gate; none: any.
    pub(super) on_cores: [Option<u32>; 3],
    /// Those of the chains' three processes.
    pub(super) chains_on_cores: [Option<u32>; 3],
    /// Their priorities.
    pub(super) priorities: [u32; 3],
    /// Busy processes beside it.
    pub(super) load: usize,
    /// Bytes of state, request and command.
    pub(super) message_bytes: [usize; 3],
    /// When, s since the Unix epoch.
    pub(super) unix_s: u64,
}

/// A chain beside the stack's own.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Chain {
    pub(super) name: String,
    /// Message about to be sent -> answer there, us.
    pub(super) round_us: ChainQuantiles,
    /// How late its driver's timer was, us.
    pub(super) timer_us: ChainQuantiles,
    /// Messages without an answer in time.
    pub(super) unanswered: u64,
    /// Messages that were not sent, the one before having taken so long.
    pub(super) skipped: u64,
    #[serde(skip)]
    pub(super) round: Distribution,
}

/// The stack's chain over another.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Against {
    pub(super) name: String,
    pub(super) p50: Option<Ratio>,
    pub(super) p999: Option<Ratio>,
}

/// The ticks that were missed.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Misses {
    pub(super) count: u64,
    pub(super) per_100_000: f64,
    /// By cause, in the order of the rules.
    pub(super) causes: [(Cause, u64); Cause::ALL.len()],
    pub(super) list: Vec<Verdict>,
}

/// Everything there is to say.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Results {
    pub(super) about: About,
    /// Whether the run reached its end.
    pub(super) completed: bool,
    /// Ticks that were measured.
    pub(super) ticks: u64,
    /// State about to be written -> plant has the command, us.
    pub(super) stack_us: ChainQuantiles,
    /// State published -> plant has the command, us.
    pub(super) published_us: ChainQuantiles,
    /// Commands that came after the plant had stopped waiting.
    pub(super) late: u64,
    pub(super) hops_us: Vec<PartQuantiles>,
    pub(super) chains: Vec<Chain>,
    /// How late a timer at the plant's priority was, us.
    pub(super) timer_us: ChainQuantiles,
    pub(super) ratios: Vec<Against>,
    pub(super) missed: Misses,
    /// Time stolen meanwhile, ms.
    pub(super) stolen_ms: u64,
    /// Heap allocations between receiving and sending, in all processes of the stack.
    pub(super) allocations: u64,
    /// Privileges that somebody lacked.
    pub(super) not_granted: Vec<String>,
    #[serde(skip)]
    pub(super) stack: Distribution,
}

/// What the witnesses saw.
pub(super) fn seen(measured_chains: &ChainResults, stolen: Vec<(Span, u64)>) -> Seen {
    let late = |measured: &Measured| -> Vec<Span> {
        measured.samples.iter().map(|s| Span { from_ns: s.due_ns, to_ns: s.wake_ns }).collect()
    };
    let mut all: Vec<_> = measured_chains.reference_timers.iter().flat_map(late).collect();
    all.extend(late(&measured_chains.timer));
    all.sort_unstable_by_key(|span| span.from_ns);
    // What is on time is of no use, and there is much of it.
    all.retain(|span| span.to_ns - span.from_ns > hapfic_diagnostics::cause::REFERENCE_LATE_NS / 4);
    Seen { late: all, stolen }
}

impl Results {
    /// Puts it all together; `span` is the time of the measurement.
    pub(super) fn new(about: About, span: Span, figures: Figures, measured_chains: &ChainResults, names: &[String]) -> Self {
        let chains: Vec<_> =
            measured_chains.chains.iter().zip(names).map(|(measured, name)| chain(measured, name, span)).collect();
        let stack = figures.hops.chain.clone();
        let against = |chain: &Chain| Against {
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
            ticks: figures.ticks,
            stack_us: stack.quantiles(),
            published_us: figures.hops.published.quantiles(),
            late: figures.hops.late,
            hops_us: figures.hops.table(),
            ratios: chains.iter().map(against).collect(),
            chains,
            timer_us: timer.quantiles(),
            missed: Misses::new(figures.missed, figures.ticks),
            stolen_ms: 0,
            allocations: figures.allocations,
            not_granted: Vec::new(),
            stack,
        }
    }
}

impl Misses {
    fn new(list: Vec<Verdict>, ticks: u64) -> Self {
        let count = list.len() as u64;
        let causes = Cause::ALL.map(|cause| (cause, list.iter().filter(|v| v.cause == cause).count() as u64));
        Self { count, per_100_000: count as f64 * 1e5 / ticks.max(1) as f64, causes, list }
    }
}

fn share(span: Span, at_ns: u64) -> f64 {
    at_ns.saturating_sub(span.from_ns) as f64 / (span.to_ns - span.from_ns).max(1) as f64
}

fn chain(measured: &Measured, name: &str, span: Span) -> Chain {
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
    Chain { name: name.to_owned(), round_us: round.quantiles(), timer_us: timer.quantiles(), unanswered, skipped, round }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use hapfic_diagnostics::Sample;
    use hapfic_diagnostics::cause::{Missed, judge};
    use hapfic_diagnostics::hops::{Stamps, TickStamps};

    /// A thousand ticks of 60 us beside a chain of 50 us, of which one was not answered and one not sent, and one tick missed.
    pub(in super::super) fn sample_results() -> Results {
        let span = Span { from_ns: 1_000_000_000, to_ns: 2_000_000_000 };
        let mut figures = Figures { ticks: 1000, ..Figures::default() };
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
            figures.hops.push(i as f64 / 1000.0, &tick);
            samples.push(match i {
                7 => Sample { due_ns: due, ..Sample::default() },
                6 => Sample { due_ns: due, wake_ns: due + 1, sent_ns: due + 2, end_ns: 0 },
                _ => Sample { due_ns: due, wake_ns: due + 5_000, sent_ns: due + 6_000, end_ns: due + 56_000 },
            });
        }
        let timer = |late_ns: u64| Measured {
            kind: "timer".to_owned(),
            hops: 0,
            count: 1,
            granted: vec![7],
            samples: vec![Sample { due_ns: span.from_ns, wake_ns: span.from_ns + late_ns, ..Sample::default() }],
        };
        let futex = Measured { kind: "futex".to_owned(), hops: 3, count: 1000, granted: vec![7; 3], samples };
        let measured_chains = ChainResults { chains: vec![futex], timer: timer(4_000), reference_timers: vec![timer(900_000)] };
        let window = Span { from_ns: span.from_ns + 500_000, to_ns: span.from_ns + 1_500_000 };
        figures.missed.push(judge(0, Missed::Unanswered, window, &TickStamps::default(), &seen(&measured_chains, Vec::new())));
        let about = About {
            scenario: "floor".to_owned(),
            seconds: 1,
            kernel: "Linux 6.1".to_owned(),
            cores: 2,
            on_cores: [Some(1), Some(1), Some(0)],
            chains_on_cores: [Some(1); 3],
            priorities: [80, 76, 78],
            load: 0,
            message_bytes: [8, 16, 24],
            unix_s: 0,
        };
        Results::new(about, span, figures, &measured_chains, &["futex".to_owned()])
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
        assert_eq!(results.missed.causes, [(Cause::Host, 1), (Cause::Ours, 0), (Cause::Unexplained, 0)]);
    }
}
