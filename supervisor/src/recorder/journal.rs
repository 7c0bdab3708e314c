//! The journal, in lockstep: every message that is not flushed to the log.
//!
//! It lies in the rings in which the senders keep their last messages before they send them, so it outlives every process.
//! The credit of the plant keeps it smaller than the rings. A message is in the rings, or it reaches the inputs of the
//! recorder, if these were open before the rings were read; what is both is dropped there. A sender whose connection to the
//! recorder fails reaches the log through the rings alone, until its ports connect again.

use super::RecordedMessage;
use super::position::{identity, is_plausible, request_index};
use hapfic_ipc::run_status::RunStatus;
use hapfic_ipc::{Bus, IpcError, RecorderPage, topic};
use hapfic_messages::{Check, Clock, Message, Operator, Process, Timing};
use std::collections::HashMap;

/// Ticks after which an event is written, whether its identity is still kept or not.
const EVENT_TICKS: i64 = 4096;
/// Gates, controllers, and all that send events.
const GATES: [Process; 2] = [Process::Gate, Process::SpareGate];
const CONTROLLERS: [Process; 2] = [Process::Controller, Process::Standby];
const EVENT_SENDERS: [Process; 3] = [Process::Supervisor, Process::Gate, Process::SpareGate];

/// Reads the journal: all messages in the order of ticks, causes first.
///
/// # Errors
/// [`IpcError`] if the rings cannot be read.
pub(super) fn read(bus: &Bus, page: &RecorderPage, status: &RunStatus) -> Result<Vec<RecordedMessage>, IpcError> {
    let flushed = page.flushed();
    let new = |kind: usize, tick: i64| tick > flushed.ticks[kind] && is_plausible(tick, status);
    let mut records = Vec::new();
    records.extend(sets(kept(bus, &topic::OPERATOR, &GATES)?, flushed.ticks[0]).map(RecordedMessage::Operator));
    let states = kept(bus, &topic::STATE, &[Process::Plant])?;
    records.extend(states.into_iter().filter(|m| new(0, m.tick)).map(RecordedMessage::State));
    let references = kept(bus, &topic::REFERENCE, &[Process::Planner])?;
    records.extend(references.into_iter().filter(|m| new(1, m.tick)).map(RecordedMessage::Reference));
    let requests = kept(bus, &topic::REQUEST, &CONTROLLERS)?;
    records.extend(requests.into_iter().filter(|m| new(2 + request_index(m), m.tick)).map(RecordedMessage::Request));
    let commands = kept(bus, &topic::COMMAND, &GATES)?;
    records.extend(commands.into_iter().filter(|m| new(4, m.tick)).map(RecordedMessage::Command));
    let mut written = HashMap::new();
    page.events(0, flushed.events).for_each(|identity| *written.entry(identity).or_default() += 1);
    let mut unwritten = kept(bus, &topic::EVENT, &EVENT_SENDERS)?;
    unwritten.retain(|m| m.tick.saturating_add(EVENT_TICKS) >= flushed.ticks[0] && !take(&mut written, identity(m)));
    records.extend(unwritten.into_iter().map(RecordedMessage::Event));
    let timed = |m: &Timing| flushed.timing_ns.get(m.process as usize).is_some_and(|newest| m.wake_ns > *newest);
    let timings = kept(bus, &topic::TIMING, Process::ALL)?;
    records.extend(timings.into_iter().filter(timed).map(RecordedMessage::Timing));
    // A stable sort keeps the order within a tick.
    records.sort_by_key(RecordedMessage::tick);
    Ok(records)
}

/// Usable messages that senders have kept.
fn kept<T: Check + Message>(bus: &Bus, topic: &topic::Topic<T>, senders: &[Process]) -> Result<Vec<T>, IpcError> {
    let mut all = Vec::new();
    for sender in senders {
        all.extend(bus.kept(topic, *sender, Clock::Lockstep)?.into_iter().filter(|message| message.check().is_ok()));
    }
    Ok(all)
}

/// The sets that may be in force after the flushed ticks: every part of the log begins with them.
fn sets(mut all: Vec<Operator>, flushed: i64) -> impl Iterator<Item = Operator> {
    all.sort_by_key(|sets| sets.next.version);
    all.dedup_by_key(|sets| sets.next.version);
    let last_before = all.iter().rposition(|sets| sets.next.effective_tick <= flushed).unwrap_or(0);
    all.into_iter().skip(last_before)
}

/// Takes one of the identities out of a set with repetitions; returns whether it was there.
pub(super) fn take(identities: &mut HashMap<u64, u32>, identity: u64) -> bool {
    let Some(count) = identities.get_mut(&identity) else { return false };
    *count -= 1;
    if *count == 0 {
        identities.remove(&identity);
    }
    true
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_ipc::{Domain, LogPosition, SharedStatus};
    use hapfic_messages::{Command, Detector, Event, EventKind, Parameters, Severity, State};

    fn event(tick: i64, text: &str) -> Event {
        Event::new(tick, Process::Gate, EventKind::Note, Severity::Nominal, Detector::None, text)
    }

    fn order(records: &[RecordedMessage]) -> Vec<(&'static str, i64)> {
        let name = |record: &RecordedMessage| match record {
            RecordedMessage::Operator(m) => ("operator", m.next.version as i64),
            RecordedMessage::State(m) => ("state", m.tick),
            RecordedMessage::Command(m) => ("command", m.tick),
            RecordedMessage::Event(m) => ("event", m.tick),
            _ => ("other", 0),
        };
        records.iter().map(name).collect()
    }

    #[test]
    fn journal_holds_what_is_not_flushed_of_dead_senders() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().to_str().unwrap();
        let domain_prefix = format!("hfj{}_", std::process::id());
        let domain = Domain::new(&domain_prefix, root).unwrap();
        let bus = Bus::open(&domain, "journal").unwrap();
        let (page, status) = (RecorderPage::open(root).unwrap(), SharedStatus::create(root).unwrap());
        status.gate.tick.store(5, std::sync::atomic::Ordering::Release);
        let clock = Clock::Lockstep;
        let set = |version, effective_tick| Parameters {
            version,
            effective_tick,
            stiffness: [1.0; 3],
            max_force: [1.0; 3],
            position_bound: [1.0; 3],
            taper: 1.0,
            search_scale: 1.0,
            force_resolution: 1.0,
            mean_speed: 1.0,
            max_acceleration: 1.0,
            ..Parameters::default()
        };
        {
            let mut operator = bus.kept_output(&topic::OPERATOR, Process::SpareGate, clock).unwrap();
            let mut state = bus.kept_output(&topic::STATE, Process::Plant, clock).unwrap();
            let mut command = bus.kept_output(&topic::COMMAND, Process::Gate, clock).unwrap();
            let mut events = bus.kept_output(&topic::EVENT, Process::Gate, clock).unwrap();
            for version in 1..4 {
                let sets = Operator { current: set(version - 1, 0), next: set(version, 2 * version as i64 - 2) };
                operator.send(&sets).unwrap();
            }
            for tick in 0..6 {
                state.send(&State { tick, ..State::default() }).unwrap();
                command.send(&Command { tick, ..Command::default() }).unwrap();
                events.send(&event(tick, "x")).unwrap();
            }
            // Of a tick that cannot be: recorded when it comes, but no part of the journal.
            state.send(&State { tick: 99, ..State::default() }).unwrap();
        }
        for (number, tick) in [(0, 0), (1, 1), (2, 2), (3, 4)] {
            page.set_event(number, identity(&event(tick, "x")));
        }
        page.set_flushed(&LogPosition { part: 1, ticks: [3, -1, -1, -1, 4], events: 4, ..LogPosition::default() });
        let records = read(&bus, &page, &status).unwrap();
        let expected = [("operator", 2), ("operator", 3), ("event", 3), ("state", 4), ("state", 5), ("command", 5), ("event", 5)];
        assert_eq!(order(&records), expected);
        drop(bus);
        // What iceoryx2 keeps of a domain without nodes; in a run the launcher removes it.
        for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&domain_prefix) {
                std::fs::remove_file(entry.path()).unwrap();
            }
        }
    }

    #[test]
    fn identities_are_taken_as_often_as_they_are_there() {
        let mut identities = HashMap::from([(7, 2)]);
        assert_eq!([7, 8, 7, 7].map(|identity| take(&mut identities, identity)), [true, false, true, false]);
        assert!(identities.is_empty());
    }
}
