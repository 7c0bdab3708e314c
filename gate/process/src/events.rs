//! Events of the gate: written without heap, sent in idle time.

use crate::node::{GateNode, REPORTED_ONE_BY_ONE};
use hapfic_gate::protocol::ControllerSlot;
use hapfic_ipc::{IpcError, clock};
use hapfic_messages::{Clock, Command, Detector, Event, EventKind, Mode, Process, Severity, Source};

impl GateNode {
    /// Reports all events of a tick, after its command has gone out.
    pub(super) fn report_all(
        &mut self,
        command: &Command,
        severity_before: u32,
        announced: Option<(u64, i64)>,
    ) -> Result<(), IpcError> {
        if let Some(defect) = self.rejections.state.take() {
            self.report(Process::Plant, EventKind::Rejected, Detector::Check, |text| write!(text, "state rejected: {defect}"))?;
        }
        if let Some(defect) = self.rejections.stray.take() {
            self.report(Process::Gate, EventKind::Rejected, Detector::Check, |text| write!(text, "request rejected: {defect}"))?;
        }
        for slot in ControllerSlot::BOTH {
            if let Some(defect) = self.rejections.slots[slot as usize].take() {
                self.report(slot.process(), EventKind::Rejected, Detector::Check, |text| {
                    write!(text, "request rejected: {defect}")
                })?;
            }
        }
        self.report_slip()?;
        if let Some((version, from)) = announced {
            self.report_parameters(version, from)?;
        }
        if (command.limited == 0) != (self.reported.limited == 0) {
            self.report_limited(command)?;
        }
        self.reported.limited = command.limited;
        if let Some(step) = self.gate.discontinuity() {
            self.report(Process::Gate, EventKind::Discontinuity, Detector::Check, |text| {
                write!(text, "torque of joint {} steps by {:.3} N m", step.joint, step.size)
            })?;
        }
        self.report_missed(command)?;
        if let Some(slot) = self.reported.promoted.take() {
            self.report(slot.process(), EventKind::Promoted, Detector::Deadline, |text| {
                write!(text, "{} is the primary controller from tick {}", slot.process(), command.tick)
            })?;
        }
        if command.severity != severity_before {
            self.report_transition(severity_before, command.severity)?;
        }
        Ok(())
    }

    /// Reports missed ticks: the first ones each, the others together.
    fn report_missed(&mut self, command: &Command) -> Result<(), IpcError> {
        let tick = command.tick;
        let answered = command.source == Source::Fresh.code() || command.source == Source::Suppressed.code();
        if answered {
            let missed = std::mem::take(&mut self.reported.missed);
            if missed > REPORTED_ONE_BY_ONE {
                self.report(Process::Controller, EventKind::Note, Detector::Deadline, |text| {
                    write!(text, "requests are back at tick {tick}, after {missed} ticks without any")
                })?;
            }
            return Ok(());
        }
        if command.mode == Mode::Hold.code() {
            return Ok(());
        }
        self.reported.missed += 1;
        if self.reported.missed > REPORTED_ONE_BY_ONE {
            return Ok(());
        }
        self.report(Process::Controller, EventKind::Missed, Detector::Deadline, |text| {
            write!(text, "no valid request for tick {tick} by the deadline")
        })
    }

    /// Reports slipped time, if it has grown.
    pub(super) fn report_slip(&mut self) -> Result<(), IpcError> {
        let (before, (now, late_ns)) = (self.reported.slipped, self.received.slip);
        if before == u64::MAX && self.received.newest.is_some_and(|(tick, _)| Some(tick) > self.received.resumed) {
            // The gate before has reported them.
            self.reported.slipped = now;
        }
        if now <= before {
            return Ok(());
        }
        self.reported.slipped = now;
        let late_us = late_ns / 1000;
        self.report(Process::Plant, EventKind::TimebaseSlip, Detector::Tick, |text| {
            write!(text, "timer {late_us} us late, simulated time slipped by {} ticks", now - before)
        })
    }

    pub(super) fn report_parameters(&mut self, version: u64, from: i64) -> Result<(), IpcError> {
        self.report(Process::Gate, EventKind::Parameters, Detector::None, |text| {
            write!(text, "parameters {version} in force from tick {from}")
        })
    }

    pub(super) fn report_limited(&mut self, command: &Command) -> Result<(), IpcError> {
        let limited = command.limited;
        self.report(Process::Gate, EventKind::Limited, Detector::None, |text| match limited {
            0 => write!(text, "no torque is limited any more"),
            bits => write!(text, "the peak limits the torque of joints {bits:#b} (a bit each, the first joint last)"),
        })
    }

    pub(super) fn report_transition(&mut self, from: u32, to: u32) -> Result<(), IpcError> {
        let name = |code| Severity::from_code(code).map_or("?", Severity::name);
        let stop_by = Detector::from_code(self.start.shared.orders.stop_by.load(std::sync::atomic::Ordering::Relaxed));
        let detector = match Severity::from_code(to) {
            Some(Severity::Stopped) => stop_by.unwrap_or(Detector::Operator),
            _ if from == Severity::Stopped.code() => Detector::Operator,
            _ => Detector::Deadline,
        };
        if from == Severity::Stopped.code() {
            self.report(Process::Gate, EventKind::Rearmed, Detector::Operator, |text| {
                write!(text, "re-armed by the operator: starts from the foot's position, the torque ramps in")
            })?;
        }
        self.report(Process::Gate, EventKind::Transition, detector, |text| {
            write!(text, "severity {} -> {}", name(from), name(to))
        })
    }

    /// Sends an event with a text written without heap.
    pub(super) fn report(
        &mut self,
        process: Process,
        kind: EventKind,
        detector: Detector,
        write: impl FnOnce(&mut EventText) -> std::fmt::Result,
    ) -> Result<(), IpcError> {
        let mut text = EventText::default();
        // A text that is too long is cut.
        let _ = write(&mut text);
        let event = Event::new(self.gate.last().tick, process, kind, self.gate.severity(), detector, text.as_str());
        let stamp_ns = if self.start.clock == Clock::Realtime { clock::now_ns() } else { 0 };
        self.ports.event.send(&Event { stamp_ns, ..event })?;
        Ok(())
    }
}

/// Text of bounded length on the stack.
#[derive(Default)]
pub(super) struct EventText {
    bytes: arrayvec::ArrayString<{ hapfic_messages::EVENT_TEXT }>,
}

impl EventText {
    pub(super) fn as_str(&self) -> &str {
        &self.bytes
    }

    pub(super) fn write_fmt(&mut self, arguments: std::fmt::Arguments<'_>) -> std::fmt::Result {
        std::fmt::Write::write_fmt(&mut self.bytes, arguments)
    }
}
