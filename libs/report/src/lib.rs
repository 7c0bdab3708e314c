//! Report of a run, from its log alone: the paper's figures, five snapshots, metrics and events.
//!
//! [`Report::read`] reads a log once, in bounded memory. The result is available as a self-contained interactive page
//! ([`Report::html`]), as pictures for print ([`Report::pictures`]), as JSON ([`Report::json`]) and as text
//! ([`Report::text`]). For a truncated log, the report covers the readable part and gives the cause.
//!
//! ```no_run
//! use hapfic_report::Report;
//! use std::path::Path;
//!
//! let report = Report::read(Path::new("run.mcap"))?;
//! report.write_html(Path::new("run.html"))?;
//! report.write_pictures(Path::new("figures"))?;
//! # Ok::<(), hapfic_report::ReportError>(())
//! ```

mod canvas;
mod chart;
mod collect;
mod color;
mod error;
mod events;
pub mod figure;
mod figures;
mod frames;
mod html;
mod incidents;
mod label;
mod output;
mod parameters;
mod plot;
mod report;
mod run;
mod scene;
pub mod series;
mod snapshots;
mod table;
mod tasks;
mod ticks;
pub mod timelines;
pub mod timing;
mod view;

pub use error::ReportError;
pub use events::{LoggedEvent, MAX_EVENTS};
pub use figure::Figure;
pub use incidents::{Incident, MAX_INCIDENTS};
pub use output::{FigureImage, OutputPaths};
pub use report::Report;
pub use run::RunInfo;
pub use snapshots::SNAPSHOTS;

/// Last valid tick, after about 35 years.
const LATEST_TICK: i64 = 1 << 40;

/// Time of a tick [s].
fn seconds(tick: i64) -> f64 {
    const TICKS_PER_SECOND: f64 = 1e9 / hapfic_log::TICK_NS as f64;
    tick as f64 / TICKS_PER_SECOND
}

/// Whether a number is finite and of plausible size for a quantity of a run.
fn is_plausible(value: f64) -> bool {
    value.abs() < 1e12
}

/// Reads a vector of a message; `None` unless it has three plausible elements.
fn vector(values: &[f64]) -> Option<[f64; 3]> {
    let vector: [f64; 3] = values.try_into().ok()?;
    vector.into_iter().all(is_plausible).then_some(vector)
}
