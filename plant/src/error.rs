//! What can go wrong while a world is built or run.

/// An error of the plant.
#[derive(Debug, thiserror::Error)]
pub enum PlantError {
    /// A state to go on from that does not fit.
    #[error("cannot go on from the last state: it has {} joints and {} objects, expected {} and {}", found.0, found.1, expected.0, expected.1)]
    Resume {
        /// Joints and objects of the state.
        found: (usize, usize),
        /// Joints and objects of robot and world.
        expected: (usize, usize),
    },
    /// The robot description.
    #[error(transparent)]
    Robot(#[from] hapfic_robot::RobotError),
    /// A tip link that cannot touch anything.
    #[error(
        "link '{link}': found no collision shape, expected a sphere: the tip link must be able to touch the floor and the objects"
    )]
    NoFoot {
        /// The tip link.
        link: String,
    },
    /// A foot the contacts cannot carry.
    #[error("link '{link}': found {shape:?} as collision shape of the foot, expected a sphere")]
    FootShape {
        /// The tip link.
        link: String,
        /// Its shape.
        shape: hapfic_robot::Shape,
    },
    /// Two bodies of one name.
    #[error(
        "world.object: found '{name}' as a name, expected one that neither a link nor another body has: contacts are told apart by it"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// A start inside of something.
    #[error(
        "{body} starts {depth_m:.4} m deep in {against}, expected at most {limit_m:.4} m: move one of them (robot.base_position_m, robot.start_position_rad, world.object.position_m)"
    )]
    StartsInside {
        /// How deep.
        depth_m: f64,
        /// What.
        body: String,
        /// In what.
        against: String,
        /// Transition width of the contact, and what the body sinks in by its own weight.
        limit_m: f64,
    },
    /// A start posture that does not fit the robot.
    #[error("robot.start_position_rad{place}: found {found}, expected {expected}")]
    Start {
        /// `[i]`, or nothing.
        place: String,
        /// What was given.
        found: String,
        /// What would fit.
        expected: String,
    },
    /// The state left the numbers.
    #[error(
        "the simulation left the finite numbers at tick {tick}; joint position {position:?}, velocity {velocity:?}, objects {objects:?}"
    )]
    NotFinite {
        /// When.
        tick: i64,
        /// q.
        position: Vec<f64>,
        /// q'.
        velocity: Vec<f64>,
        /// Where the objects are, m.
        objects: Vec<[f64; 3]>,
    },
}
