//! Latency of a chain of messages: driver -> relay -> relay -> driver, like the stack's plant -> controller -> gate ->
//! plant.
//!
//! The chain has as many processes as the stack, messages of the same lengths, the same priorities and cores, and no
//! work in between.
//!
//! A [`Kind`] of chain implements the transport: it gives each of the three processes a [`Link`]. [`kernel_kinds`]
//! lists the transports of the kernel. `hapfic bench latency --peers PROGRAM` measures a program with other kinds:
//!
//! ```no_run
//! use hapfic_diagnostics::{Kind, Link, Seat};
//! # use std::{io, time::Duration};
//! struct Pigeon;
//!
//! impl Kind for Pigeon {
//!     fn name(&self) -> &'static str { "pigeon" }
//!     fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
//! #       let _ = seat;
//!         // Listens as `seat.name_of(seat.stage)`, sends to `seat.name_of(seat.next())`.
//!         Err(io::ErrorKind::Unsupported.into())
//!     }
//! }
//!
//! fn main() -> std::process::ExitCode {
//!     hapfic_diagnostics::main(&[&Pigeon])
//! }
//! ```
//!
//! `PROGRAM kinds` prints one name a line.
//! `PROGRAM chain --kind KIND --core C --priority P --start-ns N --period-ns N --count N --sizes A,B,C` prints `ready`
//! after the warm-up of its chain, and at the end one line of JSON, a [`ChainMeasurement`].
//!
//! The evaluation: [`Distribution`], [`Ratio`], the [`hops`] of the stack's own chain, and the [`cause`] of a missed
//! tick. [`doctor`] examines the machine.

mod arguments;
pub mod cause;
mod distribution;
pub mod doctor;
mod driver;
mod error;
pub mod hops;
mod link;
mod links;
mod measured;
mod program;
mod ratio;
mod relay;
mod timer;

pub use arguments::{Core, MeasurementPlan};
pub use distribution::{ChainQuantiles, Distribution, SEGMENTS};
pub use driver::driver;
pub use error::LatencyError;
pub use link::{Kind, Link, STAGES, Seat};
pub use links::kernel_kinds;
pub use measured::{ChainMeasurement, ChainSample};
pub use program::{TIMER, main, program};
pub use ratio::Ratio;
pub use relay::relay;
pub use timer::timer;
