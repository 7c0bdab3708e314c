//! Behaviour of logs: what is written is read, nothing read can do harm, and figures are right.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod damage;
mod figures;
mod full_disk;
mod recover;
mod round_trip;
mod samples;
mod schema;
