//! Errors of building and running a world.

/// An error of the plant.
#[derive(Debug, thiserror::Error)]
pub enum PlantError {
    /// A state to resume from belongs to another robot or world.
    #[error("cannot resume from the last state: found {} joints and {} objects, expected {} and {}", found.0, found.1, expected.0, expected.1)]
    Resume {
        /// Joints and objects of the state.
        found: (usize, usize),
        /// Joints and objects of robot and world.
        expected: (usize, usize),
    },
    /// What the engine remembered at the tick of the last state is not there.
    #[error("cannot resume from the last state: found no memory of the engine at its tick, or another world's")]
    Memory,
    /// The robot description is invalid.
    #[error(transparent)]
    Robot(#[from] hapfic_robot::RobotError),
    /// The tip link has no collision shape.
    #[error(
        "link '{link}': found no collision shape, expected spheres, a capsule or a box: the tip link must be able to touch the floor and the objects. Hint: robot.foot gives it some, such as radius_m = 0.02"
    )]
    NoFoot {
        /// The tip link.
        link: String,
    },
    /// The foot has a shape for which there is no contact rule.
    #[error(
        "link '{link}': found {shape} as collision shape of the foot, expected spheres, a capsule or a box. Hint: robot.foot puts spheres or a box in its place"
    )]
    FootShape {
        /// The tip link.
        link: String,
        /// Its shape.
        shape: String,
    },
    /// Two bodies have the same name.
    #[error(
        "world.object: found '{name}' as a name, expected one that neither a link nor another body has: the log identifies contacts by it"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// A body starts inside another one.
    #[error(
        "{body} starts {depth_m:.4} m deep in {against}, expected at most {limit_m:.4} m: move one of them (robot.base_position_m, robot.start_position_rad, world.object.position_m)"
    )]
    StartsInside {
        /// Penetration depth [m].
        depth_m: f64,
        /// The penetrating body.
        body: String,
        /// The penetrated body.
        against: String,
        /// Transition width of the contact plus the depth under the bodies' own weight [m].
        limit_m: f64,
    },
    /// The start posture does not fit the robot.
    #[error("robot.start_position_rad{place}: found {found}, expected {expected}")]
    Start {
        /// `[i]`, or empty.
        place: String,
        /// The given value.
        found: String,
        /// The valid values.
        expected: String,
    },
    /// The state left the finite numbers.
    #[error(
        "the simulation left the finite numbers at tick {tick}; joint position {position:?}, velocity {velocity:?}, objects {objects:?}"
    )]
    NotFinite {
        /// The tick.
        tick: i64,
        /// q.
        position: Vec<f64>,
        /// q'.
        velocity: Vec<f64>,
        /// Positions of the objects [m].
        objects: Vec<[f64; 3]>,
    },
}
