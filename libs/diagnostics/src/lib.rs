//! How long a chain of messages takes: driver -> relay -> relay -> driver, as the stack's plant -> controller -> gate -> plant, in
//! as many processes, with messages as long, at the same priorities and on the same cores, and with no work in between.
//!
//! A [`Kind`] of chain says how its messages travel: it gives each of the three processes a [`Link`]. [`own`] are those over what
//! the kernel itself offers. A program with kinds of its own needs no more than this, and `hapfic bench latency --peers PROGRAM`
//! measures it:
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
//!         // Listens as `seat.name_of(seat.place)`, sends to `seat.name_of(seat.next())`.
//!         Err(io::ErrorKind::Unsupported.into())
//!     }
//! }
//!
//! fn main() -> std::process::ExitCode {
//!     hapfic_diagnostics::main(&[&Pigeon])
//! }
//! ```
//!
//! The program is then called as `PROGRAM kinds`, which prints one name a line, and as
//! `PROGRAM chain --kind KIND --core C --priority P --start-ns N --period-ns N --count N --sizes A,B,C`: it prints `ready` when its
//! chain is warm, and at the end one line of JSON, a [`Measured`].
//!
//! The rest is what to make of the figures: [`Distribution`], [`Ratio`], [`hops`] of the stack's own chain, and the [`cause`] of a
//! tick that was missed.

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

pub use arguments::{Core, Plan};
pub use distribution::{ChainQuantiles, Distribution, PARTS};
pub use driver::driver;
pub use error::LatencyError;
pub use link::{Kind, Link, PLACES, Seat};
pub use links::own;
pub use measured::{Measured, Sample};
pub use program::{TIMER, main, program};
pub use ratio::Ratio;
pub use relay::relay;
pub use timer::timer;
