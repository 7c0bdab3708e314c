//! What a log says about its run.

use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The metadata record in which the recorder describes the run.
const METADATA: &str = "hapfic";
/// The clock that has no timer.
const LOCKSTEP: &str = "lockstep";

/// What a log says about its run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RunInfo {
    /// The log.
    pub log: PathBuf,
    /// Name of the scenario, or its file; empty if the log does not tell. So for all texts.
    pub scenario: String,
    /// What the scenario calls itself.
    pub title: String,
    /// `realtime` or `lockstep`.
    pub clock: String,
    /// Seed of the run.
    pub seed: String,
    /// Version of the program that ran it.
    pub version: String,
    /// Version of the program that made the report.
    pub report_version: String,
    /// Simulated time, s.
    pub duration_s: f64,
    /// Simulated time the scenario asks for, s.
    pub planned_s: Option<f64>,
    /// Whether the log holds the run to its end; `None` if it does not tell how long it should be.
    pub completed: Option<bool>,
    /// Messages of the log.
    pub messages: u64,
    /// Why the log ends early, if it does.
    pub cut_off: Option<String>,
}

impl RunInfo {
    /// From a log's metadata records.
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

    /// Puts in what is known at the end of the log.
    pub(crate) fn end(&mut self, last_tick: i64, messages: u64, cut_off: Option<String>) {
        self.duration_s = crate::seconds(last_tick.saturating_add(1));
        self.completed = self.planned_s.map(|planned| cut_off.is_none() && self.duration_s >= planned);
        self.messages = messages;
        self.cut_off = cut_off;
    }

    /// Whether there was no timer.
    #[must_use]
    pub fn lockstep(&self) -> bool {
        self.clock == LOCKSTEP
    }

    /// How the run ended, in words.
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
