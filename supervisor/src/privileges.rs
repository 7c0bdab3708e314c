//! The real-time privileges that a run has and lacks, and the cores of its threads.

use anyhow::{Result, bail};
use hapfic_config::{Placement, RealtimeSettings, Settings};
use hapfic_ipc::SharedStatus;
use hapfic_ipc::realtime::{Privilege, SchedGrants, privileges, shared_core, standby_core};
use hapfic_messages::{Clock, Process, RealtimeMode};
use std::fmt::Write;

/// Rejects the run if `mode` requires all privileges and any is unavailable.
///
/// # Errors
/// The table of available and missing privileges.
pub fn require(settings: &Settings, clock: Clock, mode: RealtimeMode) -> Result<()> {
    if mode != RealtimeMode::Require {
        return Ok(());
    }
    if clock == Clock::Lockstep {
        bail!("--realtime require: found --clock lockstep, which has no real time; expected --clock realtime");
    }
    let list = privileges(settings.realtime.priority_plant as i32);
    if list.iter().any(|p| !p.granted) {
        bail!("--realtime require: found a missing privilege, expected all of these\n{}", table(&list));
    }
    Ok(())
}

/// The cores of threads to which the settings assign none; `None`: any core.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cores {
    /// Shared real-time core: all threads but the standby controller and the gate.
    pub shared: Option<u32>,
    /// Core of the standby controller.
    pub reserve: Option<u32>,
    /// Core of the gate.
    pub gate: Option<u32>,
    /// Whether the gate may busy-poll for requests, because plant and controller have other cores.
    pub gate_busy_polls: bool,
    /// Core of the spare gate if the gate busy-polls: the core of the controller, which notifies it.
    pub spare: Option<u32>,
}

impl Cores {
    /// Chooses the cores of the `others + 1`-th run on this machine; `fifo`: whether its threads can have SCHED_FIFO.
    ///
    /// A gate that [busy-polls](hapfic_ipc::ArrivalPredictor) for requests needs a core without plant and controller.
    /// So the first runs have two cores each. The gate of a further run sleeps on the shared real-time core, where its
    /// wake-up is fastest.
    #[must_use]
    pub fn new(realtime: &RealtimeSettings, others: usize, fifo: bool) -> Self {
        let (first, paired) = first_core(others, hapfic_ipc::realtime::usable_cores().len());
        let (shared, reserve) = match realtime.placement {
            Placement::OneCore => (shared_core(first), standby_core(first)),
            Placement::Free => (None, None),
        };
        let upstream_cores = [realtime.core_plant, realtime.core_controller].map(|core| core.or(shared));
        let separate = |gate: Option<u32>| gate.is_some() && upstream_cores.iter().all(|core| core.is_some() && *core != gate);
        let may_poll = fifo && realtime.busy_poll_lead_us > 0;
        let polls_on_reserve = may_poll && paired && separate(reserve);
        let gate = realtime.core_gate.or(if polls_on_reserve { reserve } else { shared });
        let gate_busy_polls = may_poll && paired && separate(gate);
        let spare = realtime.core_controller.or(shared).filter(|_| gate_busy_polls);
        Self { shared, reserve, gate, gate_busy_polls, spare }
    }
}

/// Returns the first core of the `others + 1`-th run, counted from the last core down, and whether it has the next too.
///
/// Each run has two cores as long as two are free. Later runs get a left-over core, then the cores of gates, which
/// need little time, then the cores of plants.
fn first_core(others: usize, cores: usize) -> (usize, bool) {
    let pairs = cores / 2;
    if others < pairs {
        return (2 * others, true);
    }
    let left_over = 2 * pairs..cores;
    let gates = (0..pairs).map(|pair| 2 * pair + 1);
    let plants = (0..pairs).map(|pair| 2 * pair);
    let all: Vec<usize> = left_over.chain(gates).chain(plants).collect();
    (all.get((others - pairs) % cores.max(1)).copied().unwrap_or(others), false)
}

/// A real-time thread, and its requested privileges.
struct ThreadPrivileges {
    name: &'static str,
    process: Process,
    priority: u32,
    core: Option<u32>,
}

fn thread_privileges(settings: &Settings, cores: Cores) -> Vec<ThreadPrivileges> {
    let rt = &settings.realtime;
    [
        ("plant", Process::Plant, rt.priority_plant, rt.core_plant),
        ("gate", Process::Gate, rt.priority_gate, cores.gate),
        ("spare_gate", Process::SpareGate, rt.priority_gate, cores.spare),
        ("controller", Process::Controller, rt.priority_controller, rt.core_controller),
        ("standby", Process::Standby, rt.priority_controller - 1, rt.core_standby.or(cores.reserve)),
        ("planner", Process::Planner, rt.priority_planner, rt.core_planner),
    ]
    .into_iter()
    .filter(|(_, process, ..)| *process != Process::Standby || settings.supervisor.standby)
    .map(|(name, process, priority, core)| ThreadPrivileges { name, process, priority, core: core.or(cores.shared) })
    .collect()
}

/// Lists the requested privileges that were not granted: thread and privilege.
#[must_use]
pub fn missing(settings: &Settings, cores: Cores, shared: &SharedStatus) -> Vec<(&'static str, String)> {
    let mut missing = Vec::new();
    for row in thread_privileges(settings, cores) {
        let granted = SchedGrants(shared.heartbeats.read(row.process).realtime);
        if !granted.has(SchedGrants::FIFO) {
            missing.push((row.name, format!("SCHED_FIFO at priority {}", row.priority)));
        }
        if !granted.has(SchedGrants::LOCKED) {
            missing.push((row.name, "its memory locked".to_owned()));
        }
        if let Some(core) = row.core.filter(|_| !granted.has(SchedGrants::PINNED)) {
            missing.push((row.name, format!("core {core}")));
        }
    }
    missing
}

fn table(list: &[Privilege]) -> String {
    let mut out = String::new();
    for p in list {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "  {:<14} {:<4} {}", p.name, if p.granted { "yes" } else { "NO" }, p.note);
    }
    out
}

/// Logs the privileges of the machine and of each process in one table.
pub fn report(settings: &Settings, mode: RealtimeMode, cores: Cores, shared: &SharedStatus) {
    let mut out = String::from("real time:");
    if mode == RealtimeMode::Off {
        out.push_str(" off, no privileges requested");
    } else {
        let _ = write!(out, "\n{}", table(&privileges(settings.realtime.priority_plant as i32)));
        for ThreadPrivileges { name, process, priority, core } in thread_privileges(settings, cores) {
            let granted = SchedGrants(shared.heartbeats.read(process).realtime);
            let fifo = if granted.has(SchedGrants::FIFO) { format!("FIFO {priority}") } else { "not FIFO".to_owned() };
            let memory = if granted.has(SchedGrants::LOCKED) { "memory locked" } else { "memory not locked" };
            let core = match core {
                None => "any core".to_owned(),
                Some(c) if granted.has(SchedGrants::PINNED) => format!("core {c}"),
                Some(c) => format!("NOT on core {c}"),
            };
            let _ = writeln!(out, "  {name:<14} {fifo}, {memory}, {core}");
        }
    }
    crate::log_line(out.trim_end());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_core_free_pair_left_gives_two_cores() {
        let first_cores = |cores| (0..6).map(|others| first_core(others, cores)).collect::<Vec<_>>();
        assert_eq!(first_cores(1), [(0, false); 6]);
        assert_eq!(first_cores(2), [(0, true), (1, false), (0, false), (1, false), (0, false), (1, false)]);
        assert_eq!(first_cores(3), [(0, true), (2, false), (1, false), (0, false), (2, false), (1, false)]);
        assert_eq!(first_cores(4), [(0, true), (2, true), (1, false), (3, false), (0, false), (2, false)]);
        assert_eq!(first_core(3, 0), (3, false), "number of cores unknown");
    }

    #[test]
    fn cores_gate_without_own_core_uses_shared_core() {
        let realtime = Settings::load("floor", &[]).map(|settings| settings.realtime);
        let Ok(realtime) = realtime else { panic!("no scenario floor") };
        let sleeping = Cores::new(&RealtimeSettings { busy_poll_lead_us: 0, ..realtime }, 0, true);
        assert_eq!((sleeping.gate, sleeping.gate_busy_polls), (sleeping.shared, false));
        assert_eq!(Cores::new(&realtime, 0, false).gate, sleeping.shared, "without privileges");
        let controller_on_reserve = Cores::new(&RealtimeSettings { core_controller: sleeping.reserve, ..realtime }, 0, true);
        assert_eq!(
            (controller_on_reserve.gate, controller_on_reserve.gate_busy_polls, controller_on_reserve.spare),
            (sleeping.shared, false, None)
        );
        let default = Cores::new(&realtime, 0, true);
        assert_eq!(default.gate_busy_polls, default.reserve != default.shared);
        assert_eq!(default.gate, if default.gate_busy_polls { default.reserve } else { default.shared });
        assert_eq!(default.spare, default.shared.filter(|_| default.gate_busy_polls));
        let swapped = RealtimeSettings { core_plant: default.reserve, core_controller: default.reserve, ..realtime };
        let swapped = Cores::new(&RealtimeSettings { core_gate: default.shared, ..swapped }, 0, true);
        assert!(!swapped.gate_busy_polls || swapped.spare == default.reserve, "the spare is on the core of the controller");
        let free = Cores::new(&RealtimeSettings { placement: Placement::Free, ..realtime }, 0, true);
        assert_eq!(free, Cores::default());
    }
}
