//! Scenarios and robot descriptions that are part of the executable.

/// A scenario that needs no file.
#[derive(Clone, Copy, Debug)]
pub struct Scenario {
    /// Name on the command line.
    pub name: &'static str,
    /// Summary in one line.
    pub title: &'static str,
    /// The TOML.
    pub text: &'static str,
}

const SCENARIOS: &[Scenario] = &[
    Scenario { name: "floor", title: "Press and slide on a frictionless floor", text: include_str!("../scenarios/floor.toml") },
    Scenario {
        name: "box",
        title: "Press, slide, tip a box over and strike it with the shank",
        text: include_str!("../scenarios/box.toml"),
    },
    Scenario {
        name: "ball",
        title: "Press a soft ball, kick it, and pass through the singularity",
        text: include_str!("../scenarios/ball.toml"),
    },
    Scenario {
        name: "ball-actuators",
        title: "The soft ball again, with actuators that have limits",
        text: include_str!("../scenarios/ball-actuators.toml"),
    },
    Scenario {
        name: "tuning",
        title: "Change every parameter while the foot presses on the floor",
        text: include_str!("../scenarios/tuning.toml"),
    },
    Scenario {
        name: "arm-press",
        title: "Press on a table and wipe a circle, tool upright",
        text: include_str!("../scenarios/arm-press.toml"),
    },
    Scenario { name: "arm-scan", title: "Scan a soft round body under 5 N", text: include_str!("../scenarios/arm-scan.toml") },
    Scenario {
        name: "arm-reach",
        title: "Reach near a singularity and a joint limit",
        text: include_str!("../scenarios/arm-reach.toml"),
    },
];

const ROBOTS: &[(&str, &str)] = &[
    ("leg.urdf", include_str!("../robots/leg.urdf")),
    ("quadruped-leg.urdf", include_str!("../robots/quadruped-leg.urdf")),
    ("arm6.urdf", include_str!("../robots/arm6.urdf")),
    ("arm7.urdf", include_str!("../robots/arm7.urdf")),
];

/// The embedded scenarios.
#[must_use]
pub fn scenarios() -> &'static [Scenario] {
    SCENARIOS
}

/// The embedded robot descriptions: name and URDF.
#[must_use]
pub fn robots() -> &'static [(&'static str, &'static str)] {
    ROBOTS
}
