//! Trace of a run: its log, tick by tick.

use hapfic_log::{Reader, Record};
use hapfic_messages::{EventKind, Mode, Phase, Process, Source};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

/// Largest plausible number of ticks.
const MAX_TICKS: i64 = 10_000_000;
/// Lateness of the plant's timer above which the tick counts as steal time [ns].
const STEAL_LATENESS_NS: u64 = 500_000;

/// Fields of a command that the measurements need.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TraceCommand {
    pub(crate) mode: Option<Mode>,
    pub(crate) source: Option<Source>,
    /// Controller of the accepted request.
    pub(crate) controller: Option<Process>,
    /// Torque to the drive [N m].
    pub(crate) torque: Vec<f64>,
    /// Requested torque [N m].
    pub(crate) raw: Vec<f64>,
    /// Joints with an active rate limit, a bit each.
    pub(crate) ramped: u32,
}

impl TraceCommand {
    /// Whether the torque is that of a request of the same tick.
    pub(crate) fn fresh(&self) -> bool {
        self.active() && self.source == Some(Source::Fresh)
    }

    /// Whether the drive applies a torque.
    pub(crate) fn active(&self) -> bool {
        self.mode == Some(Mode::Active)
    }

    /// Whether the drive brakes.
    pub(crate) fn brakes(&self) -> bool {
        matches!(self.mode, Some(Mode::Brake | Mode::Stopped))
    }

    /// Whether a valid request arrived, passed on or suppressed.
    pub(crate) fn answered(&self) -> bool {
        matches!(self.source, Some(Source::Fresh | Source::Suppressed))
    }
}

/// Logged data of a tick.
#[derive(Clone, Debug, Default)]
pub(crate) struct TraceTick {
    pub(crate) command: Option<TraceCommand>,
    /// Position of the foot [m].
    pub(crate) foot: Option<[f64; 3]>,
    /// Reference position [m].
    pub(crate) reference: Option<[f64; 3]>,
    /// Whether a force acts on the foot.
    pub(crate) in_contact: bool,
    /// Lateness of the plant's timer [ns].
    pub(crate) timer_lateness_ns: u64,
    /// Slipped periods since the start.
    pub(crate) slipped: u64,
    /// Publication time of the command on `CLOCK_MONOTONIC` [ns].
    pub(crate) command_ns: Option<u64>,
    /// Processes that have done the tick, a bit each by their codes.
    pub(crate) done_by: u32,
}

/// Event of a run.
#[derive(Clone, Debug)]
pub(crate) struct TraceEvent {
    pub(crate) tick: i64,
    pub(crate) kind: Option<EventKind>,
}

/// Logged data of a run.
#[derive(Debug, Default)]
pub(crate) struct Trace {
    pub(crate) ticks: Vec<TraceTick>,
    pub(crate) events: Vec<TraceEvent>,
    /// Rejected messages, by process and generation.
    pub(crate) rejected: BTreeMap<(String, u32), u32>,
    /// Error of the log.
    pub(crate) error: Option<String>,
    /// First tick with a torque.
    pub(crate) first: usize,
}

impl Trace {
    /// Reads all parts of a log, each up to its first error.
    pub(crate) fn read(log: &Path) -> Self {
        let mut trace = Self::default();
        for part in hapfic_log::parts(log) {
            match Reader::open(&part) {
                Ok(reader) => {
                    for entry in reader {
                        match entry {
                            Ok(entry) => trace.add(entry.record),
                            Err(error) => trace.error = Some(error.to_string()),
                        }
                    }
                }
                Err(error) => trace.error = Some(error.to_string()),
            }
        }
        let active = |tick: &TraceTick| tick.command.as_ref().is_some_and(TraceCommand::active);
        trace.first = trace.ticks.iter().position(active).unwrap_or(trace.ticks.len());
        trace
    }

    fn tick_mut(&mut self, tick: i64) -> Option<&mut TraceTick> {
        let index = usize::try_from(tick).ok().filter(|_| tick < MAX_TICKS)?;
        if self.ticks.len() <= index {
            self.ticks.resize_with(index + 1, TraceTick::default);
        }
        self.ticks.get_mut(index)
    }

    fn add(&mut self, record: Record) {
        match record {
            Record::State(state) => {
                if let Some(tick) = self.tick_mut(state.tick)
                    && tick.foot.is_none()
                {
                    tick.foot = state.foot_position.try_into().ok();
                    tick.in_contact = state.foot_force.iter().any(|force| *force != 0.0);
                    (tick.timer_lateness_ns, tick.slipped) = (state.wake_lateness_ns, state.slipped);
                }
            }
            Record::Reference(reference) => {
                if let Some(tick) = self.tick_mut(reference.tick)
                    && tick.reference.is_none()
                {
                    tick.reference = reference.position.try_into().ok();
                }
            }
            Record::Command(command) => {
                if let Some(tick) = self.tick_mut(command.tick)
                    && tick.command.is_none()
                {
                    tick.command = Some(TraceCommand {
                        mode: Mode::from_name(&command.mode),
                        source: Source::from_name(&command.source),
                        controller: Process::from_name(&command.controller),
                        torque: command.torque,
                        raw: command.torque_raw,
                        ramped: command.ramped,
                    });
                }
            }
            Record::Timing(timing) => {
                let rejected = self.rejected.entry((timing.process.clone(), timing.generation)).or_default();
                *rejected = timing.rejected.max(*rejected);
                if timing.phase == Phase::Running.name()
                    && timing.publish_ns > 0
                    && let Some(process) = Process::from_name(&timing.process)
                    && let Some(tick) = self.tick_mut(timing.tick)
                {
                    tick.done_by |= 1 << process.code();
                    if process == Process::Gate {
                        tick.command_ns.get_or_insert(timing.publish_ns);
                    }
                }
            }
            Record::Event(event) => {
                self.events.push(TraceEvent { tick: event.tick, kind: EventKind::from_name(&event.kind) });
            }
            _ => {}
        }
    }

    pub(crate) fn command(&self, tick: usize) -> Option<&TraceCommand> {
        self.ticks.get(tick)?.command.as_ref()
    }

    /// Last tick of `ticks` that one of these processes has done.
    pub(crate) fn last_done(&self, processes: &[Process], ticks: Range<usize>) -> Option<usize> {
        let bits = processes.iter().fold(0_u32, |bits, process| bits | (1 << process.code()));
        ticks.rev().find(|tick| self.ticks.get(*tick).is_some_and(|tick| tick.done_by & bits != 0))
    }

    /// Last tick with a command.
    pub(crate) fn last(&self) -> Option<usize> {
        self.ticks.iter().rposition(|tick| tick.command.is_some())
    }

    /// Number of ticks of `0..count` without state or command.
    pub(crate) fn missing(&self, count: usize) -> usize {
        count - self.ticks.iter().take(count).filter(|tick| tick.foot.is_some() && tick.command.is_some()).count()
    }

    /// Ranges of consecutive ticks without fresh torque, after the first tick with it.
    pub(crate) fn outages(&self) -> Vec<Range<usize>> {
        let mut outages: Vec<Range<usize>> = Vec::new();
        for tick in self.first..self.ticks.len() {
            if self.command(tick).is_none_or(TraceCommand::fresh) {
                continue;
            }
            match outages.last_mut() {
                Some(last) if last.end == tick => last.end += 1,
                _ => outages.push(tick..tick + 1),
            }
        }
        outages
    }

    /// Whether steal time explains an outage: the plant's own timer was late around its first tick.
    pub(crate) fn is_steal_time(&self, outage: &Range<usize>) -> bool {
        let from = outage.start.saturating_sub(1);
        let to = (outage.start + 2).min(self.ticks.len());
        let slipped = |tick: usize| self.ticks[tick].slipped;
        (from..to).any(|tick| self.ticks[tick].timer_lateness_ns > STEAL_LATENESS_NS)
            || (from + 1..to).any(|tick| slipped(tick) > slipped(tick - 1))
    }

    /// Events of a kind.
    pub(crate) fn events(&self, kind: EventKind) -> impl Iterator<Item = &TraceEvent> {
        self.events.iter().filter(move |event| event.kind == Some(kind))
    }

    /// Number of rejected messages of all processes.
    pub(crate) fn rejected(&self) -> u32 {
        self.rejected.values().sum()
    }
}
