//! The gate with its ports: request(k) in, command(k) out, on a real-time thread of its own.
//!
//! [`hapfic_gate::Gate`] decides; `node` waits, reads, validates, publishes and accounts. If it polls for requests on
//! a core of its own, a spare gate thread (`spare`) takes over during steal time on that core. Read `node`, then
//! `turn`, `receive`, `idle_work`, `events`. The supervisor's other threads share [`status`] and
//! [`change_exchange`] with it.

mod arrival_wait;
pub mod change_exchange;
mod events;
mod idle_work;
mod node;
mod ports;
mod receive;
mod received;
mod reported;
mod run;
mod spare;
pub mod status;
mod tick_account;
mod turn;

pub use node::{GateNode, GateStart};
