//! The stack in the middle of a run, for messages to arrive at.

use hapfic_config::Settings;
use hapfic_gate::protocol::{ControllerSlot, GateInputs, Observation};
use hapfic_gate::torque_check::TorqueCheck;
use hapfic_gate::{Gate, Limits};
use hapfic_log::Names;
use hapfic_messages::MAX_JOINTS;
use hapfic_plant::Plant;
use hapfic_robot::Chain;
use hapfic_simulation::{Simulation, Snapshot};
use nalgebra::Vector3;

/// The floor this high is reached soon after the first target is given, m.
const FLOOR: &str = "world.floor.height_m=0.12";
/// Ticks at which messages arrive: in the air, and in contact.
const AT: [i64; 2] = [20, 600];
/// Peak of the gate, N m.
pub(super) const PEAK: f64 = 40.0;

/// What stays as it is.
pub(super) struct Stage {
    pub(super) chain: Chain,
    pub(super) gravity: Vector3<f64>,
    pub(super) names: Names,
    pub(super) moments: Vec<Moment>,
}

/// A moment of a run.
#[derive(Clone)]
pub(super) struct Moment {
    /// What went through at its tick.
    pub(super) snapshot: Snapshot,
    /// At the tick after.
    pub(super) plant: Plant,
    /// At the tick after; it has accepted a request before.
    pub(super) gate: Gate,
}

thread_local! {
    static STAGE: Stage = Stage::new();
}

impl Stage {
    /// Does something with the stage, which is made once.
    pub(super) fn with<T>(act: impl FnOnce(&Self) -> T) -> T {
        STAGE.with(act)
    }

    fn new() -> Self {
        let settings = Settings::load("floor", &[FLOOR.to_owned()]).expect("an embedded scenario");
        let mut simulation = Simulation::new(&settings).expect("an embedded scenario");
        let chain = simulation.plant().chain().clone();
        let limits = Limits {
            joints: chain.dof(),
            bandwidth_hz: Some(100.0),
            peak: [PEAK; MAX_JOINTS],
            period_s: hapfic_config::PERIOD_S,
            ramp_rate: settings.supervisor.ramp_rate,
            discontinuity: settings.supervisor.discontinuity,
        };
        let mut gate = Gate::new(limits, TorqueCheck::new(chain.clone(), settings.world.gravity_m_per_s2));
        let mut moments = Vec::new();
        for tick in 0..=AT[AT.len() - 1] {
            let snapshot = *simulation.step().expect("an embedded scenario runs");
            gate.accept(ControllerSlot::First, &snapshot.command.request, &Observation::alone(), &GateInputs::default());
            if AT.contains(&tick) {
                moments.push(Moment { snapshot, plant: simulation.plant().clone(), gate: gate.clone() });
            }
        }
        let names = Names {
            joints: chain.joints().iter().map(|joint| joint.name.clone()).collect(),
            bodies: simulation.plant().body_names().to_vec(),
            objects: Vec::new(),
        };
        Self { chain, gravity: Vector3::from(settings.world.gravity_m_per_s2), names, moments }
    }
}
