use super::*;
use hapfic_messages::{Detector, Request, State};

/// Stamp of a tick [ns]; zero in lockstep.
fn stamp(clock: Clock, tick: i64) -> u64 {
    if clock == Clock::Realtime { 7_000_000_000 + tick as u64 * 1_000_000 } else { 0 }
}

/// Sequence of recorded messages, and the resulting post-mortem.
struct Sequence {
    folder: tempfile::TempDir,
    incidents: PostMortem,
    heartbeats: HeartbeatPage,
    clock: Clock,
}

impl Sequence {
    fn new(clock: Clock) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let incidents = PostMortem::new(&folder.path().join("run.mcap"), clock, false);
        Self { folder, incidents, heartbeats: HeartbeatPage::private().unwrap(), clock }
    }

    fn text(&self) -> String {
        fs::read_to_string(self.folder.path().join("run.incidents.md")).unwrap()
    }

    fn observe(&mut self, record: RecordedMessage) -> bool {
        let sync = self.incidents.observe(&record, &self.heartbeats);
        self.incidents.write_pending();
        sync
    }

    fn event(&mut self, tick: i64, kind: EventKind, severity: Severity, detector: Detector, text: &str) -> bool {
        let process = if kind == EventKind::Transition { Process::Gate } else { Process::Controller };
        let event = Event::new(tick, process, kind, severity, detector, text);
        // Half a millisecond after the tick.
        let stamp_ns = Some(stamp(self.clock, tick)).filter(|ns| *ns > 0).map_or(0, |ns| ns + 500_000);
        self.observe(RecordedMessage::Event(Event { stamp_ns, ..event }))
    }

    fn transition(&mut self, tick: i64, to: Severity) -> bool {
        self.event(tick, EventKind::Transition, to, Detector::Deadline, &format!("severity ? -> {to}"))
    }

    /// State and command of a tick, and both requests if the source is fresh.
    fn tick(&mut self, tick: i64, mode: Mode, source: Source) {
        let stamp_ns = stamp(self.clock, tick);
        self.observe(RecordedMessage::State(State { tick, stamp_ns, ..State::default() }));
        let mut request = Request { tick, stamp_ns, controller: Process::Controller.code(), joints: 2, ..Request::default() };
        request.torque[0] = 1.5;
        if source == Source::Fresh {
            self.observe(RecordedMessage::Request(request));
            let mut other = Request { controller: Process::Standby.code(), ..request };
            other.torque[0] = 2.5;
            self.observe(RecordedMessage::Request(other));
        }
        let mut command =
            Command { tick, stamp_ns, mode: mode.code(), source: source.code(), joints: 2, request, ..Command::default() };
        command.torque[1] = -0.25;
        self.observe(RecordedMessage::Command(command));
    }

    /// Loss of the controller at tick `from`, brake three ticks later, restart at the tick before `until`.
    fn brake(&mut self, from: i64, until: i64) {
        for tick in from - 15..from {
            self.tick(tick, Mode::Active, Source::Fresh);
        }
        self.event(from, EventKind::Lost, Severity::Nominal, Detector::Exit, "killed | by <signal> 9");
        self.tick(from, Mode::Active, Source::Repeated);
        self.event(from, EventKind::Missed, Severity::Degraded, Detector::Deadline, "no request");
        assert!(!self.transition(from, Severity::Degraded));
        for tick in from + 1..from + 3 {
            self.tick(tick, Mode::Active, Source::Repeated);
        }
        self.tick(from + 3, Mode::Brake, Source::None);
        assert!(self.transition(from + 3, Severity::Brake), "a brake syncs the log");
        for tick in from + 4..until {
            self.tick(tick, Mode::Brake, Source::Suppressed);
        }
        self.event(until - 1, EventKind::Restarted, Severity::Brake, Detector::None, "started again");
    }
}

#[test]
fn incident_open_and_closed_is_described() {
    for clock in [Clock::Realtime, Clock::Lockstep] {
        let mut sequence = Sequence::new(clock);
        sequence
            .heartbeats
            .write(&Timing { process: Process::Planner.code(), tick: 5, ..Timing::default() }, hapfic_ipc::clock::now_ns());
        sequence.brake(4000, 4030);
        let text = sequence.text();
        assert!(text.contains("## 1. brake at tick 4003 (4.003 s)") && text.contains("has not recovered"), "{text}");
        sequence.tick(4030, Mode::Active, Source::Fresh);
        assert!(!sequence.transition(4030, Severity::Nominal));
        // Later events belong to no incident.
        sequence.event(4031, EventKind::Note, Severity::Nominal, Detector::None, "later");
        let text = sequence.text();
        for line in [
            "**What happened**: controller lost: killed \\| by &lt;signal> 9.",
            "**First detected by**: exit, of controller, tick 4000, 3.0 ms before the transition.",
            "| 0.0 | 4000 | controller | missed | deadline | no request |",
            "| 29.0 | 4029 | controller | restarted | none | started again |",
            "| 30.0 | 4030 | gate | transition | deadline | severity ? -> nominal |",
            "- time to brake: 3.0 ms (first cause to brake)",
            "| 3999 | active | fresh | controller | 1.500 0.000 | 2.500 0.000 | 1.500 0.000 | 0.000 -0.250 |",
            "| 4003 | brake | none | controller | - | - | 1.500 0.000 | 0.000 -0.250 |",
            "| standby | never | 3999 |",
        ] {
            // The standby has an age only where requests have stamps.
            let applies = !line.starts_with("| standby") || clock == Clock::Lockstep;
            assert!(!applies || text.lines().any(|l| l == line), "{clock:?}: '{line}' is not in\n{text}");
        }
        assert!(text.contains("- time to recover: 27.0 ms (brake to nominal), 2"), "{text}");
        assert!(!text.contains("| 3993 |") && !text.contains("later"), "{text}");
        assert_eq!(text.contains("Lockstep:"), clock == Clock::Lockstep);
        let summary = sequence.incidents.finish().unwrap();
        assert_eq!((summary.count, summary.error), (1, None));
        assert_eq!(fs::read_dir(sequence.folder.path()).unwrap().count(), 1, "the temporary file is removed");
    }
}

#[test]
fn ages_without_stamp_use_heartbeat() {
    let mut sequence = Sequence::new(Clock::Realtime);
    sequence
        .heartbeats
        .write(&Timing { process: Process::Planner.code(), tick: 5, ..Timing::default() }, hapfic_ipc::clock::now_ns());
    sequence.brake(100, 110);
    let text = sequence.text();
    // The last request is of tick 99, the brake half a millisecond after tick 103.
    assert!(text.contains("| controller | 4.5 | 99 |") && text.contains("| plant | 0.5 | 103 |"), "{text}");
    assert!(text.lines().any(|line| line.starts_with("| planner | ") && !line.contains("never")), "{text}");
}

#[test]
fn incident_stop_by_operator_or_budget_is_named() {
    let mut sequence = Sequence::new(Clock::Lockstep);
    sequence.event(10, EventKind::Missed, Severity::Degraded, Detector::Deadline, "by chance");
    assert!(sequence.event(12, EventKind::Transition, Severity::Stopped, Detector::Operator, "estop"));
    assert!(sequence.text().contains("**What happened**: gate transition: estop.\n"), "{}", sequence.text());
    assert!(sequence.event(20, EventKind::Transition, Severity::Brake, Detector::Operator, "rearmed"));
    sequence.transition(40, Severity::Nominal);
    sequence.event(50, EventKind::Lost, Severity::Degraded, Detector::Tick, "stands still");
    assert!(sequence.event(51, EventKind::Transition, Severity::Stopped, Detector::Budget, "spent"));
    let text = sequence.text();
    assert!(text.contains("**What happened**: controller lost: stands still; the restart budget is spent.\n"), "{text}");
    assert!(text.contains("## 2. stopped at tick 51"), "{text}");
    assert_eq!(sequence.incidents.finish().map(|summary| summary.count), Some(2));
}

#[test]
fn cause_cleared_or_old_is_ignored() {
    let mut sequence = Sequence::new(Clock::Lockstep);
    sequence.event(10, EventKind::Missed, Severity::Degraded, Detector::Deadline, "long past");
    sequence.event(11, EventKind::Rejected, Severity::Degraded, Detector::Check, "just before");
    sequence.transition(61, Severity::Brake);
    let text = sequence.text();
    assert!(text.contains("controller rejected: just before.") && !text.contains("long past"), "{text}");
    assert!(text.contains("- time to brake: 50.0 ms"), "{text}");

    let mut sequence = Sequence::new(Clock::Lockstep);
    sequence.event(70, EventKind::Rejected, Severity::Degraded, Detector::Check, "cleared");
    sequence.transition(70, Severity::Degraded);
    sequence.transition(71, Severity::Nominal);
    sequence.transition(75, Severity::Brake);
    let text = sequence.text();
    assert!(text.contains("- time to brake: 0.0 ms") && !text.contains("cleared"), "{text}");
}

#[test]
fn incidents_flood_is_counted_and_bounded() {
    let mut sequence = Sequence::new(Clock::Lockstep);
    for number in 0..25 {
        for tick in 0..500 {
            sequence.event(1000 * number + tick, EventKind::Missed, Severity::Degraded, Detector::Deadline, "again");
        }
        sequence.transition(1000 * number + 500, Severity::Brake);
        for tick in 501..600 {
            sequence.event(1000 * number + tick, EventKind::Missed, Severity::Brake, Detector::Deadline, "again");
        }
        sequence.transition(1000 * number + 600, Severity::Nominal);
    }
    let summary = sequence.incidents.finish().unwrap();
    let text = sequence.text();
    assert_eq!((summary.count, text.matches("\n## ").count()), (25, 20));
    assert!(text.ends_with("\n5 further incidents are not described here; the log has them all.\n"), "{text}");
    assert_eq!(text.matches("severity ? -> nominal").count(), 20, "the end is listed, however many events there are");
    assert!(text.len() < 200_000, "{} bytes", text.len());
}

#[test]
fn incidents_none_removes_stale_file() {
    let folder = tempfile::tempdir().unwrap();
    let stale = folder.path().join("run.incidents.md");
    fs::write(&stale, "old").unwrap();
    let mut incidents = PostMortem::new(&folder.path().join("run.mcap"), Clock::Realtime, false);
    assert!(!stale.exists());
    assert_eq!(incidents.finish(), None);
    assert!(!stale.exists());
}

#[test]
fn incidents_of_lost_recorder_stay_and_are_counted() {
    let mut sequence = Sequence::new(Clock::Lockstep);
    sequence.brake(100, 110);
    sequence.transition(110, Severity::Nominal);
    assert!(sequence.transition(300, Severity::Brake), "open when its recorder is lost");
    let before = sequence.text();
    sequence.incidents = PostMortem::new(&sequence.folder.path().join("run.mcap"), Clock::Lockstep, true);
    assert_eq!(sequence.text(), before);
    assert!(sequence.transition(500, Severity::Brake));
    let after = sequence.text();
    assert!(after.starts_with(&before) && after.contains("\n## 3. brake at tick 500"), "{after}");
    assert_eq!(sequence.incidents.finish().unwrap().count, 3);
}

#[test]
fn incidents_unwritable_file_is_reported() {
    let mut sequence = Sequence::new(Clock::Lockstep);
    // A folder in place of the file cannot be replaced.
    let path = sequence.folder.path().join("run.incidents.md");
    fs::create_dir(&path).unwrap();
    assert!(sequence.transition(5, Severity::Brake));
    assert!(sequence.transition(6, Severity::Stopped));
    let summary = sequence.incidents.finish().unwrap();
    let error = summary.error.unwrap();
    assert!(error.contains("run.incidents.md: cannot write the post-mortem: "), "{error}");
    assert_eq!((summary.count, summary.file), (1, path));
    assert_eq!(fs::read_dir(sequence.folder.path()).unwrap().count(), 1);
}

#[test]
fn incidents_log_on_device_writes_no_file() {
    let mut incidents = PostMortem::new(Path::new("/dev/null"), Clock::Lockstep, false);
    let event = Event::new(5, Process::Gate, EventKind::Transition, Severity::Brake, Detector::Deadline, "brake");
    assert!(incidents.observe(&RecordedMessage::Event(event), &HeartbeatPage::private().unwrap()));
    let summary = incidents.finish().unwrap();
    assert!(summary.error.is_some_and(|error| error.starts_with("/dev/null: not a regular file")));
    assert!(!summary.file.exists());
}
