//! The log of a run: one MCAP file that Foxglove, Rerun and PlotJuggler open as it is.
//!
//! [`Writer`] takes the messages of `hapfic-ipc` and writes them as protobuf, with their schemas, the names of joints and
//! bodies, and the scenario and robot as attachments. [`Reader`] reads a log back, in bounded memory, also one whose writer
//! was killed: it gives every message of the chunks that are whole, and then says where the file ends.
//! [`viewer`] makes what a 3-D view shows; [`Metrics`] sums a run up, live or from a log.
//!
//! ```no_run
//! use hapfic_log::{Metrics, Reader};
//!
//! let mut metrics = Metrics::new();
//! for entry in Reader::open("run.mcap")? {
//!     metrics.push(&entry?.record);
//! }
//! let summary = metrics.summary();
//! assert_eq!(summary.ticks.lost, 0);
//! # Ok::<(), hapfic_log::LogError>(())
//! ```

mod attachment;
mod chunk;
pub mod convert;
mod error;
mod frames;
mod lengths;
pub mod metrics;
mod names;
pub mod proto;
mod reader;
mod recover;
mod run_log;
pub mod scene;
pub mod timeline;
mod topic;
pub mod viewer;
mod writer;

pub use attachment::Attachment;
pub use error::LogError;
pub use metrics::{Metrics, MetricsSummary};
pub use names::Names;
pub use reader::{Entry, Reader, Record};
pub use recover::{Loss, RecoverError, Recovery, TickGaps, recover};
pub use run_log::{RunLog, create_run_log};
pub use topic::Topic;
pub use viewer::Viewer;
pub use writer::{Totals, Writer, WriterOptions};

/// Nanoseconds of a tick.
pub const TICK_NS: i64 = 1_000_000;

/// Time of a tick in a log that starts at `start_unix_ns`, ns. Never before zero.
#[must_use]
pub fn time_of(start_unix_ns: u64, tick: i64) -> u64 {
    start_unix_ns.saturating_add_signed(tick.saturating_mul(TICK_NS))
}
