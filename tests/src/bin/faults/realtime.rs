//! The realtime runs of the matrix: each beside an undisturbed one of the same length.

use crate::moment::{Moment, measure};
use crate::runs::{End, LOG, Place};
use crate::trace::Trace;
use hapfic_messages::{EventKind, Process};
use std::collections::BTreeMap;
use std::time::Duration;

/// Length of a run, s: a second and more behind the last fault.
pub(crate) const DURATION_S: f64 = 6.2;
/// Its ticks.
pub(crate) const TICKS: usize = 6200;
/// Names of the phases.
pub(crate) const PHASES: [&str; 4] = ["free motion", "impact", "settled contact", "sliding"];
/// How long a run may take.
pub(crate) const LIMIT: Duration = Duration::from_secs(60);
/// Ticks by which the supervisor may be late with a signal, since it waits for the process to be there.
const LATEST: i64 = 400;

/// Where a fault happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Who {
    Primary,
    Standby,
    Both,
    Planner,
    Plant,
}

impl Who {
    pub(crate) const ALL: [Self; 5] = [Self::Primary, Self::Standby, Self::Both, Self::Planner, Self::Plant];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Primary => "controller (primary)",
            Self::Standby => "standby",
            Self::Both => "both controllers",
            Self::Planner => "planner",
            Self::Plant => "plant",
        }
    }

    /// Its name in a scenario, at each phase. After a fault that makes the other controller the primary, that one is meant next.
    pub(crate) const fn targets(self, promotes: bool) -> [&'static str; 4] {
        match self {
            Self::Primary if promotes => ["controller", "standby", "controller", "standby"],
            Self::Primary => ["controller"; 4],
            Self::Standby => ["standby"; 4],
            Self::Both => ["controllers"; 4],
            Self::Planner => ["planner"; 4],
            Self::Plant => ["plant"; 4],
        }
    }
}

/// A fault.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kind {
    /// In the tables.
    pub(crate) name: &'static str,
    /// In a scenario.
    pub(crate) kind: &'static str,
    /// What else belongs to it there.
    pub(crate) more: &'static str,
    /// The process is not there for more than two ticks, so the other controller becomes the primary.
    pub(crate) promotes: bool,
    /// It is done at its tick, as opposed to told ahead.
    signal: bool,
    /// It happens to both controllers or the plant, too.
    for_all: bool,
    /// Repetitions, and those of a quick matrix.
    repetitions: (usize, usize),
}

/// All faults.
pub(crate) const KINDS: [Kind; 9] = {
    const MESSAGE: Kind =
        Kind { name: "", kind: "", more: "", promotes: false, signal: false, for_all: true, repetitions: (3, 1) };
    const SIGNAL: Kind = Kind { promotes: true, signal: true, ..MESSAGE };
    [
        Kind { name: "kill", kind: "kill", repetitions: (10, 2), ..SIGNAL },
        Kind { name: "stop 50 ms", kind: "stop", more: ",for_ms=50", ..SIGNAL },
        Kind { name: "stop 3 s", kind: "stop", more: ",for_ms=3000", for_all: false, ..SIGNAL },
        Kind { name: "nan", kind: "nan", ..MESSAGE },
        Kind { name: "stale", kind: "stale", ..MESSAGE },
        Kind { name: "drop", kind: "drop", ..MESSAGE },
        Kind { name: "repeat", kind: "repeat", ..MESSAGE },
        Kind { name: "corrupt", kind: "corrupt", ..MESSAGE },
        Kind { name: "slow 2000 us, 20 ticks", kind: "slow", more: ",for_ms=20,by_us=2000", promotes: true, ..MESSAGE },
    ]
};

impl Kind {
    /// Whether it is done to this process.
    pub(crate) fn fits(&self, who: Who) -> bool {
        self.for_all || !matches!(who, Who::Both | Who::Plant)
    }
}

/// Place of a process and a fault in the matrix.
pub(crate) type Key = (Who, usize);

/// What came of a process and a fault.
#[derive(Debug, Default)]
pub(crate) struct Cell {
    /// By phase.
    pub(crate) disturbed: [Vec<Moment>; 4],
    /// The same of the undisturbed runs beside.
    pub(crate) beside: [Vec<Moment>; 4],
    /// Ticks that a log has not.
    pub(crate) missing: usize,
    /// Runs that did not complete, in words.
    pub(crate) broken: Vec<String>,
}

/// The setting of faults of one kind.
pub(crate) fn setting(kind: &str, more: &str, faults: &[(&str, usize)]) -> String {
    let one = |(process, tick): &(&str, usize)| {
        format!("{{kind=\"{kind}\",process=\"{process}\",at_s={:.3}{more}}}", *tick as f64 * 1e-3)
    };
    format!("fault=[{}]", faults.iter().map(one).collect::<Vec<_>>().join(","))
}

/// Settings of all runs: processes are started again as often and as soon as it takes.
pub(crate) fn settings() -> Vec<String> {
    ["supervisor.restart_budget=1000", "supervisor.restart_backoff_ms=0", "plant.on_loss=restart"].map(str::to_owned).to_vec()
}

impl Kind {
    /// Whether a message of the process is not what it should be.
    fn spoils(&self) -> bool {
        !self.signal && self.kind != "slow"
    }
}

/// Runs the whole matrix; `phases` are the ticks of its faults.
pub(crate) fn matrix(place: &Place, phases: [usize; 4], quick: bool) -> BTreeMap<Key, Cell> {
    let mut cells: BTreeMap<Key, Cell> = BTreeMap::new();
    let count = |kind: &Kind| if quick { kind.repetitions.1 } else { kind.repetitions.0 };
    let rounds = KINDS.iter().map(count).max().unwrap_or(0);
    // Round by round, so that a bad time of the machine spoils a repetition of each and not all of one.
    for round in 0..rounds {
        for who in Who::ALL {
            for (index, kind) in KINDS.iter().enumerate().filter(|(_, kind)| kind.fits(who) && round < count(kind)) {
                eprintln!("realtime, round {} of {rounds}: {}, {}", round + 1, who.name(), kind.name);
                let cell = cells.entry((who, index)).or_default();
                for disturbed in [round % 2 == 0, round % 2 != 0] {
                    run(place, phases, who, kind, disturbed, cell);
                }
            }
        }
    }
    cells
}

fn run(place: &Place, phases: [usize; 4], who: Who, kind: &Kind, disturbed: bool, cell: &mut Cell) {
    let targets = who.targets(kind.promotes);
    let mut all = settings();
    if who == Who::Both {
        // With the leg's weight to hold there is a torque to ramp in.
        all.push("controller.gravity_compensation=true".to_owned());
    }
    if disturbed {
        let faults: Vec<_> = targets.into_iter().zip(phases).collect();
        all.push(setting(kind.kind, kind.more, &faults));
    }
    let end = place.floor("realtime", DURATION_S, &all, LIMIT);
    let trace = Trace::read(&place.path(LOG));
    // A state that the plant itself has spoilt is rejected by the recorder, too.
    let spoilt = if disturbed && who == Who::Plant && kind.spoils() { phases.len() } else { 0 };
    cell.missing += trace.missing(TICKS).saturating_sub(spoilt);
    if !end.completed() {
        cell.broken.push(words(&end));
    }
    for (phase, at) in phases.into_iter().enumerate() {
        let next = phases.get(phase + 1).copied().unwrap_or(TICKS);
        if !disturbed {
            cell.beside[phase].push(measure(&trace, at, next));
        } else if let Some(at) = moment_of(&trace, at, targets[phase], kind.signal)
            && is_meant(&trace, at, who, targets[phase])
        {
            cell.disturbed[phase].push(measure(&trace, at, next));
        }
    }
}

/// How a run ended that should have completed.
fn words(end: &End) -> String {
    let fault = end.out.lines().chain(end.err.lines()).find(|line| line.contains("FAULT") || line.starts_with("hapfic:"));
    format!("{} {}", end.word(), fault.unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" "))
}

/// The tick at which a fault really happened.
///
/// A signal is sent at its tick at the earliest, and told of when the supervisor gets round to it: in between is the first tick that
/// the process has not done any more.
fn moment_of(trace: &Trace, planned: usize, target: &str, signal: bool) -> Option<usize> {
    let window = planned as i64 - 5..planned as i64 + LATEST;
    let told = trace.events(EventKind::Injected).find(|event| !signal || window.contains(&event.tick))?;
    if !signal {
        // Told ahead; happens at its tick.
        return Some(planned);
    }
    let both = [Process::Controller, Process::Standby];
    let one = Process::from_name(target).map(|process| [process]);
    let processes = one.as_ref().map_or(&both[..], |one| &one[..]);
    let told = usize::try_from(told.tick).ok()?.max(planned);
    let done = trace.last_done(processes, planned.saturating_sub(1)..told + 1);
    Some(done.map_or(planned, |tick| tick + 1).clamp(planned, told))
}

/// Whether the controller that was hit was what the row says: a busy host may have made the other one the primary.
fn is_meant(trace: &Trace, at: usize, who: Who, target: &str) -> bool {
    let made = trace.command(at.saturating_sub(1)).and_then(|command| command.controller);
    match who {
        Who::Primary => made.is_some_and(|made| made.name() == target),
        Who::Standby => made.is_none_or(|made| made.name() != target),
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::{KINDS, Who, moment_of, setting};
    use crate::trace::{Event, Tick, Trace};
    use hapfic_messages::{EventKind, Process};

    #[test]
    fn a_signal_hits_where_its_process_ends_and_not_where_it_is_told_of() {
        let mut trace = Trace { ticks: vec![Tick::default(); 900], ..Trace::default() };
        trace.ticks[..802].iter_mut().for_each(|tick| tick.done = 1 << Process::Standby.code());
        trace.events.push(Event { tick: 805, kind: Some(EventKind::Injected) });
        assert_eq!(moment_of(&trace, 800, "standby", true), Some(802));
        assert_eq!(moment_of(&trace, 800, "controllers", true), Some(802));
        // Dead before: nothing of it is found.
        assert_eq!(moment_of(&trace, 800, "planner", true), Some(800));
        assert_eq!(moment_of(&trace, 800, "standby", false), Some(800));
        assert_eq!(moment_of(&trace, 300, "standby", true), None);
    }

    #[test]
    fn faults_are_written_as_a_setting() {
        let faults = [("controller", 800), ("standby", 1748)];
        assert_eq!(
            setting("stop", ",for_ms=50", &faults),
            "fault=[{kind=\"stop\",process=\"controller\",at_s=0.800,for_ms=50},{kind=\"stop\",process=\"standby\",at_s=1.748,for_ms=50}]"
        );
    }

    #[test]
    fn every_fault_is_one_that_the_configuration_takes() {
        for who in Who::ALL {
            for kind in KINDS.iter().filter(|kind| kind.fits(who)) {
                let mut settings = super::settings();
                let faults: Vec<_> = who.targets(kind.promotes).into_iter().zip([800, 1748, 4200, 5000]).collect();
                settings.push(setting(kind.kind, kind.more, &faults));
                let loaded = hapfic_config::Settings::load("floor", &settings).unwrap();
                let ticks: Vec<_> = loaded.faults.iter().map(|fault| fault.tick).collect();
                assert_eq!(ticks, [800, 1748, 4200, 5000], "{} {}", who.name(), kind.name);
            }
        }
    }
}
