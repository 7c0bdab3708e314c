//! Shared parts of the benchmarks: generated robots, a namespace in shared memory, and the recorder's work on a tick.

pub mod corner;
pub mod limb;
pub mod rate;
pub mod record;
