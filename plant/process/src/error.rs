//! Errors of the plant's process.

use hapfic_plant::PlantError;

/// An error of the plant's process.
#[derive(Debug, thiserror::Error)]
pub enum PlantProcessError {
    /// The simulated robot and its world.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// Messaging.
    #[error(transparent)]
    Ipc(#[from] hapfic_ipc::IpcError),
}
