//! Description of a run, from its log.

use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Metadata record with the recorder's description of the run.
const METADATA: &str = "hapfic";
/// Name of the clock without a timer.
const LOCKSTEP: &str = "lockstep";

/// Description of a run, from its log.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RunInfo {
    /// Path of the log.
    pub log: PathBuf,
    /// Name of the scenario, or its file. This and the other texts are empty if unknown.
    pub scenario: String,
    /// Title of the scenario.
    pub title: String,
    /// `realtime` or `lockstep`.
    pub clock: String,
    /// Seed of the run.
    pub seed: String,
    /// Version of the program that recorded the run.
    pub version: String,
    /// Version of the program that made the report.
    pub report_version: String,
    /// Simulated time [s].
    pub duration_s: f64,
    /// Simulated time of the scenario [s].
    pub planned_s: Option<f64>,
    /// Whether the log covers the whole run; `None` if the planned duration is unknown.
    pub completed: Option<bool>,
    /// Number of messages in the log.
    pub messages: u64,
    /// Cause of an early end of the log, if any.
    pub cut_off: Option<String>,
}

impl RunInfo {
    /// Reads the description from a log's metadata records.
    pub(crate) fn new(log: PathBuf, metadata: &BTreeMap<String, BTreeMap<String, String>>) -> Self {
        let header = metadata.get(METADATA);
        let text = |key: &str| header.and_then(|header| header.get(key)).cloned().unwrap_or_default();
        let planned: Option<i64> = text("duration_ticks").parse().ok();
        Self {
            log,
            scenario: text("scenario"),
            title: text("title"),
            clock: text("clock"),
            seed: text("seed"),
            version: text("version"),
            report_version: env!("CARGO_PKG_VERSION").to_owned(),
            planned_s: planned.filter(|ticks| *ticks > 0).map(crate::seconds),
            ..Self::default()
        }
    }

    /// Adds the properties known at the end of the log.
    pub(crate) fn end(&mut self, last_tick: i64, messages: u64, cut_off: Option<String>) {
        self.duration_s = crate::seconds(last_tick.saturating_add(1));
        self.completed = self.planned_s.map(|planned| cut_off.is_none() && self.duration_s >= planned);
        self.messages = messages;
        self.cut_off = cut_off;
    }

    /// Whether the run had no timer.
    #[must_use]
    pub fn lockstep(&self) -> bool {
        self.clock == LOCKSTEP
    }

    /// End of the run, as text.
    #[must_use]
    pub fn ending(&self) -> &'static str {
        match (self.completed, &self.cut_off) {
            (_, Some(_)) => "the log is cut off",
            (Some(true), None) => "completed",
            (Some(false), None) => "not completed",
            (None, None) => "of unknown length",
        }
    }
}
