//! Evaluation of the ticks in a log.

use anyhow::Result;
use hapfic_diagnostics::cause::{Diagnosis, HostObservations, MissKind, Span, diagnose};
use hapfic_diagnostics::hops::{HopDurations, Stamps, TickStamps};
use hapfic_log::{Reader, Record, proto};
use hapfic_messages::{Mode, PERIOD_NS, Phase, Process, Source};
use std::collections::BTreeMap;
use std::path::Path;

/// Records of all ticks of a run.
#[derive(Debug, Default)]
pub(super) struct Ticks(BTreeMap<i64, TickRecord>);

/// Record of a tick.
#[derive(Debug, Default)]
struct TickRecord {
    plant: Stamps,
    controllers: [Stamps; 2],
    gate: Stamps,
    allocations: u64,
    slipped: u64,
    command: Option<CommandRecord>,
}

/// Origin of a command.
#[derive(Clone, Copy, Debug)]
struct CommandRecord {
    /// The command is based on a request of this tick.
    answered: bool,
    /// The gate still holds, before the first torque.
    held: bool,
    /// The request came from the standby controller.
    standby: bool,
}

/// Results of the stack.
#[derive(Debug, Default)]
pub(super) struct StackResults {
    /// Number of ticks of the measurement.
    pub(super) ticks: u64,
    pub(super) hops: HopDurations,
    /// Diagnoses of the missed ticks.
    pub(super) missed: Vec<Diagnosis>,
    /// Number of heap allocations between receiving and sending, in all processes.
    pub(super) allocations: u64,
}

impl Ticks {
    /// Reads a log.
    pub(super) fn read(log: &Path) -> Result<Self> {
        let mut ticks = Self::default();
        for entry in Reader::open(log)? {
            ticks.add(&entry?.record);
        }
        Ok(ticks)
    }

    fn add(&mut self, record: &Record) {
        match record {
            Record::State(state) => self.0.entry(state.tick).or_default().slipped = state.slipped,
            Record::Command(command) => {
                self.0.entry(command.tick).or_default().command = Some(CommandRecord {
                    answered: command.source == Source::Fresh.name() || command.source == Source::Suppressed.name(),
                    held: command.mode == Mode::Hold.name(),
                    standby: command.controller == Process::Standby.name(),
                });
            }
            Record::Timing(timing) if timing.phase == Phase::Running.name() => self.add_timing(timing),
            _ => {}
        }
    }

    fn add_timing(&mut self, timing: &proto::Timing) {
        let record = self.0.entry(timing.tick).or_default();
        let stamps = Stamps {
            due_ns: timing.due_ns,
            wake_ns: timing.wake_ns,
            publish_ns: timing.publish_ns,
            latency_ns: timing.latency_ns,
        };
        let name = timing.process.as_str();
        let [primary, standby] = &mut record.controllers;
        let processes = [
            (Process::Plant, &mut record.plant),
            (Process::Controller, primary),
            (Process::Standby, standby),
            (Process::Gate, &mut record.gate),
        ];
        if let Some((_, entry)) = processes.into_iter().find(|(process, _)| process.name() == name) {
            *entry = stamps;
            record.allocations += u64::from(timing.allocations);
        }
    }

    /// Evaluates the ticks that were due within a span.
    pub(super) fn evaluate(&self, span: Span, host: &HostObservations) -> StackResults {
        let mut results = StackResults::default();
        let mut slipped = None;
        for (tick, record) in &self.0 {
            let before = slipped.replace(record.slipped).unwrap_or(record.slipped);
            let due = record.plant.due_ns;
            if due < span.from_ns || due >= span.to_ns {
                continue;
            }
            let share = (due - span.from_ns) as f64 / (span.to_ns - span.from_ns) as f64;
            results.ticks += 1;
            results.allocations += record.allocations;
            let standby = record.command.is_some_and(|c| c.standby);
            let controller = record.controllers[usize::from(standby)];
            let stamps = TickStamps { plant: record.plant, controller, gate: record.gate };
            if record.slipped > before {
                let late = Span { from_ns: due, to_ns: record.plant.wake_ns };
                let missed = MissKind::TimebaseSlip { ticks: record.slipped - before };
                results.missed.push(diagnose(*tick, missed, late, &stamps, host));
            }
            match record.command {
                Some(command) if command.answered => results.hops.push(share, &stamps),
                Some(command) if command.held => {}
                _ => {
                    let to_ns = record.gate.publish_ns.max(due + PERIOD_NS);
                    let window = Span { from_ns: due, to_ns };
                    results.missed.push(diagnose(*tick, MissKind::Unanswered, window, &stamps, host));
                }
            }
        }
        results
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hapfic_diagnostics::cause::Cause;

    const BEGIN: u64 = 1_000_000_000;

    fn timing(process: Process, tick: i64, at_us: [u64; 3], latency_us: u64) -> Record {
        let ns = |us: u64| BEGIN + tick as u64 * PERIOD_NS + us * 1000;
        Record::Timing(proto::Timing {
            tick,
            process: process.name().to_owned(),
            phase: Phase::Running.name().to_owned(),
            due_ns: ns(at_us[0]),
            wake_ns: ns(at_us[1]),
            publish_ns: ns(at_us[2]),
            latency_ns: latency_us * 1000,
            allocations: 1,
            ..proto::Timing::default()
        })
    }

    /// Ten ticks: the standby answers tick 4 after its primary, tick 6 has a repeated command, tick 8 slips by two.
    fn ticks() -> Ticks {
        let mut ticks = Ticks::default();
        for tick in 0..10 {
            let slipped = if tick < 8 { 0 } else { 2 };
            ticks.add(&Record::State(proto::State { tick, slipped, ..proto::State::default() }));
            ticks.add(&timing(Process::Plant, tick, [0, 4, 10], 60));
            ticks.add(&timing(Process::Controller, tick, [8, 20, if tick == 6 { 520 } else { 30 }], 0));
            ticks.add(&timing(Process::Standby, tick, [8, 20, 40], 0));
            ticks.add(&timing(Process::Gate, tick, [8, 45, 50], 42));
            let controller = if tick == 4 { Process::Standby } else { Process::Controller };
            let source = if tick == 6 { Source::Repeated } else { Source::Fresh };
            ticks.add(&Record::Command(proto::Command {
                tick,
                controller: controller.name().to_owned(),
                source: source.name().to_owned(),
                mode: Mode::Active.name().to_owned(),
                ..proto::Command::default()
            }));
        }
        ticks
    }

    #[test]
    fn evaluate_log_has_hops_and_misses() {
        let all = Span { from_ns: BEGIN, to_ns: BEGIN + 10 * PERIOD_NS };
        let results = ticks().evaluate(all, &HostObservations::default());
        assert_eq!((results.ticks, results.allocations, results.hops.chain.count()), (10, 40, 9));
        let works = results.hops.hop(hapfic_diagnostics::hops::Hop::ControllerWorks).quantiles();
        assert_eq!(works.max, Some(20.0), "the standby, at the tick that it answered");
        let missed: Vec<_> = results.missed.iter().map(|d| (d.tick, d.missed, d.cause)).collect();
        let slip = MissKind::TimebaseSlip { ticks: 2 };
        assert_eq!(missed, [(6, MissKind::Unanswered, Cause::Stack), (8, slip, Cause::Unknown)]);
    }

    #[test]
    fn evaluate_ticks_outside_span_are_ignored() {
        let part = Span { from_ns: BEGIN + 2 * PERIOD_NS, to_ns: BEGIN + 5 * PERIOD_NS };
        let results = ticks().evaluate(part, &HostObservations::default());
        assert_eq!((results.ticks, results.hops.chain.count(), results.missed.len()), (3, 3, 0));
    }
}
