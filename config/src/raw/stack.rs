//! Supervisor, real-time settings, recorder and processes as written.

use super::PerJoint;
use crate::policy::{OnFailure, Placement, TorqueSaturation};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The torque gate and the watchdog.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawSupervisor {
    /// Time that the gate waits for a request after the state [us], an integer in [50, 950]. Raising it tolerates slower
    /// controllers and leaves the plant less time.
    pub(crate) deadline_us: u32,

    /// Bandwidth of the first-order torque filter [Hz], in (0, 500]; default: no filter. Lowering it smooths the torque and adds
    /// delay: 20 Hz without joint damping oscillates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) torque_bandwidth_hz: Option<f64>,

    /// Peak of the torque after the filter [N m; N for a prismatic joint], in (0, 1e5]: a number for all joints, or a list.
    /// Default: the joints' effort limit. Raising it clips less.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) torque_peak_n_m: Option<PerJoint>,

    /// Torques beyond their peak: `clip` cuts each joint to its peak; `scale` scales all joints together by the smallest
    /// peak / |torque|, so that the direction of the force on the foot stays. `scale` also scales gravity compensation: a
    /// saturated limb sinks. The filter's state is not limited. With `scale`, rate limit and ramp slow all joints together.
    pub(crate) torque_saturation: TorqueSaturation,

    /// Largest rate of every joint's torque at any active tick, from the last torque sent [N m/s; N/s for a prismatic joint],
    /// in (0, 1e7]; default: no limit. It acts on the filtered torque; within the ramp after a brake the smaller rate counts.
    /// Raising it lets the torque follow the law sooner and with more jerk; lowering it adds delay, and can make stable gains
    /// oscillate: `hapfic check` tells.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) torque_rate_n_m_per_s: Option<f64>,

    /// Longest start-up time of a process [ms], an integer in [100, 600000]. Raising it tolerates slow starts.
    pub(crate) ready_timeout_ms: u32,

    /// Heartbeat age at which a process counts as lost [ms], an integer in [200, 60000]. Five times as long in lockstep.
    /// Raising it detects hangs later and causes fewer false detections.
    pub(crate) heartbeat_timeout_ms: u32,

    /// Time that a run goes on without a supervisor [ms], an integer in [200, 60000]: then the gates let the drive brake, and
    /// all processes end. A lost supervisor has a successor within some ten milliseconds. Raising it covers a slower machine.
    pub(crate) grace_ms: u32,

    /// Longest time without a tick while every process is alive [ms], an integer in [500, 600000]. Raising it tolerates more
    /// load on the machine.
    pub(crate) stall_timeout_ms: u32,

    /// Longest time of a process without a tick while other processes run ticks [ms], an integer in [50, 60000]. Raising it
    /// detects hangs later and tolerates longer pauses.
    pub(crate) tick_timeout_ms: u32,

    /// Whether a second controller computes every request too, and takes over within the tick in which the first one fails.
    /// Without it the robot brakes until a controller is ready again.
    pub(crate) standby: bool,

    /// Restarts of one process that the window allows, an integer in [0, 1000000]; a further loss trips the latched stop.
    /// Raising it continues a run that loses processes often.
    pub(crate) restart_budget: u32,

    /// Window in which restarts count [ms], an integer in [100, 3600000]. Raising it exhausts the budget sooner.
    pub(crate) restart_window_ms: u32,

    /// Delay of the second restart within a window [ms], an integer in [0, 60000]. The first restart is immediate; each further
    /// one waits twice as long, at most 1 s. Raising it spares the machine and leaves the slot empty for longer.
    pub(crate) restart_backoff_ms: u32,

    /// Largest rate of a joint's torque while it ramps in after a brake [N m/s; N/s for a prismatic joint], in (0, 1e7]. Raising
    /// it restores the full torque sooner and with more jerk.
    pub(crate) ramp_rate_n_m_per_s: f64,

    /// Step of a joint's torque between two ticks above which the gate reports an event [N m; N for a prismatic joint], in
    /// (0, 1e5]. Raising it reports fewer.
    pub(crate) discontinuity_n_m: f64,

    /// In lockstep: lead of the plant over the recorder [ticks], an integer in [1, 1000000]. Raising it takes more memory and
    /// waits less.
    pub(crate) credit_ticks: u32,
}

impl Default for RawSupervisor {
    fn default() -> Self {
        Self {
            deadline_us: 800,
            torque_bandwidth_hz: None,
            torque_peak_n_m: None,
            torque_saturation: TorqueSaturation::default(),
            torque_rate_n_m_per_s: None,
            ready_timeout_ms: 10_000,
            heartbeat_timeout_ms: 1000,
            grace_ms: 2000,
            stall_timeout_ms: 10_000,
            tick_timeout_ms: 300,
            standby: true,
            restart_budget: 5,
            restart_window_ms: 10_000,
            restart_backoff_ms: 10,
            ramp_rate_n_m_per_s: 2000.0,
            discontinuity_n_m: 10.0,
            credit_ticks: 1024,
        }
    }
}

/// Real-time priorities (SCHED_FIFO) and cores. Priorities must fall in the order plant, gate, controller, planner.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawRealtime {
    /// Priority, an integer in [1, 98]; a higher one runs first.
    pub(crate) priority_plant: u32,
    /// Priority, an integer in [1, 98]; a higher one runs first.
    pub(crate) priority_gate: u32,
    /// Priority, an integer in [1, 98]; a higher one runs first.
    pub(crate) priority_controller: u32,
    /// Priority, an integer in [1, 98]; a higher one runs first.
    pub(crate) priority_planner: u32,
    /// `one_core`: threads without a core below share one; `free`: the scheduler chooses their cores.
    pub(crate) placement: Placement,
    /// Busy-poll window [us], an integer in [0, 500]: the controller, and a gate on another core, poll for a state from this
    /// long before it is due; 0: they sleep. Above 25 they warm up the cache with a dry run of the tick. A gate on a core of
    /// its own has its spare gate on the controller's core.
    pub(crate) busy_poll_lead_us: u32,
    /// Processor core, an integer in [0, 1023]; default by `placement`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) core_plant: Option<u32>,
    /// Processor core, an integer in [0, 1023]; default by `placement`: with `one_core` another core than plant and controller,
    /// if there is one and the gate polls for requests.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) core_gate: Option<u32>,
    /// Processor core, an integer in [0, 1023]; default by `placement`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) core_controller: Option<u32>,
    /// Processor core of the standby controller, an integer in [0, 1023]; default by `placement`: with `one_core` a core that
    /// no other thread has, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) core_standby: Option<u32>,
    /// Processor core, an integer in [0, 1023]; default by `placement`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) core_planner: Option<u32>,
}

impl Default for RawRealtime {
    fn default() -> Self {
        Self {
            priority_plant: 80,
            priority_gate: 78,
            priority_controller: 76,
            priority_planner: 72,
            placement: Placement::default(),
            busy_poll_lead_us: 100,
            core_plant: None,
            core_gate: None,
            core_controller: None,
            core_standby: None,
            core_planner: None,
        }
    }
}

/// The log.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawRecorder {
    /// Interval between flushes of the file [ms], an integer in [1, 10000]. Raising it loses more data in a crash.
    pub(crate) flush_ms: u32,

    /// Rate of the logged viewer frames [Hz], in [1, 1000]. Raising it makes the log larger.
    pub(crate) viewer_rate_hz: f64,

    /// Size of a chunk of the file before compression [KiB], an integer in [1, 65536]. Raising it compresses better.
    pub(crate) chunk_kib: u32,

    /// Size at which the log goes on in a new part, `NAME.part2.mcap` and so on [MB], an integer in [1, 1000000]. Default: one file.
    /// Every part can be read alone; `report`, `recover` and `timeline` read all parts of `NAME.mcap`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) part_mb: Option<u32>,

    /// Size of all parts above which the oldest but the first are removed [MB], an integer in [2, 100000000], at least four times
    /// `part_mb`. Default: all stay.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) keep_mb: Option<u32>,

    /// Free space of the disk below which the log ends, before the disk is full [MB], an integer in [0, 1000000].
    pub(crate) min_free_mb: u32,

    /// What follows when the log can no longer be written: a full disk, a deleted folder.
    pub(crate) on_failure: OnFailure,
}

impl Default for RawRecorder {
    fn default() -> Self {
        Self {
            flush_ms: 50,
            viewer_rate_hz: 60.0,
            chunk_kib: 256,
            part_mb: None,
            keep_mb: None,
            min_free_mb: 64,
            on_failure: OnFailure::Stop,
        }
    }
}

/// External processes that replace built-in ones: program and arguments, each a separate string.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawProcesses {
    /// Replaces the simulated plant, such as the driver of a real robot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) plant: Option<Vec<String>>,
    /// Replaces the planner.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) planner: Option<Vec<String>>,
    /// Replaces the controllers, primary and standby.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) controller: Option<Vec<String>>,
}
