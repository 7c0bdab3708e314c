//! Why a tick was missed: one cause for each, by rules that are written down here.
//!
//! 1. `host`: a witness, which does nothing but wait for a timer on the stack's core, was late while the tick was due; or the
//!    machine was taken away (steal) then.
//! 2. `ours`: the witnesses were on time, and a process of the stack took long between waking up and publishing, by its own stamps.
//! 3. `unexplained`: neither.

use crate::hops::TickStamps;
use serde::Serialize;
use std::fmt;

/// A witness later than this tells of the host, ns.
pub const REFERENCE_LATE_NS: u64 = 200_000;
/// A process that takes longer than this between waking up and publishing is to blame itself, ns.
pub const TOOK_LONG_NS: u64 = 300_000;

/// Why.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The machine, or who runs it.
    Host,
    /// The stack's own code.
    Ours,
    /// Nothing that was looked at tells.
    Unexplained,
}

impl Cause {
    /// In the order of the rules.
    pub const ALL: [Self; 3] = [Self::Host, Self::Ours, Self::Unexplained];

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Host => "host",
            Self::Ours => "ours",
            Self::Unexplained => "unexplained",
        }
    }
}

/// How a tick was missed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Missed {
    /// The command had no request of this tick behind it.
    Unanswered,
    /// The plant's timer was so late that simulated time slipped, by so many ticks.
    TimebaseSlip {
        /// How many.
        ticks: u64,
    },
}

/// A span of time, ns of `CLOCK_MONOTONIC`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Span {
    /// From.
    pub from_ns: u64,
    /// To.
    pub to_ns: u64,
}

impl Span {
    fn meets(&self, other: &Self) -> bool {
        self.from_ns <= other.to_ns && other.from_ns <= self.to_ns
    }
}

/// What was seen from outside.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// The late timers of all witnesses: from when each was due to when it woke, in the order of time.
    pub late: Vec<Span>,
    /// When the machine was taken away: from one look to the next, and for how long, ms; in the order of time.
    pub stolen: Vec<(Span, u64)>,
}

/// What there is to say of a missed tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Evidence {
    /// The latest witness meanwhile, ns.
    pub reference_late_ns: u64,
    /// Time stolen meanwhile, ms.
    pub stolen_ms: u64,
    /// Who took longest between waking up and publishing.
    pub slowest: Option<Slowest>,
    /// How late the plant's timer was, ns.
    pub plant_late_ns: u64,
}

/// Who took longest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Slowest {
    /// The process.
    pub process: &'static str,
    /// How long, ns.
    pub took_ns: u64,
}

/// A missed tick, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Verdict {
    /// Which.
    pub tick: i64,
    /// How.
    pub missed: Missed,
    /// Why.
    pub cause: Cause,
    /// By what.
    pub evidence: Evidence,
}

/// Judges a missed tick that was due within `window`; `stamps` are those of its processes.
#[must_use]
pub fn judge(tick: i64, missed: Missed, window: Span, stamps: &TickStamps, seen: &Seen) -> Verdict {
    let met = |spans: &[Span]| spans.iter().filter(|s| s.meets(&window)).map(|s| s.to_ns - s.from_ns).max().unwrap_or(0);
    let stolen_ms = seen.stolen.iter().filter(|(span, _)| span.meets(&window)).map(|(_, ms)| ms).sum();
    let processes = [("plant", &stamps.plant), ("controller", &stamps.controller), ("gate", &stamps.gate)];
    let slowest = processes
        .into_iter()
        .filter_map(|(process, stamps)| Some(Slowest { process, took_ns: stamps.took_ns()? }))
        .max_by_key(|slowest| slowest.took_ns);
    let evidence = Evidence {
        reference_late_ns: met(&seen.late),
        stolen_ms,
        slowest,
        plant_late_ns: stamps.plant.wake_ns.saturating_sub(stamps.plant.due_ns),
    };
    let cause = if evidence.reference_late_ns > REFERENCE_LATE_NS || stolen_ms > 0 {
        Cause::Host
    } else if slowest.is_some_and(|slowest| slowest.took_ns > TOOK_LONG_NS) {
        Cause::Ours
    } else {
        Cause::Unexplained
    };
    Verdict { tick, missed, cause, evidence }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "tick {} ", self.tick)?;
        match self.missed {
            Missed::Unanswered => write!(f, "unanswered")?,
            Missed::TimebaseSlip { ticks: 1 } => write!(f, "slipped")?,
            Missed::TimebaseSlip { ticks } => write!(f, "slipped by {ticks}")?,
        }
        let Evidence { reference_late_ns, stolen_ms, slowest, plant_late_ns } = self.evidence;
        write!(f, ": {} (witness {} us late, {stolen_ms} ms stolen", self.cause.name(), reference_late_ns / 1000)?;
        write!(f, ", plant's timer {} us late", plant_late_ns / 1000)?;
        match slowest {
            Some(Slowest { process, took_ns }) => write!(f, ", the {process} took {} us)", took_ns / 1000),
            None => write!(f, ", nobody published)"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hops::Stamps;

    const WINDOW: Span = Span { from_ns: 10_000_000, to_ns: 11_000_000 };

    fn stamps(took_us: u64) -> TickStamps {
        let at = |took_us: u64| Stamps {
            due_ns: 10_000_000,
            wake_ns: 10_050_000,
            publish_ns: 10_050_000 + 1000 * took_us,
            latency_ns: 0,
        };
        TickStamps { plant: at(5), controller: at(took_us), gate: Stamps::default() }
    }

    fn late(from_us: u64, late_us: u64) -> Seen {
        Seen { late: vec![Span { from_ns: 1000 * from_us, to_ns: 1000 * (from_us + late_us) }], stolen: Vec::new() }
    }

    fn cause(took_us: u64, seen: &Seen) -> Cause {
        judge(10, Missed::Unanswered, WINDOW, &stamps(took_us), seen).cause
    }

    #[test]
    fn a_late_witness_within_the_tick_tells_of_the_host() {
        assert_eq!(cause(10, &late(10_250, 201)), Cause::Host);
        assert_eq!(cause(900, &late(9_500, 800)), Cause::Host, "it began before the tick");
        assert_eq!(cause(10, &late(10_250, 200)), Cause::Unexplained, "late, but not very");
        assert_eq!(cause(10, &late(9_000, 900)), Cause::Unexplained, "over before the tick");
        assert_eq!(cause(10, &late(11_001, 900)), Cause::Unexplained, "after the tick");
    }

    #[test]
    fn stolen_time_around_the_tick_tells_of_the_host() {
        let stolen = |from_ms: u64| Seen {
            stolen: vec![(Span { from_ns: from_ms * 1_000_000, to_ns: (from_ms + 10) * 1_000_000 }, 10)],
            ..Seen::default()
        };
        assert_eq!(cause(900, &stolen(5)), Cause::Host);
        assert_eq!(cause(900, &stolen(12)), Cause::Ours);
    }

    #[test]
    fn with_the_witnesses_on_time_it_is_ours_by_our_own_stamps_or_unexplained() {
        assert_eq!(cause(301, &late(10_250, 20)), Cause::Ours);
        assert_eq!(cause(300, &late(10_250, 20)), Cause::Unexplained);
        let verdict = judge(7, Missed::TimebaseSlip { ticks: 2 }, WINDOW, &stamps(301), &Seen::default());
        assert_eq!(
            verdict.to_string(),
            "tick 7 slipped by 2: ours (witness 0 us late, 0 ms stolen, plant's timer 50 us late, the controller took 301 us)"
        );
        let nothing = judge(7, Missed::Unanswered, WINDOW, &TickStamps::default(), &Seen::default());
        assert_eq!((nothing.cause, nothing.evidence.slowest), (Cause::Unexplained, None));
    }
}
