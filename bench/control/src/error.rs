//! What can go wrong.

/// Why there is no torque.
#[derive(Debug, thiserror::Error)]
pub enum QpError {
    /// The state is another robot's.
    #[error("the state has {found} joints, expected {expected}")]
    Joints {
        /// Joints of the state.
        found: u32,
        /// Joints of the robot.
        expected: usize,
    },
    /// The solver refuses the problem.
    #[error("the solver refuses the problem: {cause}")]
    Refused {
        /// What it says.
        cause: String,
    },
    /// The solver has found no optimum.
    #[error("tick {tick}: the solver ended with {status}, expected Solved or AlmostSolved")]
    NotSolved {
        /// The state's tick.
        tick: i64,
        /// How it ended.
        status: String,
    },
}
