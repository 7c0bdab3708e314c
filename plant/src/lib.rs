//! The simulated robot: a leg, the world it touches, and the drive in between.
//!
//! [`Plant`] is the whole of it without a clock; [`process::run`] is the process. The contact law is [`ContactLaw`], the
//! integrator [`World`].

mod account;
mod cholesky;
mod contact_law;
mod drive;
mod error;
mod flight;
mod newton;
mod object;
mod placed;
#[allow(clippy::module_inception)]
mod plant;
mod point;
mod press;
mod scene;
mod touch;
mod watch;
mod world;

pub use account::Advance;
pub use contact_law::{ContactLaw, Normal, Sloped};
pub use drive::DriveState;
pub use error::PlantError;
pub use object::FreeBody;
pub use plant::Plant;
pub use world::{Action, Substeps, World};
