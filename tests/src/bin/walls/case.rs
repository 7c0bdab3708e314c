//! Cases of the table of walls: wall, friction, desired force and what disturbs.

use hapfic_config::{OperatorChange, Settings};
use hapfic_plant::ContactLaw;

/// Mass of the damping ratio of a wall [kg]: the leg's effective mass along z is about that.
pub(crate) const MASS_KG: f64 = 0.5;
/// Tick of the step to F_d.
pub(crate) const STEP_TICK: i64 = 2600;
/// Ticks of a case.
pub(crate) const TICKS: i64 = 4600;
/// Stiffnesses [N/m].
pub(crate) const STIFFNESSES: [f64; 5] = [1e3, 1e4, 1e5, 1e6, 1e7];
/// Damping ratios; `None`: the paper's, b = 0.01 s k.
pub(crate) const RATIOS: [Option<f64>; 5] = [Some(0.03), Some(0.1), Some(0.3), Some(1.0), None];
/// Desired forces [N].
pub(crate) const FORCES: [f64; 6] = [5.0, 10.0, 20.0, 50.0, 100.0, 200.0];

/// Walls and forces between those above: the constants of the law were not chosen on them.
const BETWEEN: ([f64; 4], [Option<f64>; 2], [f64; 2], [f64; 3]) =
    ([3e3, 3e4, 3e5, 3e6], [Some(0.05), Some(0.2)], [0.0, 0.25], [7.0, 35.0, 150.0]);

/// A law under test, with its settings.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Law {
    pub(crate) name: &'static str,
    pub(crate) overrides: &'static [&'static str],
}

/// The default, the law before it, and the paper's.
pub(crate) const LAWS: [Law; 3] = [
    Law { name: "default", overrides: &[] },
    Law {
        name: "fixed taper",
        overrides: &[
            "controller.search=tapered",
            "controller.taper=0.2",
            "controller.saturation=continuous",
            "controller.damping_sqrt_kg=0",
            "controller.force_hold=false",
            "controller.continuous_reentry=false",
            "controller.posture_lead_s=0",
        ],
    },
    Law { name: "as printed", overrides: &["controller.fidelity=paper"] },
];

/// What a case has beside wall, friction and force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Condition {
    /// Nothing.
    Plain,
    /// Noise of the force sensor with a standard deviation of 0.5 N.
    Noise,
    /// The floor is that much higher than planned [m].
    Height(f64),
    /// Torque bandwidth of 20 Hz, peak and joint damping of the scenario `ball-actuators`.
    Actuators,
}

impl Condition {
    pub(crate) const DISTURBED: [Self; 4] = [Self::Noise, Self::Height(0.015), Self::Height(-0.015), Self::Actuators];

    pub(crate) fn name(self) -> String {
        match self {
            Self::Plain => "plain".to_owned(),
            Self::Noise => "noise 0.5 N".to_owned(),
            Self::Height(m) => format!("height {:+.0} mm", m * 1e3),
            Self::Actuators => "20 Hz".to_owned(),
        }
    }
}

/// A case.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Case {
    pub(crate) law: Law,
    pub(crate) stiffness: f64,
    pub(crate) ratio: Option<f64>,
    pub(crate) friction: f64,
    pub(crate) force: f64,
    pub(crate) condition: Condition,
}

impl Case {
    /// All cases of a law: every wall with each friction and force, and at 50 N without friction each disturbance.
    pub(crate) fn all(law: Law) -> Vec<Self> {
        let mut cases = Vec::new();
        for stiffness in STIFFNESSES {
            for ratio in RATIOS {
                let plain = Self { law, stiffness, ratio, friction: 0.0, force: 50.0, condition: Condition::Plain };
                for friction in [0.0, 0.5] {
                    cases.extend(FORCES.map(|force| Self { friction, force, ..plain }));
                }
                cases.extend(Condition::DISTURBED.map(|condition| Self { condition, ..plain }));
            }
        }
        cases
    }

    /// Cases on walls between, without disturbance.
    pub(crate) fn between(law: Law) -> Vec<Self> {
        let (stiffnesses, ratios, frictions, forces) = BETWEEN;
        let mut cases = Vec::new();
        for (stiffness, ratio) in stiffnesses.into_iter().flat_map(|k| ratios.map(|ratio| (k, ratio))) {
            for friction in frictions {
                let case = |force| Self { law, stiffness, ratio, friction, force, condition: Condition::Plain };
                cases.extend(forces.map(case));
            }
        }
        cases
    }

    /// Damping of the wall [N s/m].
    pub(crate) fn damping(&self) -> f64 {
        self.ratio.map_or(0.01 * self.stiffness, |ratio| 2.0 * ratio * (self.stiffness * MASS_KG).sqrt())
    }

    /// Position bound [m]: a soft wall yields further than the default.
    fn position_bound(&self) -> f64 {
        if self.stiffness < 5e3 { 0.05 } else { 0.025 }
    }

    /// Whether the wall's resonance under F_d is one that the loop cannot damp: 225 to 710 Hz under 1 kHz.
    pub(crate) fn beyond_the_loop(&self) -> bool {
        let light = |most: f64| self.ratio.is_some_and(|ratio| ratio <= most);
        (self.stiffness > 5e6 && light(0.1)) || (self.stiffness > 5e5 && light(0.03))
    }

    /// Whether F_d is within reach: within the linear profile, and with an offset within its bound.
    pub(crate) fn within_reach(&self, settings: &Settings) -> bool {
        let (p, z) = (&settings.initial, 2);
        let Some(floor) = &settings.world.floor else { return false };
        let law = ContactLaw {
            stiffness: self.stiffness,
            damping: 0.0,
            transition_width: floor.surface.transition_width_m,
            friction_static: 0.0,
            friction_dynamic: 0.0,
            critical_speed: 1.0,
        };
        // The target lies 8 mm below contact with the planned floor.
        let planned = 0.008 + if let Condition::Height(height) = self.condition { height } else { 0.0 };
        let offset = self.force / p.stiffness[z] + law.depth_at(self.force) - planned;
        // Without contact nothing is searched.
        planned > 0.0
            && offset.abs() <= p.position_bound[z]
            && self.force <= 0.95 * p.max_force[z].min(p.stiffness[z] * p.position_bound[z])
    }

    /// Settings of the case.
    pub(crate) fn settings(&self) -> Settings {
        let bound = self.position_bound();
        let mut overrides: Vec<String> = vec![
            format!("world.floor.stiffness_n_per_m={:e}", self.stiffness),
            format!("world.floor.damping_n_s_per_m={:e}", self.damping()),
            format!("world.floor.friction_static={}", self.friction),
            format!("world.floor.friction_dynamic={}", 0.6 * self.friction),
            format!("controller.position_bound_m=[{bound}, {bound}, {bound}]"),
        ];
        match self.condition {
            Condition::Plain => {}
            Condition::Noise => overrides.push("plant.force_noise_n=0.5".to_owned()),
            Condition::Height(height) => overrides.push(format!("world.floor.height_m={height}")),
            Condition::Actuators => overrides.extend(
                [
                    "supervisor.torque_bandwidth_hz=20",
                    "supervisor.torque_peak_n_m=40",
                    "robot.joint_damping_n_m_s_per_rad=11.46",
                    "controller.stiffness_n_per_m=[6000, 6000, 6000]",
                    "controller.max_force_n=[150, 150, 150]",
                    "controller.taper=0.1",
                ]
                .map(ToOwned::to_owned),
            ),
        }
        overrides.extend(self.law.overrides.iter().map(|o| (*o).to_owned()));
        let mut settings = Settings::load("floor", &overrides).expect("the settings of a case are valid");
        settings.operator.retain(|change| change.at_tick < STEP_TICK && change.desired_force.is_none());
        settings.operator.push(OperatorChange {
            at_tick: STEP_TICK,
            desired_force: Some([0.0, 0.0, self.force]),
            ..OperatorChange::default()
        });
        settings
    }
}
