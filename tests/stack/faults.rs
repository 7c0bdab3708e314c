//! Fault injection in the real stack: killed and halted processes, corrupted messages.
//!
//! In lockstep a fault may change nothing. In realtime the tests assert logic and counts, never a time.

mod gates;
mod lockstep;
mod machine;
mod realtime;
mod recorder;
pub mod runs;
mod soak;
mod supervisor;
pub mod trace;
