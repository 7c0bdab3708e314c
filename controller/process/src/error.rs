//! Errors of a controller process.

/// An error of a controller process.
#[derive(Debug, thiserror::Error)]
pub enum ControllerError {
    /// The robot description is invalid.
    #[error(transparent)]
    Robot(#[from] hapfic_robot::RobotError),
    /// Messaging failed.
    #[error(transparent)]
    Ipc(#[from] hapfic_ipc::IpcError),
}
