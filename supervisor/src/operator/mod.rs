//! The operator service: the server thread of a run, its client, and the status that they exchange.
//!
//! The server is no real-time thread. It checks a change by the scenario's rules and passes it to the gate through a
//! queue that never blocks. The gate polls the queue once a tick, in its idle time, and replies with the tick at which
//! the change takes effect.

mod change;
pub mod client;
mod serve;
pub mod status;

pub use serve::{OperatorServer, OperatorServerStart};
