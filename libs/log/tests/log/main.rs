//! Behaviour of logs: round trip, reading of any file without a panic, and metrics.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod damage;
mod figures;
mod full_disk;
mod lost_writer;
mod messages_page;
mod recover;
mod round_trip;
mod samples;
mod schema;
