//! Errors of the plant process.

use hapfic_plant::PlantError;

/// An error of the plant process.
#[derive(Debug, thiserror::Error)]
pub enum PlantProcessError {
    /// The simulated robot or its world failed.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// Messaging failed.
    #[error(transparent)]
    Ipc(#[from] hapfic_ipc::IpcError),
}
