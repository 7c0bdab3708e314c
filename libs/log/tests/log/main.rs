//! Behaviour of logs: round trip, harmless reading of any file, and metrics.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod damage;
mod figures;
mod full_disk;
mod recover;
mod round_trip;
mod samples;
mod schema;
