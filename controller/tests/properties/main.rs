//! Properties of the laws for every input and every parameter set.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod draw;
mod laws;
mod refusals;
