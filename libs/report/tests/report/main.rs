//! Reports of complete and truncated logs.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod logs;
mod pages;
mod pictures;
