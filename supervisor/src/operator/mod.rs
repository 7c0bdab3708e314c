//! What an operator asks of a running stack: the thread that answers, its way to the gate and back, and the side that asks.
//!
//! The thread is no real-time thread. It checks a change as a scenario's is checked and hands it to the gate through a queue that
//! never blocks; the gate looks into it once a tick, in the slack, and says at which tick the change takes effect.

pub mod client;
mod serve;
pub mod status;

pub use serve::{OperatorServerStart, Served};
