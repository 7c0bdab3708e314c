//! The stack in one process, without transport, clock or threads; checks and studies that use it.
//!
//! Read [`simulation`] first: it advances the stack by ticks. [`stability`] tests a set of gains in free air;
//! [`findings`] lists what is unwise in a scenario or in a change. A study runs one scenario ([`study`]) or a grid of
//! settings ([`sweep`], on many threads by [`pool`]). It writes a log ([`recording`]) and returns [`figures`].

pub mod calibrate;
pub mod conditions;
pub mod extremes;
pub mod figures;
pub mod findings;
pub mod pool;
pub mod recording;
#[allow(clippy::module_inception)]
pub mod simulation;
pub mod stability;
pub mod study;
pub mod sweep;

pub use simulation::{DeadTime, Simulation, SimulationError, Snapshot};
