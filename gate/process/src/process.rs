//! The process of a gate: joins a run, and begins, or continues behind the last command of a gate that was lost.

use crate::change_exchange::ChangeThread;
use crate::node::{GateNode, GateStart};
use hapfic_config::Settings;
use hapfic_controller::parameters::TipPose;
use hapfic_gate::{GateLimits, ParameterSchedule, TorqueCheck};
use hapfic_ipc::realtime::{self, Prefault, SchedRequest};
use hapfic_ipc::{Bus, ChangePage, Domain, GatePage, IpcError, Orphanhood, Ownership, ProcessStart, RunFile, SharedStatus};
use hapfic_messages::{Clock, Process, RealtimeMode};
use hapfic_robot::Chain;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Size of the file table: the ports to all processes, and to their successors.
const FD_TABLE_SIZE: u64 = 512;

/// Error of the gate's process.
#[derive(Debug, thiserror::Error)]
pub enum GateError {
    /// Messaging, or the system.
    #[error(transparent)]
    Ipc(#[from] IpcError),
    /// The robot cannot be read.
    #[error(transparent)]
    Robot(#[from] hapfic_robot::RobotError),
}

/// Runs the gate of a run. Returns the last look at the run's supervisor.
///
/// # Errors
/// [`GateError`] if the run cannot be joined, or messaging fails.
pub fn run(run: &RunFile, settings: &Settings, own: Process, start: ProcessStart) -> Result<Orphanhood, GateError> {
    let system = |action| move |cause: std::io::Error| IpcError::System { action, cause };
    let terminated = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&terminated)).map_err(system("handle signals"))?;
    }
    let name = if own == Process::Gate { c"hapfic-gate" } else { c"hapfic-gate-2" };
    rustix::thread::set_name(name).map_err(|e| system("set the process's name")(e.into()))?;
    // Before any access to shared memory: an orphan must not touch it.
    let owner = Ownership::join(run, settings.supervisor.grace_ms)?;
    let realtime = run.clock == Clock::Realtime && run.realtime != RealtimeMode::Off;
    if realtime {
        realtime::lock_memory(Prefault::Used);
    }
    // A table that grows during the run delays a tick.
    let _ = realtime::reserve_fd_table(FD_TABLE_SIZE);
    hapfic_ipc::service::silence_transport_log();
    let domain = Domain::new(&run.prefix, &run.root)?.with_short_timeouts(run.clock);
    let chain = Chain::from_settings(&settings.robot)?;
    let bus = Bus::open(&domain, own.name())?;
    // A service that only the supervisor holds would be made anew by each successor, and may be left unusable by one.
    let _operator_service = hapfic_ipc::service::keep_alive(&bus)?;
    let page = Arc::new(ChangePage::open(&run.root)?);
    let [position, rpy] = run.start_pose;
    let (_changes, change_server) = ChangeThread::start(page)?;
    let priority = settings.realtime.priority_gate;
    // The spare gate shares the core of the controller, which notifies it, and sleeps there.
    let (core, polls) = match own {
        Process::SpareGate => (run.spare_core.or(run.core), false),
        _ => (run.gate_core, run.gate_busy_polls),
    };
    Ok(GateNode::run(
        GateStart {
            clock: run.clock,
            limits: GateLimits::new(settings, &chain),
            torque: TorqueCheck::new(chain, settings.world.gravity_m_per_s2),
            schedule: ParameterSchedule::new(settings, TipPose { position, rpy }),
            ticks: settings.duration_ticks as i64,
            deadline: Duration::from_micros(settings.supervisor.deadline_us.into()),
            sched: realtime.then(|| SchedRequest::new(priority, core)),
            deadline_timer: realtime.then(|| SchedRequest::new(priority, run.standby_core)),
            busy_poll_lead_us: if polls { settings.realtime.busy_poll_lead_us } else { 0 },
            own,
            gates: Arc::new(GatePage::open(&run.root)?),
            change_server,
            shared: SharedStatus::open(&run.root)?,
            generation: start.generation,
            terminated,
            owner,
        },
        &bus,
    )?)
}
