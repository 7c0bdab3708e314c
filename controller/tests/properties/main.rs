//! Properties of the laws for every input and every parameter set.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod contact;
mod draw;
mod laws;
mod reentry;
mod refusals;
mod search;
mod softening;
