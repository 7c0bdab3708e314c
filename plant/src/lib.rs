//! The simulated robot: a leg, the world it touches, and the drive in between.
//!
//! [`Plant`] is the whole of it without a clock; [`process::run`] is the process. The contact law is [`ContactLaw`], the
//! integrator [`World`].

mod contact_law;
mod drive;
mod error;
mod newton;
#[allow(clippy::module_inception)]
mod plant;
pub mod process;
mod scene;
mod world;

pub use contact_law::{ContactLaw, Normal, Sloped};
pub use drive::DriveState;
pub use error::PlantError;
pub use plant::Plant;
pub use world::{Action, Advance, Substeps, World};
