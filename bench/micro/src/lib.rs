//! What the benchmarks of this package share: robots of any number of joints, a corner of shared memory of their own, and the
//! recorder's work on a tick.

pub mod corner;
pub mod limb;
pub mod rate;
pub mod record;
