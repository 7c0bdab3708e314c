//! The post-mortem: a short file beside the log with the events around each brake or latched stop.
//!
//! An incident begins when the severity rises to brake or stopped, and ends when it is nominal again, or with the run.
//! The recorder replaces the whole file at the start, at each further transition and at the end of an incident. So a
//! readable file exists whenever the supervisor is lost. In lockstep messages carry no wall-clock time, and the file
//! counts times in ticks.

mod account;

use super::RecordedMessage;
use account::{MessageAge, OpenIncident, TorqueHistory};
use hapfic_ipc::HeartbeatPage;
use hapfic_messages::{Clock, Command, Event, EventKind, Mode, Process, Severity, Source, Timing};
use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Ticks by which a cause may precede the transition.
const CAUSE_TICKS: i64 = 50;
/// Ticks for which the recorder keeps events, and their largest number.
const HISTORY_TICKS: i64 = 2000;
const HISTORY_EVENTS: usize = 256;
/// Incidents described in full.
const MAX_DESCRIBED: u64 = 20;

/// Processes whose ages an incident lists: those that send messages in every tick.
const TICKING: [Process; 5] = [Process::Gate, Process::Plant, Process::Planner, Process::Controller, Process::Standby];
/// Heading of an incident.
const HEADING: &str = "\n## ";

/// Number of incidents, and the file that describes them.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct IncidentSummary {
    /// Number of incidents.
    pub count: u64,
    /// Path of the post-mortem.
    pub file: PathBuf,
    /// First error, if the file is missing or incomplete.
    pub error: Option<String>,
}

/// Observes the recorded messages, and writes the post-mortem.
pub(super) struct PostMortem {
    clock: Clock,
    /// Name of the log, for the heading.
    log: String,
    file: PathBuf,
    /// Whether a file can lie beside the log.
    has_file: bool,
    error: Option<String>,
    severity: u32,
    last: [LastMessage; Process::ALL.len()],
    torques: TorqueHistory,
    events: VecDeque<Event>,
    /// Text of the closed incidents.
    closed: String,
    open: Option<OpenIncident>,
    count: u64,
    /// Whether the file lacks new text.
    dirty: bool,
}

/// Newest stamp and tick in the messages of a process.
#[derive(Clone, Copy, Debug, Default)]
struct LastMessage {
    stamp_ns: u64,
    tick: Option<i64>,
}

impl PostMortem {
    /// Starts without incidents, and removes the file of an earlier run; or goes on in the file of a recorder that was lost.
    pub(super) fn new(log: &Path, clock: Clock, goes_on: bool) -> Self {
        let file = log.with_extension("incidents.md");
        // No file can lie beside a device or a pipe.
        let has_file = !fs::metadata(log).is_ok_and(|metadata| !metadata.is_file());
        let removed = if has_file && !goes_on { fs::remove_file(&file) } else { Ok(()) };
        let error = match removed {
            Err(cause) if cause.kind() != io::ErrorKind::NotFound => Some(file_error("remove", &file, &cause)),
            _ if !has_file => Some(format!("{}: not a regular file, so it has no post-mortem", log.display())),
            _ => None,
        };
        let before = if has_file && goes_on { fs::read_to_string(&file).unwrap_or_default() } else { String::new() };
        let closed = before.find(HEADING).map_or("", |begin| &before[begin..]).to_owned();
        Self {
            clock,
            log: log.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            file,
            has_file,
            error,
            severity: Severity::Nominal.code(),
            last: [LastMessage::default(); Process::ALL.len()],
            torques: TorqueHistory::default(),
            events: VecDeque::new(),
            count: closed.matches(HEADING).count() as u64,
            closed,
            open: None,
            dirty: false,
        }
    }

    /// Evaluates a message. Returns whether the log must be synced to the disk first: the drive brakes or stops.
    pub(super) fn observe(&mut self, record: &RecordedMessage, heartbeats: &HeartbeatPage) -> bool {
        match record {
            RecordedMessage::State(m) => self.record_last_message(Process::Plant.code(), m.stamp_ns, m.tick),
            RecordedMessage::Reference(m) => self.record_last_message(Process::Planner.code(), m.stamp_ns, m.tick),
            RecordedMessage::Request(m) => {
                self.record_last_message(m.controller, m.stamp_ns, m.tick);
                self.torques.request(m);
                if let Some(open) = self.open.as_mut().filter(|open| m.tick <= open.begin.tick) {
                    open.torques.request(m);
                }
            }
            RecordedMessage::Command(m) => self.command(m),
            RecordedMessage::Timing(m) => self.timing(m),
            RecordedMessage::Event(m) => return self.event(m, heartbeats),
            RecordedMessage::Operator(_) => {}
        }
        false
    }

    /// Closes the open incident and returns the summary, if there were incidents.
    pub(super) fn finish(&mut self) -> Option<IncidentSummary> {
        if self.open.is_some() {
            self.close();
            self.write();
        }
        (self.count > 0).then(|| IncidentSummary { count: self.count, file: self.file.clone(), error: self.error.clone() })
    }

    fn record_last_message(&mut self, process: u32, stamp_ns: u64, tick: i64) {
        if let Some(last) = self.last.get_mut(process as usize) {
            last.stamp_ns = last.stamp_ns.max(stamp_ns);
            last.tick = last.tick.max(Some(tick));
        }
    }

    /// Evaluates a heartbeat. Ignores its wall-clock times in lockstep, where no other message has any.
    fn timing(&mut self, m: &Timing) {
        let stamp_ns = if self.clock == Clock::Realtime { m.wake_ns.max(m.publish_ns) } else { 0 };
        self.record_last_message(m.process, stamp_ns, m.tick);
    }

    fn command(&mut self, m: &Command) {
        self.record_last_message(Process::Gate.code(), m.stamp_ns, m.tick);
        self.torques.command(m);
        let Some(open) = &mut self.open else { return };
        if m.tick <= open.begin.tick {
            open.torques.command(m);
        } else if open.fresh_torque.is_none() && m.mode == Mode::Active.code() && m.source == Source::Fresh.code() {
            open.fresh_torque = Some((m.tick, m.stamp_ns));
            if open.end.is_some() {
                self.close();
                self.write();
            }
        }
    }

    fn event(&mut self, m: &Event, heartbeats: &HeartbeatPage) -> bool {
        if let Some(open) = self.open.as_mut().filter(|open| open.end.is_none()) {
            open.event(m);
        }
        self.events.push_back(*m);
        while self.events.len() > HISTORY_EVENTS
            || self.events.front().is_some_and(|old| old.tick.saturating_add(HISTORY_TICKS) < m.tick)
        {
            self.events.pop_front();
        }
        // After a fatal loss the gate makes no transition any more.
        let fatal = m.kind == EventKind::Lost.code() && m.severity == Severity::Stopped.code();
        if !(fatal || m.kind == EventKind::Transition.code()) || Severity::from_code(m.severity).is_none() {
            return false;
        }
        let before = std::mem::replace(&mut self.severity, m.severity);
        let braked = m.severity >= Severity::Brake.code();
        let nominal = m.severity == Severity::Nominal.code();
        if nominal {
            // A cleared event is no cause of a later incident.
            self.events.clear();
        }
        let ongoing = self.open.as_ref().is_some_and(|open| open.end.is_none());
        if ongoing {
            if let Some(open) = self.open.as_mut().filter(|_| nominal) {
                open.end = Some(*m);
            }
            // An incident is complete with the first fresh torque.
            if self.open.as_ref().is_some_and(|open| open.end.is_some() && open.fresh_torque.is_some()) {
                self.close();
            }
            // Incidents that are only counted add no text.
            self.dirty |= self.count <= MAX_DESCRIBED;
        } else if braked && before < Severity::Brake.code() {
            self.close();
            self.begin(m, heartbeats);
            self.dirty |= self.count <= MAX_DESCRIBED + 1;
        }
        braked
    }

    fn begin(&mut self, m: &Event, heartbeats: &HeartbeatPage) {
        self.count += 1;
        let mut open = OpenIncident {
            number: self.count,
            begin: *m,
            events: Vec::new(),
            omitted_events: 0,
            torques: self.torques.up_to(m.tick),
            ages: TICKING.iter().map(|&process| self.age(process, m, heartbeats)).collect(),
            end: None,
            fresh_torque: None,
        };
        for event in self.events.iter().filter(|event| event.tick.saturating_add(CAUSE_TICKS) >= m.tick) {
            open.event(event);
        }
        self.open = Some(open);
    }

    /// Returns the age of a process by the stamps of its messages; without stamps, its heartbeat age.
    fn age(&self, process: Process, m: &Event, heartbeats: &HeartbeatPage) -> MessageAge {
        let LastMessage { stamp_ns, tick } = self.last[process as usize];
        let ns = if stamp_ns > 0 && m.stamp_ns > 0 {
            Some(m.stamp_ns.saturating_sub(stamp_ns))
        } else {
            heartbeats.read(process).age_ns()
        };
        MessageAge { process, ms: ns.map(|ns| ns as f64 / 1e6), tick }
    }

    /// Closes the open incident, if any.
    fn close(&mut self) {
        if let Some(open) = self.open.take().filter(|open| open.number <= MAX_DESCRIBED) {
            // Writing to a string cannot fail.
            let _ = open.write(&mut self.closed);
        }
    }

    /// Writes new text to the file. The call comes after the log itself is on the disk.
    pub(super) fn write_pending(&mut self) {
        if std::mem::take(&mut self.dirty) {
            self.write();
        }
    }

    /// Replaces the file. A failure must not affect the run: the summary holds the first one.
    fn write(&mut self) {
        if !self.has_file {
            return;
        }
        let text = self.text();
        if let Err(cause) = replace(&self.file, text.as_bytes()) {
            self.error.get_or_insert_with(|| file_error("write", &self.file, &cause));
        }
    }

    fn text(&self) -> String {
        let mut text = format!("# Incidents: {}\n\n", self.log);
        text += "Each begins when the severity rises to brake or stopped, and ends when it is nominal again.\n";
        text += match self.clock {
            Clock::Realtime => {
                "Times are from the stamps of the messages (CLOCK_MONOTONIC), or from ticks where there is no stamp.\n"
            }
            Clock::Lockstep => {
                "Lockstep: messages have no stamps, so times are counted in ticks of 1 ms. Only ages are wall-clock times.\n"
            }
        };
        text += &self.closed;
        if let Some(open) = self.open.as_ref().filter(|open| open.number <= MAX_DESCRIBED) {
            // Writing to a string cannot fail.
            let _ = open.write(&mut text);
        }
        if self.count > MAX_DESCRIBED {
            text +=
                &format!("\n{} further incidents are not described here; the log has them all.\n", self.count - MAX_DESCRIBED);
        }
        text
    }
}

/// Replaces a file atomically: writes and syncs a temporary file beside it, and renames that.
fn replace(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut part_name = path.file_name().unwrap_or_default().to_owned();
    part_name.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(part_name);
    let _ = fs::remove_file(&part);
    // `create_new` does not follow a link that another user may have planted.
    let mut file = File::options().write(true).create_new(true).open(&part)?;
    let written = file.write_all(content).and_then(|()| file.sync_data()).and_then(|()| fs::rename(&part, path));
    if written.is_err() {
        let _ = fs::remove_file(&part);
    }
    written
}

fn file_error(what: &str, path: &Path, cause: &io::Error) -> String {
    format!("{}: cannot {what} the post-mortem: {cause}. Hint: check the space and the permissions of its folder", path.display())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests;
