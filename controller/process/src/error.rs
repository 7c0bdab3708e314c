//! What can go wrong in a controller process.

/// An error of a controller process.
#[derive(Debug, thiserror::Error)]
pub enum ControllerError {
    /// The robot description.
    #[error(transparent)]
    Robot(#[from] hapfic_robot::RobotError),
    /// Messaging.
    #[error(transparent)]
    Ipc(#[from] hapfic_ipc::IpcError),
}
