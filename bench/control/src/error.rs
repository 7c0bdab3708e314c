//! Errors of the QP controller.

/// Error of a tick without a torque.
#[derive(Debug, thiserror::Error)]
pub enum QpError {
    /// The state has another number of joints than the robot.
    #[error("the state has {found} joints, expected {expected}")]
    Joints {
        /// Joints of the state.
        found: u32,
        /// Joints of the robot.
        expected: usize,
    },
    /// The solver rejects the problem.
    #[error("the solver rejects the problem: {cause}")]
    Rejected {
        /// Error of the solver.
        cause: String,
    },
    /// The solver found no optimum.
    #[error("tick {tick}: the solver ended with {status}, expected Solved or AlmostSolved")]
    NotSolved {
        /// Tick of the state.
        tick: i64,
        /// Final status of the solver.
        status: String,
    },
}
