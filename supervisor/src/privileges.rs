//! What real-time privileges a run has, and what it lacks: one table.

use crate::live::Live;
use anyhow::{Result, bail};
use hapfic_config::{Placement, Realtime, Settings};
use hapfic_ipc::message::Process;
use hapfic_ipc::realtime::{Granted, Privilege, privileges, reserve_core, shared_core};
use hapfic_ipc::{Clock, RealtimeMode};
use std::fmt::Write;

/// Refuses to go on if all privileges are required and one cannot be had.
///
/// # Errors
/// The table of what is there and what is not.
pub fn require(settings: &Settings, clock: Clock, mode: RealtimeMode) -> Result<()> {
    if mode != RealtimeMode::Require {
        return Ok(());
    }
    if clock == Clock::Lockstep {
        bail!("--realtime require: found --clock lockstep, which has no real time; expected --clock realtime");
    }
    let list = privileges(settings.realtime.priority_plant as i32);
    if list.iter().any(|p| !p.granted) {
        bail!("--realtime require: this user lacks what real time needs\n{}", table(&list));
    }
    Ok(())
}

/// The cores of threads that the settings give none; none: any.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cores {
    /// Of all but the controller in reserve, and the gate.
    pub shared: Option<u32>,
    /// Of the controller in reserve.
    pub reserve: Option<u32>,
    /// Of the gate.
    pub gate: Option<u32>,
    /// Whether the gate may look out for requests: it has a core on which it keeps neither plant nor controller from the processor.
    pub gate_looks_out: bool,
}

impl Cores {
    /// Of the `others + 1`-th run on this machine; `fifo`: whether its threads can be real-time ones.
    ///
    /// A gate that [looks out](hapfic_ipc::Foresight) for requests needs a core of its own, or nearly so: as long as there are two for each
    /// run it has one. Otherwise it sleeps on the core of all, where it is woken soonest.
    #[must_use]
    pub fn new(wanted: &Realtime, others: usize, fifo: bool) -> Self {
        let enough = hapfic_ipc::realtime::usable_cores().len() >= 2 * (others + 1);
        let first = if enough { 2 * others } else { others };
        let (shared, reserve) = match wanted.placement {
            Placement::OneCore => (shared_core(first), reserve_core(first)),
            Placement::Free => (None, None),
        };
        let looks_out = fifo && enough && wanted.look_out_us > 0;
        let gate = wanted.core_gate.or(if looks_out { reserve } else { shared });
        let waited_for = [wanted.core_plant, wanted.core_controller].map(|core| core.or(shared));
        let apart = gate.is_some() && waited_for.iter().all(|core| core.is_some() && *core != gate);
        Self { shared, reserve, gate, gate_looks_out: looks_out && apart }
    }
}

/// A real-time thread and what it asks for.
struct Row {
    name: &'static str,
    process: Process,
    priority: u32,
    core: Option<u32>,
}

fn rows(settings: &Settings, cores: Cores) -> Vec<Row> {
    let rt = &settings.realtime;
    [
        ("plant", Process::Plant, rt.priority_plant, rt.core_plant),
        ("gate", Process::Supervisor, rt.priority_gate, cores.gate),
        ("controller", Process::Controller, rt.priority_controller, rt.core_controller),
        ("standby", Process::Standby, rt.priority_controller - 1, rt.core_standby.or(cores.reserve)),
        ("planner", Process::Planner, rt.priority_planner, rt.core_planner),
    ]
    .into_iter()
    .filter(|(_, process, ..)| *process != Process::Standby || settings.supervisor.standby)
    .map(|(name, process, priority, core)| Row { name, process, priority, core: core.or(cores.shared) })
    .collect()
}

/// What threads asked for and did not get: who, and what.
#[must_use]
pub fn missing(settings: &Settings, cores: Cores, live: &Live) -> Vec<(&'static str, String)> {
    let mut missing = Vec::new();
    for row in rows(settings, cores) {
        let granted = Granted(live.pulse(row.process).realtime());
        if !granted.has(Granted::FIFO) {
            missing.push((row.name, format!("SCHED_FIFO at priority {}", row.priority)));
        }
        if !granted.has(Granted::LOCKED) {
            missing.push((row.name, "its memory locked".to_owned()));
        }
        if let Some(core) = row.core.filter(|_| !granted.has(Granted::PINNED)) {
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

/// Says in one table what the run got: the machine's side, and each process's.
pub fn report(settings: &Settings, mode: RealtimeMode, cores: Cores, live: &Live) {
    let mut out = String::from("real time:");
    if mode == RealtimeMode::Off {
        out.push_str(" off, nothing asked for");
    } else {
        let _ = write!(out, "\n{}", table(&privileges(settings.realtime.priority_plant as i32)));
        for Row { name, process, priority, core } in rows(settings, cores) {
            let granted = Granted(live.pulse(process).realtime());
            let fifo = if granted.has(Granted::FIFO) { format!("FIFO {priority}") } else { "not FIFO".to_owned() };
            let memory = if granted.has(Granted::LOCKED) { "memory locked" } else { "memory not locked" };
            let core = match core {
                None => "any core".to_owned(),
                Some(c) if granted.has(Granted::PINNED) => format!("core {c}"),
                Some(c) => format!("NOT on core {c}"),
            };
            let _ = writeln!(out, "  {name:<14} {fifo}, {memory}, {core}");
        }
    }
    crate::say(out.trim_end());
}
