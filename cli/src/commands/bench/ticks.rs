//! What a log says of each tick.

use anyhow::Result;
use hapfic_diagnostics::cause::{Missed, Seen, Span, Verdict, judge};
use hapfic_diagnostics::hops::{Hops, Stamps, TickStamps};
use hapfic_log::{Reader, Record, proto};
use hapfic_messages::{Mode, PERIOD_NS, Phase, Process, Source};
use std::collections::BTreeMap;
use std::path::Path;

/// All ticks of a run.
#[derive(Debug, Default)]
pub(super) struct Ticks(BTreeMap<i64, Row>);

/// What is known of a tick.
#[derive(Debug, Default)]
struct Row {
    plant: Stamps,
    controllers: [Stamps; 2],
    gate: Stamps,
    allocations: u64,
    slipped: u64,
    command: Option<Command>,
}

#[derive(Clone, Copy, Debug)]
struct Command {
    /// A request of this tick stands behind it.
    answered: bool,
    /// Nothing was commanded yet.
    held: bool,
    standby: bool,
}

/// The stack's figures.
#[derive(Debug, Default)]
pub(super) struct Figures {
    /// Ticks of the measurement.
    pub(super) ticks: u64,
    pub(super) hops: Hops,
    /// Those that were missed, and why.
    pub(super) missed: Vec<Verdict>,
    /// Heap allocations between receiving and sending, in all processes.
    pub(super) allocations: u64,
}

impl Ticks {
    /// Reads a log.
    pub(super) fn read(log: &Path) -> Result<Self> {
        let mut ticks = Self::default();
        for entry in Reader::open(log)? {
            ticks.take(&entry?.record);
        }
        Ok(ticks)
    }

    fn take(&mut self, record: &Record) {
        match record {
            Record::State(state) => self.0.entry(state.tick).or_default().slipped = state.slipped,
            Record::Command(command) => {
                self.0.entry(command.tick).or_default().command = Some(Command {
                    answered: command.source == Source::Fresh.name() || command.source == Source::Suppressed.name(),
                    held: command.mode == Mode::Hold.name(),
                    standby: command.controller == Process::Standby.name(),
                });
            }
            Record::Timing(timing) if timing.phase == Phase::Running.name() => self.time(timing),
            _ => {}
        }
    }

    fn time(&mut self, timing: &proto::Timing) {
        let row = self.0.entry(timing.tick).or_default();
        let stamps = Stamps {
            due_ns: timing.due_ns,
            wake_ns: timing.wake_ns,
            publish_ns: timing.publish_ns,
            latency_ns: timing.latency_ns,
        };
        let name = timing.process.as_str();
        let [primary, standby] = &mut row.controllers;
        let places = [
            (Process::Plant, &mut row.plant),
            (Process::Controller, primary),
            (Process::Standby, standby),
            (Process::Supervisor, &mut row.gate),
        ];
        if let Some((_, place)) = places.into_iter().find(|(process, _)| process.name() == name) {
            *place = stamps;
            row.allocations += u64::from(timing.allocations);
        }
    }

    /// The figures of the ticks that were due within a span; `seen` is what the witnesses saw.
    pub(super) fn figures(&self, span: Span, seen: &Seen) -> Figures {
        let mut figures = Figures::default();
        let mut slipped = None;
        for (tick, row) in &self.0 {
            let before = slipped.replace(row.slipped).unwrap_or(row.slipped);
            let due = row.plant.due_ns;
            if due < span.from_ns || due >= span.to_ns {
                continue;
            }
            let share = (due - span.from_ns) as f64 / (span.to_ns - span.from_ns) as f64;
            figures.ticks += 1;
            figures.allocations += row.allocations;
            let standby = row.command.is_some_and(|c| c.standby);
            let stamps = TickStamps { plant: row.plant, controller: row.controllers[usize::from(standby)], gate: row.gate };
            if row.slipped > before {
                let late = Span { from_ns: due, to_ns: row.plant.wake_ns };
                let missed = Missed::TimebaseSlip { ticks: row.slipped - before };
                figures.missed.push(judge(*tick, missed, late, &stamps, seen));
            }
            match row.command {
                Some(command) if command.answered => figures.hops.push(share, &stamps),
                Some(command) if command.held => {}
                _ => {
                    let to_ns = row.gate.publish_ns.max(due + PERIOD_NS);
                    let window = Span { from_ns: due, to_ns };
                    figures.missed.push(judge(*tick, Missed::Unanswered, window, &stamps, seen));
                }
            }
        }
        figures
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

    /// Ten ticks; the standby answers tick 4 after its primary, tick 6 has a repeated command, at tick 8 time slips by two.
    fn ticks() -> Ticks {
        let mut ticks = Ticks::default();
        for tick in 0..10 {
            let slipped = if tick < 8 { 0 } else { 2 };
            ticks.take(&Record::State(proto::State { tick, slipped, ..proto::State::default() }));
            ticks.take(&timing(Process::Plant, tick, [0, 4, 10], 60));
            ticks.take(&timing(Process::Controller, tick, [8, 20, if tick == 6 { 520 } else { 30 }], 0));
            ticks.take(&timing(Process::Standby, tick, [8, 20, 40], 0));
            ticks.take(&timing(Process::Supervisor, tick, [8, 45, 50], 42));
            let controller = if tick == 4 { Process::Standby } else { Process::Controller };
            let source = if tick == 6 { Source::Repeated } else { Source::Fresh };
            ticks.take(&Record::Command(proto::Command {
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
    fn a_log_gives_hops_and_what_was_missed() {
        let all = Span { from_ns: BEGIN, to_ns: BEGIN + 10 * PERIOD_NS };
        let figures = ticks().figures(all, &Seen::default());
        assert_eq!((figures.ticks, figures.allocations, figures.hops.chain.count()), (10, 40, 9));
        let works = figures.hops.part(hapfic_diagnostics::hops::Part::ControllerWorks).quantiles();
        assert_eq!(works.max, Some(20.0), "the standby's, at the tick that it answered");
        let missed: Vec<_> = figures.missed.iter().map(|v| (v.tick, v.missed, v.cause)).collect();
        assert_eq!(missed, [(6, Missed::Unanswered, Cause::Ours), (8, Missed::TimebaseSlip { ticks: 2 }, Cause::Unexplained)]);
    }

    #[test]
    fn only_the_measurement_counts() {
        let part = Span { from_ns: BEGIN + 2 * PERIOD_NS, to_ns: BEGIN + 5 * PERIOD_NS };
        let figures = ticks().figures(part, &Seen::default());
        assert_eq!((figures.ticks, figures.hops.chain.count(), figures.missed.len()), (3, 3, 0));
    }
}
