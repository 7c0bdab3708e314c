//! The torque gate: request(k) in, command(k) out, on a real-time thread of its own.
//!
//! [`core::Gate`] decides; this thread waits, reads, judges, publishes and accounts.

pub mod core;
mod intake;
pub mod protocol;
pub mod severity;
mod slack;
mod tell;
mod thread;
pub mod timeline;
pub mod torque;

pub use thread::{Gateway, Start};
