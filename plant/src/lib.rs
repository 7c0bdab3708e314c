//! The simulated robot: a leg, the world it touches, and the drive in between.
//!
//! [`Plant`] is the whole of it without a clock; [`process::run`] is the process. The contact law is [`ContactLaw`], the
//! integrator [`World`].

mod account;
mod cholesky;
mod collider;
mod contact_law;
mod contact_point;
mod contact_step;
mod drive;
mod error;
mod free_step;
mod newton;
mod object;
mod pair_cache;
#[allow(clippy::module_inception)]
mod plant;
mod point;
mod scene;
mod step_scope;
mod velocities;
mod world;

pub use account::Advance;
pub use contact_law::{ContactLaw, Normal, Sloped};
pub use drive::DriveState;
pub use error::PlantError;
pub use object::FreeBody;
pub use plant::Plant;
pub use world::{Action, Substeps, World};
