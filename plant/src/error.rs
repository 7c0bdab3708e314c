//! What can go wrong while a world is built or run.

/// An error of the plant.
#[derive(Debug, thiserror::Error)]
pub enum PlantError {
    /// The robot description.
    #[error(transparent)]
    Robot(#[from] hapfic_robot::RobotError),
    /// Messaging.
    #[error(transparent)]
    Ipc(#[from] hapfic_ipc::IpcError),
    /// A tip link that cannot touch anything.
    #[error(
        "link '{link}': found no collision shape, expected one (a sphere, cylinder or box): the tip link must be able to touch the floor"
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
    /// A start inside of something.
    #[error(
        "robot.start_position_rad: the foot starts {depth_m:.4} m deep in the {body}, expected at most {limit_m} m: raise the base, or change the posture"
    )]
    StartsInside {
        /// How deep.
        depth_m: f64,
        /// In what.
        body: String,
        /// The contact's transition width.
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
    #[error("the simulation left the finite numbers at tick {tick}; joint position {position:?}, velocity {velocity:?}")]
    NotFinite {
        /// When.
        tick: i64,
        /// q.
        position: Vec<f64>,
        /// q'.
        velocity: Vec<f64>,
    },
}
