//! Realtime runs of the matrix, each beside an undisturbed run of the same length.

use crate::moment::{FaultEffect, measure};
use crate::runs::{LOG, RunFolder, RunResult};
use crate::trace::Trace;
use hapfic_messages::{EventKind, Process};
use std::collections::BTreeMap;
use std::time::Duration;

/// Length of a run [s]: a second and more after the last fault.
pub(crate) const DURATION_S: f64 = 6.2;
/// Ticks of a run.
pub(crate) const TICKS: usize = 6200;
/// Names of the phases.
pub(crate) const PHASES: [&str; 4] = ["free motion", "impact", "settled contact", "sliding"];
/// Time limit of a run.
pub(crate) const LIMIT: Duration = Duration::from_secs(60);
/// Largest delay of a signal [ticks]: the supervisor waits until the process runs.
const SIGNAL_DELAY_TICKS: i64 = 400;

/// Process, or pair of processes, of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum MatrixProcess {
    Primary,
    Standby,
    Both,
    Planner,
    Plant,
}

impl MatrixProcess {
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

    /// Names of the process in a scenario, for each phase. After a promotion the other controller is the next target.
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

/// Fault of the matrix.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MatrixFault {
    /// Name in the tables.
    pub(crate) name: &'static str,
    /// Kind in a scenario.
    pub(crate) kind: &'static str,
    /// Further keys in a scenario.
    pub(crate) more: &'static str,
    /// Whether the process misses more than two ticks, so the other controller becomes the primary.
    pub(crate) promotes: bool,
    /// Whether the supervisor sends a signal at the tick; otherwise it announces the fault in advance.
    signal: bool,
    /// Whether the fault also applies to both controllers, and to the plant.
    for_all: bool,
    /// Repetitions in a full and in a quick matrix.
    repetitions: (usize, usize),
}

/// All faults of the matrix.
pub(crate) const FAULTS: [MatrixFault; 9] = {
    const MESSAGE: MatrixFault =
        MatrixFault { name: "", kind: "", more: "", promotes: false, signal: false, for_all: true, repetitions: (3, 1) };
    const SIGNAL: MatrixFault = MatrixFault { promotes: true, signal: true, ..MESSAGE };
    [
        MatrixFault { name: "kill", kind: "kill", repetitions: (10, 2), ..SIGNAL },
        MatrixFault { name: "stop 50 ms", kind: "stop", more: ",for_ms=50", ..SIGNAL },
        MatrixFault { name: "stop 3 s", kind: "stop", more: ",for_ms=3000", for_all: false, ..SIGNAL },
        MatrixFault { name: "nan", kind: "nan", ..MESSAGE },
        MatrixFault { name: "stale", kind: "stale", ..MESSAGE },
        MatrixFault { name: "drop", kind: "drop", ..MESSAGE },
        MatrixFault { name: "repeat", kind: "repeat", ..MESSAGE },
        MatrixFault { name: "corrupt", kind: "corrupt", ..MESSAGE },
        MatrixFault { name: "slow 2000 us, 20 ticks", kind: "slow", more: ",for_ms=20,by_us=2000", promotes: true, ..MESSAGE },
    ]
};

impl MatrixFault {
    /// Whether the fault applies to a process.
    pub(crate) fn applies_to(&self, process: MatrixProcess) -> bool {
        self.for_all || !matches!(process, MatrixProcess::Both | MatrixProcess::Plant)
    }
}

/// Cell of the matrix: process and index of the fault.
pub(crate) type CellKey = (MatrixProcess, usize);

/// Results of a process and a fault.
#[derive(Debug, Default)]
pub(crate) struct CellResult {
    /// Disturbed runs, by phase.
    pub(crate) disturbed: [Vec<FaultEffect>; 4],
    /// Undisturbed runs, by phase.
    pub(crate) undisturbed: [Vec<FaultEffect>; 4],
    /// Ticks missing in the logs.
    pub(crate) missing: usize,
    /// Runs that did not complete, with their causes.
    pub(crate) incomplete: Vec<String>,
}

/// Setting with faults of one kind.
pub(crate) fn setting(kind: &str, more: &str, faults: &[(&str, usize)]) -> String {
    let entry = |(process, tick): &(&str, usize)| {
        format!("{{kind=\"{kind}\",process=\"{process}\",at_s={:.3}{more}}}", *tick as f64 * 1e-3)
    };
    format!("fault=[{}]", faults.iter().map(entry).collect::<Vec<_>>().join(","))
}

/// Settings of all runs: unlimited restarts without a delay.
pub(crate) fn settings() -> Vec<String> {
    ["supervisor.restart_budget=1000", "supervisor.restart_backoff_ms=0", "plant.on_loss=restart"].map(str::to_owned).to_vec()
}

impl MatrixFault {
    /// Whether the fault corrupts messages of the process.
    fn corrupts(&self) -> bool {
        !self.signal && self.kind != "slow"
    }
}

/// Runs the whole matrix; `phases` are the ticks of its faults.
pub(crate) fn matrix(folder: &RunFolder, phases: [usize; 4], quick: bool) -> BTreeMap<CellKey, CellResult> {
    let mut cells: BTreeMap<CellKey, CellResult> = BTreeMap::new();
    let count = |fault: &MatrixFault| if quick { fault.repetitions.1 } else { fault.repetitions.0 };
    let rounds = FAULTS.iter().map(count).max().unwrap_or(0);
    // Round by round, so a busy time of the machine affects all cells alike.
    for round in 0..rounds {
        for process in MatrixProcess::ALL {
            for (index, fault) in FAULTS.iter().enumerate().filter(|(_, fault)| fault.applies_to(process) && round < count(fault))
            {
                eprintln!("realtime, round {} of {rounds}: {}, {}", round + 1, process.name(), fault.name);
                let cell = cells.entry((process, index)).or_default();
                for disturbed in [round % 2 == 0, round % 2 != 0] {
                    run(folder, phases, process, fault, disturbed, cell);
                }
            }
        }
    }
    cells
}

fn run(
    folder: &RunFolder,
    phases: [usize; 4],
    process: MatrixProcess,
    fault: &MatrixFault,
    disturbed: bool,
    cell: &mut CellResult,
) {
    let targets = process.targets(fault.promotes);
    let mut all = settings();
    if process == MatrixProcess::Both {
        // Gravity compensation gives a torque that ramps in.
        all.push("controller.gravity_compensation=true".to_owned());
    }
    if disturbed {
        let faults: Vec<_> = targets.into_iter().zip(phases).collect();
        all.push(setting(fault.kind, fault.more, &faults));
    }
    let end = folder.floor("realtime", DURATION_S, &all, LIMIT);
    let trace = Trace::read(&folder.path(LOG));
    // The recorder rejects corrupted states too.
    let corrupted = if disturbed && process == MatrixProcess::Plant && fault.corrupts() { phases.len() } else { 0 };
    cell.missing += trace.missing(TICKS).saturating_sub(corrupted);
    if !end.completed() {
        cell.incomplete.push(cause(&end));
    }
    for (phase, at) in phases.into_iter().enumerate() {
        let next = phases.get(phase + 1).copied().unwrap_or(TICKS);
        if !disturbed {
            cell.undisturbed[phase].push(measure(&trace, at, next));
        } else if let Some(at) = fault_tick(&trace, at, targets[phase], fault.signal)
            && has_role(&trace, at, process, targets[phase])
        {
            cell.disturbed[phase].push(measure(&trace, at, next));
        }
    }
}

/// Result of an incomplete run, with its cause.
fn cause(end: &RunResult) -> String {
    let fault = end.out.lines().chain(end.err.lines()).find(|line| line.contains("FAULT") || line.starts_with("hapfic:"));
    format!("{} {}", end.outcome_text(), fault.unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" "))
}

/// Tick at which a fault took effect.
///
/// The supervisor sends a signal at its tick at the earliest, and reports it some ticks later. The first tick without
/// work of the process lies in between.
fn fault_tick(trace: &Trace, planned: usize, target: &str, signal: bool) -> Option<usize> {
    let window = planned as i64 - 5..planned as i64 + SIGNAL_DELAY_TICKS;
    let injected = trace.events(EventKind::Injected).find(|event| !signal || window.contains(&event.tick))?;
    if !signal {
        // Announced in advance; takes effect at its tick.
        return Some(planned);
    }
    let both = [Process::Controller, Process::Standby];
    let single = Process::from_name(target).map(|process| [process]);
    let processes = single.as_ref().map_or(&both[..], |single| &single[..]);
    let reported = usize::try_from(injected.tick).ok()?.max(planned);
    let done = trace.last_done(processes, planned.saturating_sub(1)..reported + 1);
    Some(done.map_or(planned, |tick| tick + 1).clamp(planned, reported))
}

/// Whether the faulted controller had the role of its row: on a busy machine the supervisor may have switched roles.
fn has_role(trace: &Trace, at: usize, process: MatrixProcess, target: &str) -> bool {
    let primary = trace.command(at.saturating_sub(1)).and_then(|command| command.controller);
    match process {
        MatrixProcess::Primary => primary.is_some_and(|primary| primary.name() == target),
        MatrixProcess::Standby => primary.is_none_or(|primary| primary.name() != target),
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::{FAULTS, MatrixProcess, fault_tick, setting};
    use crate::trace::{Trace, TraceEvent, TraceTick};
    use hapfic_messages::{EventKind, Process};

    #[test]
    fn fault_tick_signal_is_first_tick_not_done() {
        let mut trace = Trace { ticks: vec![TraceTick::default(); 900], ..Trace::default() };
        trace.ticks[..802].iter_mut().for_each(|tick| tick.done_by = 1 << Process::Standby.code());
        trace.events.push(TraceEvent { tick: 805, kind: Some(EventKind::Injected) });
        assert_eq!(fault_tick(&trace, 800, "standby", true), Some(802));
        assert_eq!(fault_tick(&trace, 800, "controllers", true), Some(802));
        // The process had ended before.
        assert_eq!(fault_tick(&trace, 800, "planner", true), Some(800));
        assert_eq!(fault_tick(&trace, 800, "standby", false), Some(800));
        assert_eq!(fault_tick(&trace, 300, "standby", true), None);
    }

    #[test]
    fn setting_two_faults_formatted() {
        let faults = [("controller", 800), ("standby", 1748)];
        assert_eq!(
            setting("stop", ",for_ms=50", &faults),
            "fault=[{kind=\"stop\",process=\"controller\",at_s=0.800,for_ms=50},{kind=\"stop\",process=\"standby\",at_s=1.748,for_ms=50}]"
        );
    }

    #[test]
    fn faults_all_accepted_by_config() {
        for process in MatrixProcess::ALL {
            for fault in FAULTS.iter().filter(|fault| fault.applies_to(process)) {
                let mut settings = super::settings();
                let faults: Vec<_> = process.targets(fault.promotes).into_iter().zip([800, 1748, 4200, 5000]).collect();
                settings.push(setting(fault.kind, fault.more, &faults));
                let loaded = hapfic_config::Settings::load("floor", &settings).unwrap();
                let ticks: Vec<_> = loaded.faults.iter().map(|fault| fault.tick).collect();
                assert_eq!(ticks, [800, 1748, 4200, 5000], "{} {}", process.name(), fault.name);
            }
        }
    }
}
