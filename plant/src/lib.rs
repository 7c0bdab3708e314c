//! The simulated robot: a leg with its drive, and the world that it touches.
//!
//! [`Plant`] is all of it, without a clock; the crate `hapfic-plant-process` holds the process. The contact law is
//! [`ContactLaw`], the integrator [`PhysicsWorld`].

mod account;
mod collider;
mod contact_law;
mod contact_point;
mod contact_step;
mod cut_step;
mod drive;
mod energy;
mod engine;
mod error;
mod force_noise;
mod free_step;
mod full_newton;
mod newton;
mod object;
mod pair_cache;
#[allow(clippy::module_inception)]
mod plant;
mod point;
mod rapier;
mod scene;
mod step_scope;
mod velocities;
mod world;

pub use account::TickResult;
pub use contact_law::{ContactLaw, NormalForce, ValueAndSlope};
pub use contact_step::PointForce;
pub use drive::DriveState;
pub use error::PlantError;
pub use object::FreeBody;
pub use plant::Plant;
pub use world::{DriveAction, PhysicsWorld, Substeps};
