//! The gate with its ports: request(k) in, command(k) out, on a real-time thread of its own.
//!
//! [`hapfic_gate::Gate`] decides; [`node`] waits, reads, validates, publishes and accounts. Where it polls for requests on a core of
//! its own, a second thread stands in for it when that core is taken away ([`spare`]). Read `node`, then `turn`, `receive`,
//! `idle_work`, `events`. [`shared_status`] and [`change_exchange`] are what the supervisor's other threads share with it.

mod arrival_wait;
pub mod change_exchange;
mod events;
mod idle_work;
mod node;
mod receive;
pub mod shared_status;
mod spare;
mod turn;

pub use node::{GateNode, GateStart};
