//! Cause of a missed tick, by four rules; the first that holds decides.
//!
//! 1. `steal`: the hypervisor reported steal time while the tick was due.
//! 2. `machine`: no steal time, but a reference timer was late while the tick was due. A reference timer is a process
//!    that only waits for a timer on the stack's core, at a higher priority. Other load of this machine, its kernel or a
//!    host that reports no steal time may be the reason: the load average tells more.
//! 3. `stack`: the reference timers were on time, and a process of the stack took long from wake-up to publication, by
//!    its own stamps.
//! 4. `unknown`: none of these.

use crate::hops::TickStamps;
use serde::Serialize;
use std::fmt;

/// Lateness of a reference timer above which the machine is the cause [ns].
pub const REFERENCE_LATE_NS: u64 = 200_000;
/// Time from wake-up to publication above which the process is the cause [ns].
pub const TOOK_LONG_NS: u64 = 300_000;

/// Cause of a missed tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// Steal time by the hypervisor.
    Steal,
    /// This machine: other load, its kernel, or its host.
    Machine,
    /// The stack's own code.
    Stack,
    /// No observation explains it.
    Unknown,
}

impl Cause {
    /// All causes in the order of the rules.
    pub const ALL: [Self; 4] = [Self::Steal, Self::Machine, Self::Stack, Self::Unknown];

    /// Name in tables and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Steal => "steal",
            Self::Machine => "machine",
            Self::Stack => "stack",
            Self::Unknown => "not known",
        }
    }
}

/// Kind of a miss.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MissKind {
    /// The command was not based on a request of this tick.
    Unanswered,
    /// The plant's timer was so late that simulated time slipped.
    TimebaseSlip {
        /// Number of lost ticks.
        ticks: u64,
    },
}

/// Span of time, `CLOCK_MONOTONIC`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Span {
    /// Begin [ns].
    pub from_ns: u64,
    /// End [ns].
    pub to_ns: u64,
}

impl Span {
    fn overlaps(&self, other: &Self) -> bool {
        self.from_ns <= other.to_ns && other.from_ns <= self.to_ns
    }
}

/// Observations of the host during a measurement, in the order of time.
#[derive(Clone, Debug, Default)]
pub struct HostObservations {
    /// Late wake-ups of all reference timers, from due time to wake-up.
    pub late_timers: Vec<Span>,
    /// Spans between two polls with steal time, and that time [ms].
    pub steals: Vec<(Span, u64)>,
}

/// Evidence about a missed tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Evidence {
    /// Largest lateness of a reference timer during the tick [ns].
    pub reference_late_ns: u64,
    /// Steal time during the tick [ms].
    pub stolen_ms: u64,
    /// Process with the longest time from wake-up to publication.
    pub slowest: Option<SlowestProcess>,
    /// Lateness of the plant's timer [ns].
    pub plant_late_ns: u64,
}

/// Slowest process of a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct SlowestProcess {
    /// Name of the process.
    pub process: &'static str,
    /// Time from wake-up to publication [ns].
    pub took_ns: u64,
}

/// Diagnosis of a missed tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Diagnosis {
    /// The missed tick.
    pub tick: i64,
    /// Kind of the miss.
    pub missed: MissKind,
    /// Cause by the rules.
    pub cause: Cause,
    /// Evidence for the cause.
    pub evidence: Evidence,
}

/// Diagnoses a missed tick that was due within `window`; `stamps` are those of its processes.
#[must_use]
pub fn diagnose(tick: i64, missed: MissKind, window: Span, stamps: &TickStamps, host: &HostObservations) -> Diagnosis {
    let late = host.late_timers.iter().filter(|s| s.overlaps(&window)).map(|s| s.to_ns - s.from_ns).max();
    let stolen_ms = host.steals.iter().filter(|(span, _)| span.overlaps(&window)).map(|(_, ms)| ms).sum();
    let processes = [("plant", &stamps.plant), ("controller", &stamps.controller), ("gate", &stamps.gate)];
    let slowest = processes
        .into_iter()
        .filter_map(|(process, stamps)| Some(SlowestProcess { process, took_ns: stamps.took_ns()? }))
        .max_by_key(|slowest| slowest.took_ns);
    let evidence = Evidence {
        reference_late_ns: late.unwrap_or(0),
        stolen_ms,
        slowest,
        plant_late_ns: stamps.plant.wake_ns.saturating_sub(stamps.plant.due_ns),
    };
    let cause = if stolen_ms > 0 {
        Cause::Steal
    } else if evidence.reference_late_ns > REFERENCE_LATE_NS {
        Cause::Machine
    } else if slowest.is_some_and(|slowest| slowest.took_ns > TOOK_LONG_NS) {
        Cause::Stack
    } else {
        Cause::Unknown
    };
    Diagnosis { tick, missed, cause, evidence }
}

impl fmt::Display for Diagnosis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "tick {} ", self.tick)?;
        match self.missed {
            MissKind::Unanswered => write!(f, "unanswered")?,
            MissKind::TimebaseSlip { ticks: 1 } => write!(f, "slipped")?,
            MissKind::TimebaseSlip { ticks } => write!(f, "slipped by {ticks}")?,
        }
        let Evidence { reference_late_ns, stolen_ms, slowest, plant_late_ns } = self.evidence;
        write!(f, ": {} (reference timer {} us late, {stolen_ms} ms steal time", self.cause.name(), reference_late_ns / 1000)?;
        write!(f, ", plant's timer {} us late", plant_late_ns / 1000)?;
        match slowest {
            Some(SlowestProcess { process, took_ns }) => write!(f, ", the {process} took {} us)", took_ns / 1000),
            None => write!(f, ", no process published)"),
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

    fn late(from_us: u64, late_us: u64) -> HostObservations {
        HostObservations {
            late_timers: vec![Span { from_ns: 1000 * from_us, to_ns: 1000 * (from_us + late_us) }],
            ..HostObservations::default()
        }
    }

    fn cause(took_us: u64, host: &HostObservations) -> Cause {
        diagnose(10, MissKind::Unanswered, WINDOW, &stamps(took_us), host).cause
    }

    #[test]
    fn diagnose_late_reference_timer_within_tick_names_machine() {
        assert_eq!(cause(10, &late(10_250, 201)), Cause::Machine);
        assert_eq!(cause(900, &late(9_500, 800)), Cause::Machine, "began before the tick");
        assert_eq!(cause(10, &late(10_250, 200)), Cause::Unknown, "at the limit");
        assert_eq!(cause(10, &late(9_000, 900)), Cause::Unknown, "ended before the tick");
        assert_eq!(cause(10, &late(11_001, 900)), Cause::Unknown, "after the tick");
    }

    #[test]
    fn diagnose_steal_time_around_tick_names_steal() {
        let steal = |from_ms: u64| HostObservations {
            steals: vec![(Span { from_ns: from_ms * 1_000_000, to_ns: (from_ms + 10) * 1_000_000 }, 10)],
            ..HostObservations::default()
        };
        assert_eq!(cause(900, &steal(5)), Cause::Steal);
        assert_eq!(cause(900, &steal(12)), Cause::Stack);
    }

    #[test]
    fn diagnose_reference_timers_on_time_is_stack_or_unknown() {
        assert_eq!(cause(301, &late(10_250, 20)), Cause::Stack);
        assert_eq!(cause(300, &late(10_250, 20)), Cause::Unknown);
        let diagnosis = diagnose(7, MissKind::TimebaseSlip { ticks: 2 }, WINDOW, &stamps(301), &HostObservations::default());
        assert_eq!(
            diagnosis.to_string(),
            "tick 7 slipped by 2: stack (reference timer 0 us late, 0 ms steal time, plant's timer 50 us late, \
             the controller took 301 us)"
        );
        let unknown = diagnose(7, MissKind::Unanswered, WINDOW, &TickStamps::default(), &HostObservations::default());
        assert_eq!((unknown.cause, unknown.evidence.slowest), (Cause::Unknown, None));
    }
}
