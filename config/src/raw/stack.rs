//! Supervisor, real-time set-up, recorder and processes as written.

use super::PerJoint;
use crate::policy::Placement;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The torque gate and the watchdog.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawSupervisor {
    /// How long after the state the gate waits for a request, us, an integer in [50, 950]. Raising it forgives slower
    /// controllers and leaves the plant less time.
    pub(crate) deadline_us: u32,

    /// Bandwidth of the first-order torque filter, Hz, in (0, 500]; without it there is no filter. Lowering it smooths the
    /// torque and adds delay: 20 Hz without joint damping oscillates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) torque_bandwidth_hz: Option<f64>,

    /// Peak of the torque after the filter, N m (N for a prismatic joint), in (0, 1e5]: a number for all joints, or a list.
    /// Without it the joints' effort limit. Raising it clips less.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) torque_peak_n_m: Option<PerJoint>,

    /// How long a process may take to get ready, ms, an integer in [100, 600000]. Raising it forgives slow starts.
    pub(crate) ready_timeout_ms: u32,

    /// Age of the last sign of life at which a process counts as lost, ms, an integer in [200, 60000]. Five times as long
    /// in lockstep. Raising it detects hangs later and raises fewer false alarms.
    pub(crate) heartbeat_timeout_ms: u32,

    /// How long no tick may be done while every process is alive, ms, an integer in [500, 600000]. Raising it bears more load
    /// on the machine.
    pub(crate) stall_timeout_ms: u32,

    /// How long a process may be alive without doing a tick while others do, ms, an integer in [50, 60000]. Raising it detects
    /// a process that hangs later and bears longer pauses.
    pub(crate) tick_timeout_ms: u32,

    /// Whether a second controller computes every request, too, and takes over within the tick in which the first one fails.
    /// Without it the limb brakes until a controller is back.
    pub(crate) standby: bool,

    /// How many times one process may be started again within the window, an integer in [0, 1000000]; one loss more is a
    /// stop that stays. Raising it keeps a run up that loses processes often.
    pub(crate) restart_budget: u32,

    /// The window in which restarts count, ms, an integer in [100, 3600000]. Raising it spends the budget sooner.
    pub(crate) restart_window_ms: u32,

    /// How long the second restart within a window waits, ms, an integer in [0, 60000]; the first one is at once, each further
    /// one waits twice as long, at most 1 s. Raising it spares the machine and leaves the place empty for longer.
    pub(crate) restart_backoff_ms: u32,

    /// Most that a joint's torque may change per second while it comes back after a brake, N m/s (N/s for a prismatic joint),
    /// in (0, 1e7]. Raising it brings the full torque back sooner and with a harder jerk.
    pub(crate) ramp_rate_n_m_per_s: f64,

    /// Step of a joint's torque from one tick to the next above which an event is written, N m (N for a prismatic joint), in
    /// (0, 1e5]. Raising it reports fewer.
    pub(crate) discontinuity_n_m: f64,

    /// In lockstep: how many ticks the plant may be ahead of the recorder, an integer in [1, 1000000]. Raising it takes
    /// more memory and waits less.
    pub(crate) credit_ticks: u32,
}

impl Default for RawSupervisor {
    fn default() -> Self {
        Self {
            deadline_us: 800,
            torque_bandwidth_hz: None,
            torque_peak_n_m: None,
            ready_timeout_ms: 10_000,
            heartbeat_timeout_ms: 1000,
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
    /// An integer in [1, 98]; a higher one runs first.
    pub(crate) priority_plant: u32,
    /// An integer in [1, 98]; a higher one runs first.
    pub(crate) priority_gate: u32,
    /// An integer in [1, 98]; a higher one runs first.
    pub(crate) priority_controller: u32,
    /// An integer in [1, 98]; a higher one runs first.
    pub(crate) priority_planner: u32,
    /// `one_core`: threads without a core below share one; `free`: they run wherever the scheduler puts them.
    pub(crate) placement: Placement,
    /// us, an integer in [0, 500]: how long before a state is due the controller, and the gate if it has another core, are awake and look
    /// out for it instead of sleeping; 0: never. Above 25 they go through the tick's work beforehand. A gate on a core of its own has an
    /// understudy where the controller is.
    pub(crate) busy_poll_lead_us: u32,
    /// Processor core, an integer in [0, 1023]; without it as `placement` says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) core_plant: Option<u32>,
    /// Processor core, an integer in [0, 1023]; without it as `placement` says: with `one_core` another core than plant and controller, if
    /// there is one and it looks out for requests.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) core_gate: Option<u32>,
    /// Processor core, an integer in [0, 1023]; without it as `placement` says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) core_controller: Option<u32>,
    /// Processor core of the controller in reserve, an integer in [0, 1023]; without it as `placement` says: with `one_core` another
    /// core than the others', if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) core_standby: Option<u32>,
    /// Processor core, an integer in [0, 1023]; without it as `placement` says.
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
    /// How often the file is flushed, ms, an integer in [1, 10000]. Raising it writes less often and loses more in a crash.
    pub(crate) flush_ms: u32,

    /// How many scenes a second are logged for a viewer, Hz, in (0, 1000]. Raising it makes the log larger.
    pub(crate) viewer_rate_hz: f64,

    /// Size of a chunk of the file before compression, KiB, an integer in [1, 65536]. Raising it compresses better.
    pub(crate) chunk_kib: u32,
}

impl Default for RawRecorder {
    fn default() -> Self {
        Self { flush_ms: 50, viewer_rate_hz: 60.0, chunk_kib: 256 }
    }
}

/// Foreign commands in place of built-in processes: program and arguments, each a string of its own.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawProcesses {
    /// In place of the simulated plant, such as the driver of a real robot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) plant: Option<Vec<String>>,
    /// In place of the planner.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) planner: Option<Vec<String>>,
    /// In place of the controllers, primary and standby.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) controller: Option<Vec<String>>,
}
