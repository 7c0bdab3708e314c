//! What a report makes of a log, whole or cut off.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod logs;
mod pages;
mod pictures;
