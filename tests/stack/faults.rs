//! Who dies, what happens: real processes, really killed, halted and fed with nonsense.
//!
//! In lockstep nothing may come of it at all. In realtime logic and counts are asserted, never a time.

mod lockstep;
mod machine;
mod realtime;
mod soak;
mod trace;
