//! The torque gate: request(k) in, command(k) out, on a real-time thread of its own.
//!
//! [`core::Gate`] decides; this thread waits, reads, judges, publishes and accounts. Where it looks out for requests on a core of its
//! own, a second one stands in for it when that core is taken away.

pub mod core;
mod intake;
mod lookout;
pub mod protocol;
pub mod severity;
mod slack;
mod tell;
mod thread;
pub mod timeline;
pub mod torque;
mod turn;
mod understudy;

pub use thread::{Gateway, Start};
