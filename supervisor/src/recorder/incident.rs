//! The post-mortem: what happened around each brake or latched stop, in a short file beside the log.
//!
//! An incident begins when the severity rises to brake or stopped and ends when it is nominal again, or with the run. The file
//! is made anew at its begin, at each further transition and at its end, and replaced whole, so that whenever the supervisor is
//! lost there is a readable one. In lockstep messages carry no time of the clock on the wall: there times are counted in ticks.

mod account;

use super::Record;
use account::{Age, Incident, Torques};
use hapfic_gate_process::shared_status::SharedStatus;
use hapfic_messages::{Clock, Command, Event, EventKind, Mode, Process, Severity, Source, Timing};
use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// How long before the transition its cause may lie, ticks.
const CAUSE_TICKS: i64 = 50;
/// How long events are remembered, ticks, and how many.
const MEMORY_TICKS: i64 = 2000;
const MEMORY_EVENTS: usize = 256;
/// Incidents that are told in full.
const IN_FULL: u64 = 20;

/// How many incidents there were, and where to read of them.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct IncidentSummary {
    /// How many there were.
    pub count: u64,
    /// The file.
    pub file: PathBuf,
    /// Why the file is not there, or not complete; the first reason.
    pub error: Option<String>,
}

/// Watches what is recorded, and writes the post-mortem.
pub(super) struct Incidents {
    clock: Clock,
    /// What the file is called in its heading: the log's name.
    log: String,
    file: PathBuf,
    /// Whether there can be a file beside the log.
    beside: bool,
    error: Option<String>,
    severity: u32,
    heard: [Heard; Process::ALL.len()],
    torques: Torques,
    events: VecDeque<Event>,
    /// Those that are over, as text.
    told: String,
    open: Option<Incident>,
    count: u64,
    /// Whether there is something new to be written.
    dirty: bool,
}

/// The last sign of life of a process.
#[derive(Clone, Copy, Debug, Default)]
struct Heard {
    stamp_ns: u64,
    tick: Option<i64>,
}

impl Incidents {
    /// Nothing has happened yet; a file that an earlier run has left is removed.
    pub(super) fn new(log: &Path, clock: Clock) -> Self {
        let file = log.with_extension("incidents.md");
        // Beside a device or a pipe there is no place for a file.
        let beside = !fs::metadata(log).is_ok_and(|metadata| !metadata.is_file());
        let stale = if beside { fs::remove_file(&file) } else { Ok(()) };
        let error = match stale {
            Err(cause) if cause.kind() != io::ErrorKind::NotFound => Some(cannot("remove", &file, &cause)),
            _ if !beside => Some(format!("{}: not a regular file, there is no post-mortem beside it", log.display())),
            _ => None,
        };
        Self {
            clock,
            log: log.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            file,
            beside,
            error,
            severity: Severity::Nominal.code(),
            heard: [Heard::default(); Process::ALL.len()],
            torques: Torques::default(),
            events: VecDeque::new(),
            told: String::new(),
            open: None,
            count: 0,
            dirty: false,
        }
    }

    /// Takes note of a record. Returns whether the log should be on the disk before anything else: the drive brakes or stops.
    pub(super) fn observe(&mut self, record: &Record, shared: &SharedStatus) -> bool {
        match record {
            Record::State(m) => self.record_heartbeat(Process::Plant.code(), m.stamp_ns, m.tick),
            Record::Reference(m) => self.record_heartbeat(Process::Planner.code(), m.stamp_ns, m.tick),
            Record::Request(m) => {
                self.record_heartbeat(m.controller, m.stamp_ns, m.tick);
                self.torques.request(m);
                if let Some(open) = self.open.as_mut().filter(|open| m.tick <= open.begin.tick) {
                    open.torques.request(m);
                }
            }
            Record::Command(m) => self.command(m),
            Record::Timing(m) => self.timing(m),
            Record::Event(m) => return self.event(m, shared),
            Record::Operator(_) => {}
        }
        false
    }

    /// At the end of the run: what there was, if anything.
    pub(super) fn finish(&mut self) -> Option<IncidentSummary> {
        if self.open.is_some() {
            self.close();
            self.write();
        }
        (self.count > 0).then(|| IncidentSummary { count: self.count, file: self.file.clone(), error: self.error.clone() })
    }

    fn record_heartbeat(&mut self, process: u32, stamp_ns: u64, tick: i64) {
        if let Some(heard) = self.heard.get_mut(process as usize) {
            heard.stamp_ns = heard.stamp_ns.max(stamp_ns);
            heard.tick = heard.tick.max(Some(tick));
        }
    }

    /// Heartbeats have the time of the clock on the wall in lockstep, too, where nothing else has it.
    fn timing(&mut self, m: &Timing) {
        let stamp_ns = if self.clock == Clock::Realtime { m.wake_ns.max(m.publish_ns) } else { 0 };
        self.record_heartbeat(m.process, stamp_ns, m.tick);
    }

    fn command(&mut self, m: &Command) {
        self.record_heartbeat(Process::Supervisor.code(), m.stamp_ns, m.tick);
        self.torques.command(m);
        let Some(open) = &mut self.open else { return };
        if m.tick <= open.begin.tick {
            open.torques.command(m);
        } else if open.torque_again.is_none() && m.mode == Mode::Active.code() && m.source == Source::Fresh.code() {
            open.torque_again = Some((m.tick, m.stamp_ns));
            if open.end.is_some() {
                self.close();
                self.write();
            }
        }
    }

    fn event(&mut self, m: &Event, shared: &SharedStatus) -> bool {
        if let Some(open) = self.open.as_mut().filter(|open| open.end.is_none()) {
            open.event(m);
        }
        self.events.push_back(*m);
        while self.events.len() > MEMORY_EVENTS
            || self.events.front().is_some_and(|old| old.tick.saturating_add(MEMORY_TICKS) < m.tick)
        {
            self.events.pop_front();
        }
        // A loss that the run cannot get over leaves no gate to make the transition.
        let fatal = m.kind == EventKind::Lost.code() && m.severity == Severity::Stopped.code();
        if !(fatal || m.kind == EventKind::Transition.code()) || Severity::from_code(m.severity).is_none() {
            return false;
        }
        let before = std::mem::replace(&mut self.severity, m.severity);
        let braked = m.severity >= Severity::Brake.code();
        let nominal = m.severity == Severity::Nominal.code();
        if nominal {
            // What has cleared is no cause of what comes later.
            self.events.clear();
        }
        let goes_on = self.open.as_ref().is_some_and(|open| open.end.is_none());
        if goes_on {
            if let Some(open) = self.open.as_mut().filter(|_| nominal) {
                open.end = Some(*m);
            }
            // One whose torque has come already is complete.
            if self.open.as_ref().is_some_and(|open| open.end.is_some() && open.torque_again.is_some()) {
                self.close();
            }
            // Of those that are only counted there is nothing new.
            self.dirty |= self.count <= IN_FULL;
        } else if braked && before < Severity::Brake.code() {
            self.close();
            self.begin(m, shared);
            self.dirty |= self.count <= IN_FULL + 1;
        }
        braked
    }

    fn begin(&mut self, m: &Event, shared: &SharedStatus) {
        self.count += 1;
        let mut open = Incident {
            number: self.count,
            begin: *m,
            events: Vec::new(),
            more_events: 0,
            torques: self.torques.until(m.tick),
            ages: Process::ALL.iter().map(|&process| self.age(process, m, shared)).collect(),
            end: None,
            torque_again: None,
        };
        for event in self.events.iter().filter(|event| event.tick.saturating_add(CAUSE_TICKS) >= m.tick) {
            open.event(event);
        }
        self.open = Some(open);
    }

    /// By the stamps of its messages if there are any, else by what the recorder has heard of it.
    fn age(&self, process: Process, m: &Event, shared: &SharedStatus) -> Age {
        let Heard { stamp_ns, tick } = self.heard[process as usize];
        let ns = if stamp_ns > 0 && m.stamp_ns > 0 {
            Some(m.stamp_ns.saturating_sub(stamp_ns))
        } else {
            shared.heartbeat(process).age_ns()
        };
        Age { process, ms: ns.map(|ns| ns as f64 / 1e6), tick }
    }

    /// Lays the open incident, if there is one, with those that are over.
    fn close(&mut self) {
        if let Some(open) = self.open.take().filter(|open| open.number <= IN_FULL) {
            // Writing to a string cannot fail.
            let _ = open.tell(&mut self.told);
        }
    }

    /// Makes the file anew. A failure must not hurt the run: the first one is remembered.
    /// Writes what is new. To be called when the log itself is safe on the disk.
    pub(super) fn settle(&mut self) {
        if std::mem::take(&mut self.dirty) {
            self.write();
        }
    }

    fn write(&mut self) {
        if !self.beside {
            return;
        }
        let text = self.text();
        if let Err(cause) = replace(&self.file, text.as_bytes()) {
            self.error.get_or_insert_with(|| cannot("write", &self.file, &cause));
        }
    }

    fn text(&self) -> String {
        let mut text = format!("# Incidents: {}\n\n", self.log);
        text += "Each begins when the severity rises to brake or stopped, and ends when it is nominal again.\n";
        text += match self.clock {
            Clock::Realtime => {
                "Times are those of the messages' own stamps (CLOCK_MONOTONIC), or of ticks where there is none.\n"
            }
            Clock::Lockstep => {
                "Lockstep: messages have no stamps, so times are counted in ticks of 1 ms. Only ages are by the wall.\n"
            }
        };
        text += &self.told;
        if let Some(open) = self.open.as_ref().filter(|open| open.number <= IN_FULL) {
            // Writing to a string cannot fail.
            let _ = open.tell(&mut text);
        }
        if self.count > IN_FULL {
            text += &format!("\n{} further incidents are not told here; the log has them all.\n", self.count - IN_FULL);
        }
        text
    }
}

/// Writes a file beside, has it written to the disk, and gives it its name: whoever looks finds the old one or the new one, whole.
fn replace(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut beside = path.file_name().unwrap_or_default().to_owned();
    beside.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(beside);
    let _ = fs::remove_file(&part);
    // Never through a link that somebody has put there.
    let mut file = File::options().write(true).create_new(true).open(&part)?;
    let written = file.write_all(content).and_then(|()| file.sync_data()).and_then(|()| fs::rename(&part, path));
    if written.is_err() {
        let _ = fs::remove_file(&part);
    }
    written
}

fn cannot(what: &str, path: &Path, cause: &io::Error) -> String {
    format!("{}: cannot {what} the post-mortem: {cause}. Check the space and the permissions of its folder", path.display())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests;
