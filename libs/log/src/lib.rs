//! The log of a run: one MCAP file that Foxglove, Rerun and PlotJuggler open without conversion.
//!
//! [`Writer`] takes the messages of `hapfic-messages` and writes them as protobuf. The log carries their schemas, the
//! names of joints and bodies, and scenario and robot as attachments. [`Reader`] reads a log in bounded memory. If the
//! writer was killed, the reader returns every message of the complete chunks, and then an error with the end of the
//! file. [`viewer`] makes the messages for 3-D views; [`Metrics`] summarizes a run, during the run or from a log.
//!
//! ```no_run
//! use hapfic_log::{Metrics, Reader};
//!
//! let mut metrics = Metrics::new();
//! for message in Reader::open("run.mcap")? {
//!     metrics.push(&message?.record);
//! }
//! let summary = metrics.summary();
//! assert_eq!(summary.ticks.lost, 0);
//! # Ok::<(), hapfic_log::LogError>(())
//! ```

mod attachment;
mod chunk;
mod close_part;
pub mod convert;
mod error;
mod figures;
mod frames;
mod lengths;
pub mod metrics;
mod names;
mod parts;
mod passage;
pub mod proto;
mod reader;
mod recover;
mod run_log;
pub mod scene;
pub mod timeline;
mod topic;
mod topic_writer;
pub mod viewer;
mod writer;

pub use attachment::Attachment;
pub use close_part::{Remainder, close_last_part};
pub use error::LogError;
pub use figures::LogFigures;
pub use metrics::{Metrics, MetricsSummary};
pub use names::Names;
pub use parts::{LogParts, part_path, parts};
pub use passage::passage_event;
pub use reader::{LogMessage, Reader, Record};
pub use recover::{DamagedRange, RecoverError, Recovery, TickGaps, recover};
pub use run_log::{RunLog, begin_run_log, create_run_log, reserve_run_log, resume_run_log};
pub use topic::Topic;
pub use viewer::Viewer;
pub use writer::{LogFile, LogTotals, Writer, WriterOptions};

/// Duration of a tick [ns].
pub const TICK_NS: i64 = 1_000_000;

/// Returns the time of a tick in a log that starts at `start_unix_ns` [ns]. Never below zero.
#[must_use]
pub fn time_of(start_unix_ns: u64, tick: i64) -> u64 {
    start_unix_ns.saturating_add_signed(tick.saturating_mul(TICK_NS))
}
