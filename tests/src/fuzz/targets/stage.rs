//! Stack in the middle of a run, as the receiver of messages.

use hapfic_config::Settings;
use hapfic_gate::protocol::{ControllerSlot, GateInputs, Observation};
use hapfic_gate::torque_check::TorqueCheck;
use hapfic_gate::{Gate, GateLimits};
use hapfic_log::Names;
use hapfic_messages::MAX_JOINTS;
use hapfic_plant::Plant;
use hapfic_robot::Chain;
use hapfic_simulation::{Simulation, Snapshot};
use nalgebra::Vector3;

/// Setting of a floor so high that the foot reaches it soon after the first target.
const FLOOR: &str = "world.floor.height_m=0.12";
/// Ticks of the snapshots: in the air, and in contact.
const SNAPSHOT_TICKS: [i64; 2] = [20, 600];
/// Peak torque of the gate [N m].
pub(super) const PEAK: f64 = 40.0;

/// Constant parts, and the snapshots.
pub(super) struct StackFixture {
    pub(super) chain: Chain,
    pub(super) gravity: Vector3<f64>,
    pub(super) names: Names,
    pub(super) snapshots: Vec<StackSnapshot>,
}

/// Stack between two ticks.
#[derive(Clone)]
pub(super) struct StackSnapshot {
    /// Messages of its tick.
    pub(super) messages: Snapshot,
    /// Plant at the next tick.
    pub(super) plant: Plant,
    /// Gate at the next tick; it has accepted a request before.
    pub(super) gate: Gate,
}

thread_local! {
    static FIXTURE: StackFixture = StackFixture::new();
}

impl StackFixture {
    /// Calls a function with the fixture, which each thread makes once.
    pub(super) fn with<T>(call: impl FnOnce(&Self) -> T) -> T {
        FIXTURE.with(call)
    }

    fn new() -> Self {
        let settings = Settings::load("floor", &[FLOOR.to_owned()]).expect("an embedded scenario");
        let mut simulation = Simulation::new(&settings).expect("an embedded scenario");
        let chain = simulation.plant().chain().clone();
        let limits = GateLimits {
            joints: chain.dof(),
            bandwidth_hz: Some(100.0),
            peak: [PEAK; MAX_JOINTS],
            period_s: hapfic_config::PERIOD_S,
            saturation: settings.supervisor.torque_saturation,
            ramp_rate: settings.supervisor.ramp_rate,
            torque_rate: settings.supervisor.torque_rate,
            discontinuity: settings.supervisor.discontinuity,
        };
        let mut gate = Gate::new(limits, TorqueCheck::new(chain.clone(), settings.world.gravity_m_per_s2));
        let mut snapshots = Vec::new();
        for tick in 0..=SNAPSHOT_TICKS[SNAPSHOT_TICKS.len() - 1] {
            let snapshot = *simulation.step().expect("an embedded scenario runs");
            gate.accept(ControllerSlot::First, &snapshot.command.request, &Observation::alone(), &GateInputs::default());
            if SNAPSHOT_TICKS.contains(&tick) {
                snapshots.push(StackSnapshot { messages: snapshot, plant: simulation.plant().clone(), gate: gate.clone() });
            }
        }
        let names = Names {
            joints: chain.joints().iter().map(|joint| joint.name.clone()).collect(),
            bodies: simulation.plant().body_names().to_vec(),
            objects: Vec::new(),
        };
        Self { chain, gravity: Vector3::from(settings.world.gravity_m_per_s2), names, snapshots }
    }
}
