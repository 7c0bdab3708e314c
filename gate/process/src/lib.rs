//! Process of the gate: request(k) in, command(k) out.
//!
//! [`hapfic_gate::Gate`] decides; `node` waits, reads, validates, publishes and accounts. There are two such
//! processes: one gates, the other takes a tick that the first does not gate (`pair`). Read `process`, `node`, `pair`, then
//! `turn`, `receive`, `idle_work`, `events`. The state of the gate is in each command, so a successor of a lost gate continues
//! as if nothing had happened. [`change_exchange`] brings the operator's changes.

mod arrival_wait;
pub mod change_exchange;
mod events;
mod idle_work;
mod node;
mod pair;
mod ports;
mod process;
mod receive;
mod received;
mod reported;
mod run;
mod tick_account;
mod turn;

pub use process::{GateError, run};
