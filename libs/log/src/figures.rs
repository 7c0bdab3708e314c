//! Figures of a whole log: what a run's summary says about it.

use crate::error::LogError;
use crate::metrics::{Metrics, MetricsSummary};
use crate::parts::{LogParts, numbered};
use crate::reader::Record;
use hapfic_messages::Mode;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Figures of a log in all its parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LogFigures {
    /// Metrics of the run.
    pub metrics: MetricsSummary,
    /// Messages in the log.
    pub messages: u64,
    /// Whether the gate ever accepted a request.
    pub active: bool,
    /// States and commands among the messages, each tick once.
    pub ticks: [u64; 2],
    /// Size of all parts of the log [bytes].
    pub file_bytes: u64,
    /// Number of parts that were written, and of those that were removed again.
    pub parts: [u32; 2],
}

impl LogFigures {
    /// Reads a log in all its parts. Of a damaged or cut-off part only what is valid counts.
    ///
    /// # Errors
    /// [`LogError`] if the first part cannot be opened.
    pub fn of_log(path: &Path) -> Result<Self, LogError> {
        let (mut metrics, mut figures) = (Metrics::new(), Self::default());
        let mut newest = [-1; 2];
        for message in LogParts::open(path)?.flatten() {
            metrics.push(&message.record);
            figures.messages += 1;
            let (kind, tick) = match &message.record {
                Record::State(state) => (0, state.tick),
                Record::Command(command) => {
                    figures.active |= command.mode == Mode::Active.name();
                    (1, command.tick)
                }
                _ => continue,
            };
            if tick > newest[kind] {
                newest[kind] = tick;
                figures.ticks[kind] += 1;
            }
        }
        let parts = numbered(path);
        let last = parts.last().map_or(1, |(number, _)| *number);
        let file_bytes = parts.iter().map(|(_, path)| std::fs::metadata(path).map_or(0, |metadata| metadata.len())).sum();
        Ok(Self { metrics: metrics.summary(), file_bytes, parts: [last, last - parts.len() as u32], ..figures })
    }
}
