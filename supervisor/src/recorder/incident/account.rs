//! An incident, and its description in Markdown.

use hapfic_messages::{Command, Detector, Event, EventKind, MAX_JOINTS, Mode, Process, Request, Severity, Source};
use std::collections::VecDeque;
use std::fmt::{self, Write as _};

/// Ticks with torques in the description.
const TORQUE_TICKS: usize = 10;
/// Kept requests of each controller: requests come some ticks before their commands.
const KEPT_REQUESTS: usize = 4 * TORQUE_TICKS;
/// Number of listed events up to which an incident lists an event of any kind, and an action.
const MAX_LISTED: usize = 40;
const MAX_LISTED_ACTIONS: usize = 200;
/// Period of a tick [ms].
const TICK_MS: f64 = 1.0;

/// Recent commands and requests.
#[derive(Clone, Default)]
pub(super) struct TorqueHistory {
    commands: VecDeque<Command>,
    /// Requests of the controller, and of the standby.
    requests: [VecDeque<Request>; 2],
}

/// Incident without an end, or without the first torque after it.
pub(super) struct OpenIncident {
    pub(super) number: u64,
    pub(super) begin: Event,
    /// Events, from shortly before the transition on.
    pub(super) events: Vec<Event>,
    pub(super) omitted_events: u64,
    pub(super) torques: TorqueHistory,
    pub(super) ages: Vec<MessageAge>,
    /// Transition to nominal.
    pub(super) end: Option<Event>,
    /// Tick and stamp [ns] of the first command with fresh torque.
    pub(super) fresh_torque: Option<(i64, u64)>,
}

/// Age of the last message of a process.
pub(super) struct MessageAge {
    pub(super) process: Process,
    pub(super) ms: Option<f64>,
    pub(super) tick: Option<i64>,
}

impl TorqueHistory {
    pub(super) fn command(&mut self, m: &Command) {
        push(&mut self.commands, *m, TORQUE_TICKS);
    }

    pub(super) fn request(&mut self, m: &Request) {
        push(&mut self.requests[usize::from(m.controller == Process::Standby.code())], *m, KEPT_REQUESTS);
    }

    pub(super) fn up_to(&self, tick: i64) -> Self {
        let mut some = self.clone();
        some.commands.retain(|m| m.tick <= tick);
        some.requests.iter_mut().for_each(|requests| requests.retain(|m| m.tick <= tick));
        some
    }
}

impl OpenIncident {
    pub(super) fn event(&mut self, m: &Event) {
        let action = EventKind::from_code(m.kind).is_some_and(|kind| {
            use EventKind::{Injected, Joined, Lost, Promoted, Rearmed, Restarted, Transition};
            matches!(kind, Lost | Restarted | Promoted | Joined | Rearmed | Injected | Transition)
        });
        let limit = if action { MAX_LISTED_ACTIONS } else { MAX_LISTED };
        if self.events.len() < limit {
            self.events.push(*m);
        } else {
            self.omitted_events += 1;
        }
    }

    /// Returns the cause of the incident: the first fault before it, the operator's request, or the transition itself.
    fn cause(&self) -> &Event {
        let before = || self.events.iter().filter(|event| event.tick <= self.begin.tick);
        let requested = self.begin.detector == Detector::Operator.code();
        let first = if requested {
            before().filter(|event| event.detector == Detector::Operator.code()).min_by_key(|event| event.tick)
        } else {
            before().filter(|event| is_fault(event)).min_by_key(|event| event.tick)
        };
        first.unwrap_or(&self.begin)
    }

    /// Writes the description in Markdown.
    pub(super) fn write(&self, out: &mut String) -> fmt::Result {
        let (begin, cause) = (&self.begin, self.cause());
        let severity = Severity::from_code(begin.severity).map_or("?", Severity::name);
        writeln!(out, "\n## {}. {severity} at tick {} ({:.3} s)\n", self.number, begin.tick, begin.tick as f64 * TICK_MS / 1e3)?;
        write!(out, "**What happened**: {}", describe_event(cause))?;
        if begin.detector == Detector::Budget.code() && cause != begin {
            write!(out, "; the restart budget is spent")?;
        }
        let rows = self.rows(cause);
        let lost = EventKind::Lost.code();
        for (_, event) in rows.iter().filter(|(_, event)| event.kind == lost && *event != cause) {
            write!(out, "; {}", describe_event(event))?;
        }
        writeln!(out, ".\n")?;
        let none = Detector::None.code();
        let detected =
            rows.iter().map(|(_, event)| *event).find(|event| event.detector != none && (is_fault(event) || *event == cause));
        let detected = detected.unwrap_or(begin);
        let detector = Detector::from_code(detected.detector).map_or("?", Detector::name);
        let before = elapsed_ms(event_time(detected), event_time(begin));
        writeln!(
            out,
            "**First detected by**: {detector}, of {}, tick {}, {before:.1} ms before the transition.\n",
            name(detected.process),
            detected.tick
        )?;
        self.write_ages(out)?;
        self.write_events(out, &rows)?;
        writeln!(
            out,
            "\n- time to brake: {:.1} ms (first cause to {severity})",
            elapsed_ms(event_time(cause), event_time(begin))
        )?;
        match &self.end {
            Some(end) => write!(
                out,
                "- time to recover: {:.1} ms ({severity} to nominal)",
                elapsed_ms(event_time(begin), event_time(end))
            )?,
            None => write!(out, "- time to recover: has not recovered")?,
        }
        match self.fresh_torque {
            Some(torque) => {
                writeln!(out, ", {:.1} ms to the first torque of a fresh request", elapsed_ms(event_time(begin), torque))?
            }
            None => writeln!(out, ", no torque of a fresh request since")?,
        }
        self.write_torques(out)
    }

    fn write_ages(&self, out: &mut String) -> fmt::Result {
        writeln!(out, "**Ages at the transition**\n\n| process | last message, ms before | last tick |\n|---|---|---|")?;
        for MessageAge { process, ms, tick } in &self.ages {
            let ms = ms.map_or("never".to_owned(), |ms| format!("{ms:.1}"));
            let tick = tick.map_or("-".to_owned(), |tick| tick.to_string());
            writeln!(out, "| {} | {ms} | {tick} |", process.name())?;
        }
        Ok(())
    }

    /// Returns the events from the cause on, with their times after it [ms].
    fn rows(&self, cause: &Event) -> Vec<(f64, &Event)> {
        let times = self.events.iter().map(|event| (elapsed_ms(event_time(cause), event_time(event)), event));
        let mut rows: Vec<_> = times.filter(|(after, event)| *after >= 0.0 || *event == cause).collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows
    }

    fn write_events(&self, out: &mut String, rows: &[(f64, &Event)]) -> fmt::Result {
        writeln!(out, "\n**Events and actions** (ms after the first cause)\n")?;
        writeln!(out, "| ms | tick | process | kind | detected by | what |\n|---|---|---|---|---|---|")?;
        for (after, event) in rows {
            let kind = EventKind::from_code(event.kind).map_or("?", EventKind::name);
            let detector = Detector::from_code(event.detector).map_or("?", Detector::name);
            let (process, text) = (name(event.process), escape_cell(&event.text()));
            writeln!(out, "| {after:.1} | {} | {process} | {kind} | {detector} | {text} |", event.tick)?;
        }
        if self.omitted_events > 0 {
            writeln!(out, "\n{} further events are only in the log.", self.omitted_events)?;
        }
        Ok(())
    }

    fn write_torques(&self, out: &mut String) -> fmt::Result {
        writeln!(
            out,
            "\n**Torques of the last {TORQUE_TICKS} ticks**, N m (N), joint by joint. *Accepted* is the raw torque of the"
        )?;
        writeln!(out, "request behind the command, *commanded* is the torque for the drive.\n")?;
        writeln!(out, "| tick | mode | source | from | requested by controller | requested by standby | accepted | commanded |")?;
        writeln!(out, "|---|---|---|---|---|---|---|---|")?;
        let TorqueHistory { commands, requests } = &self.torques;
        for m in commands {
            let mode = Mode::from_code(m.mode).map_or("?", Mode::name);
            let source = Source::from_code(m.source).map_or("?", Source::name);
            let from = match Process::from_code(m.request.controller) {
                Some(controller @ (Process::Controller | Process::Standby)) => controller.name(),
                _ => "none",
            };
            let [controller, standby] = requests.each_ref().map(|requests| {
                let request = requests.iter().rev().find(|request| request.tick == m.tick);
                request.map_or("-".to_owned(), |request| joints(&request.torque, m.joints))
            });
            let (accepted, commanded) = (joints(&m.request.torque, m.joints), joints(&m.torque, m.joints));
            writeln!(out, "| {} | {mode} | {source} | {from} | {controller} | {standby} | {accepted} | {commanded} |", m.tick)?;
        }
        Ok(())
    }
}

fn push<T>(list: &mut VecDeque<T>, item: T, most: usize) {
    if list.len() == most {
        list.pop_front();
    }
    list.push_back(item);
}

/// Whether an event can be the cause of an incident.
fn is_fault(event: &Event) -> bool {
    use EventKind::{Injected, Lost, Missed, Rejected};
    EventKind::from_code(event.kind).is_some_and(|kind| matches!(kind, Lost | Missed | Rejected | Injected))
}

/// Returns the tick and the stamp [ns] of an event.
fn event_time(event: &Event) -> (i64, u64) {
    (event.tick, event.stamp_ns)
}

/// Returns the time between two events [ms]: by their stamps, or by their ticks if a stamp is missing.
fn elapsed_ms(from: (i64, u64), to: (i64, u64)) -> f64 {
    if from.1 > 0 && to.1 > 0 {
        return to.1.wrapping_sub(from.1) as i64 as f64 / 1e6;
    }
    to.0.saturating_sub(from.0) as f64 * TICK_MS
}

fn name(process: u32) -> &'static str {
    Process::from_code(process).map_or("?", Process::name)
}

/// Describes an event: `controller lost: it was killed`.
fn describe_event(event: &Event) -> String {
    let kind = EventKind::from_code(event.kind).map_or("?", EventKind::name);
    format!("{} {kind}: {}", name(event.process), escape_cell(&event.text()))
}

/// Escapes a text for a Markdown table.
fn escape_cell(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut out, c| {
        match c {
            '|' => out.push_str("\\|"),
            '<' => out.push_str("&lt;"),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
        out
    })
}

fn joints(torque: &[f64; MAX_JOINTS], count: u32) -> String {
    let each: Vec<_> = torque.iter().take(count as usize).map(|torque| format!("{torque:.3}")).collect();
    each.join(" ")
}
