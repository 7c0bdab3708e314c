//! The trait of everything that crosses a process boundary.

use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Message: plain data without padding or pointers, valid for every bit pattern, with the same layout in every process.
///
/// The derives of `zerocopy` prove this at compile time, so that a damaged message can be received and rejected.
pub trait Message: Copy + core::fmt::Debug + FromBytes + IntoBytes + Immutable + Send + 'static {
    /// Name of the type on the wire; equal names mean equal layouts.
    const NAME: &str;
}
