//! What the gate tells of: events, written without touching the heap, sent in the slack.

use super::thread::Gateway;
use hapfic_ipc::message::{Command, Detector, Event, EventKind, Process, Severity};
use hapfic_ipc::{Clock, IpcError, clock};

impl Gateway {
    /// Time that slipped, once it has grown.
    pub(super) fn tell_slip(&mut self) -> Result<(), IpcError> {
        let (before, (now, late_ns)) = (self.slipped, self.slip);
        if now <= before {
            return Ok(());
        }
        self.slipped = now;
        let late_us = late_ns / 1000;
        self.tell(Process::Plant, EventKind::Slipped, Detector::Tick, |text| {
            write!(text, "timer {late_us} us late, simulated time slipped by {} ticks", now - before)
        })
    }

    pub(super) fn tell_parameters(&mut self, version: u64, from: i64) -> Result<(), IpcError> {
        self.tell(Process::Supervisor, EventKind::Parameters, Detector::None, |text| {
            write!(text, "parameters {version} in force from tick {from}")
        })
    }

    pub(super) fn tell_limited(&mut self, command: &Command) -> Result<(), IpcError> {
        let limited = command.limited;
        self.tell(Process::Supervisor, EventKind::Limited, Detector::None, |text| match limited {
            0 => write!(text, "no torque is limited any more"),
            bits => write!(text, "the peak limits the torque of joints {bits:#b} (a bit each, the first joint last)"),
        })
    }

    pub(super) fn tell_transition(&mut self, from: u32, to: u32) -> Result<(), IpcError> {
        let name = |code| Severity::from_code(code).map_or("?", Severity::name);
        self.tell(Process::Supervisor, EventKind::Transition, Detector::Deadline, |text| {
            write!(text, "severity {} -> {}", name(from), name(to))
        })
    }

    /// Sends an event whose text is written without touching the heap.
    pub(super) fn tell(
        &mut self,
        process: Process,
        kind: EventKind,
        detector: Detector,
        write: impl FnOnce(&mut Text) -> std::fmt::Result,
    ) -> Result<(), IpcError> {
        let mut text = Text::default();
        // Too long a text is cut.
        let _ = write(&mut text);
        let event = Event::new(self.gate.last().tick, process, kind, self.gate.severity(), detector, text.as_str());
        let stamp_ns = if self.start.clock == Clock::Realtime { clock::now_ns() } else { 0 };
        self.event.send(&Event { stamp_ns, ..event })?;
        Ok(())
    }
}

/// A text of bounded length on the stack.
#[derive(Default)]
pub(super) struct Text {
    bytes: arrayvec::ArrayString<{ hapfic_ipc::message::EVENT_TEXT }>,
}

impl Text {
    pub(super) fn as_str(&self) -> &str {
        &self.bytes
    }

    pub(super) fn write_fmt(&mut self, arguments: std::fmt::Arguments<'_>) -> std::fmt::Result {
        std::fmt::Write::write_fmt(&mut self.bytes, arguments)
    }
}
