//! A scenario as written. The doc comments of the keys are their descriptions in the JSON Schema.

mod body;
mod fault;
mod law;
mod per_joint;
mod stack;

pub(crate) use body::{RawFoot, RawObject, RawPlant, RawRobot, RawWorld};
pub(crate) use fault::{RawFault, RawTargets};
pub(crate) use law::{RawController, RawOperator, RawPlanner};
pub(crate) use per_joint::PerJoint;
pub(crate) use stack::{RawProcesses, RawRealtime, RawRecorder, RawSupervisor};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A scenario: robot, world, controller, and the operator's changes.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
#[schemars(title = "HapFIC scenario")]
pub(crate) struct RawScenario {
    /// Summary in one line.
    #[serde(default)]
    pub(crate) title: String,

    /// Purpose of the scenario, in a few sentences.
    #[serde(default)]
    pub(crate) description: String,

    /// Simulated time [s], in [0.001, 86400]; rounded to whole ticks of 1 ms. Raising it makes the run and its log longer.
    #[serde(default = "default_duration_s")]
    pub(crate) duration_s: f64,

    /// Seed of all random numbers, an integer in [0, 9223372036854775807]. Another seed gives another run; none is better.
    #[serde(default = "default_seed")]
    pub(crate) seed: u64,

    /// The robot.
    pub(crate) robot: RawRobot,

    /// Surroundings of the robot.
    #[serde(default)]
    pub(crate) world: RawWorld,

    /// The simulated plant.
    #[serde(default)]
    pub(crate) plant: RawPlant,

    /// Parameters of the controller at the start.
    #[serde(default)]
    pub(crate) controller: RawController,

    /// Parameters of the planner at the start.
    #[serde(default)]
    pub(crate) planner: RawPlanner,

    /// Gate and watchdog.
    #[serde(default)]
    pub(crate) supervisor: RawSupervisor,

    /// Priorities and cores of the processes.
    #[serde(default)]
    pub(crate) realtime: RawRealtime,

    /// The log.
    #[serde(default)]
    pub(crate) recorder: RawRecorder,

    /// External processes that replace built-in ones.
    #[serde(default)]
    pub(crate) processes: RawProcesses,

    /// Changes by the operator, in the order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) operator: Vec<RawOperator>,

    /// Injected faults, in any order.
    #[serde(default, rename = "fault", skip_serializing_if = "Vec::is_empty")]
    pub(crate) faults: Vec<RawFault>,
}

fn default_duration_s() -> f64 {
    10.0
}

fn default_seed() -> u64 {
    1
}

impl Default for RawScenario {
    /// All defaults; a key without a default is empty.
    fn default() -> Self {
        Self {
            title: String::new(),
            description: String::new(),
            duration_s: default_duration_s(),
            seed: default_seed(),
            robot: RawRobot::default(),
            world: RawWorld::default(),
            plant: RawPlant::default(),
            controller: RawController::default(),
            planner: RawPlanner::default(),
            supervisor: RawSupervisor::default(),
            realtime: RawRealtime::default(),
            recorder: RawRecorder::default(),
            processes: RawProcesses::default(),
            operator: Vec::new(),
            faults: Vec::new(),
        }
    }
}
