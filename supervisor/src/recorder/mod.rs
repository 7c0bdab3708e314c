//! The recorder: receives every message of every tick, and writes the log. It is a process of its own.
//!
//! Its two threads ([`process`]) keep a stalled disk from stalling receiving. The main thread drains shared memory every
//! 10 ms, in lockstep every 1 ms (`drain.rs`). The writer thread encodes, computes the metrics and writes (`write.rs`).
//!
//! The supervisor starts it ([`Recorder`]), restarts it when it is lost, and takes its result at the end. A successor
//! continues the log in a new part. What supervisor and recorder tell each other lies in the page
//! [`hapfic_ipc::RecorderPage`]. In lockstep every message that is not flushed to the log lies in the rings of its sender,
//! from which a successor takes it (`journal.rs`), so that nothing is missing from the log.

mod disk;
mod drain;
mod incident;
mod journal;
mod launch;
mod position;
pub mod process;
mod viewer_frames;
mod views;
mod write;

use hapfic_log::LogFigures;
use hapfic_messages::{Command, Event, Operator, Reference, Request, State, Timing};
use hapfic_simulation::conditions::TaskReport;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

pub(crate) use disk::free_bytes;
pub use incident::IncidentSummary;
pub use launch::{Recorder, RecorderStart, await_ready};

/// Message in flight to the log.
#[allow(clippy::large_enum_variant)] // A batch lives for milliseconds; a box for each message would cost more than the memory.
enum RecordedMessage {
    State(State),
    Reference(Reference),
    Request(Request),
    Command(Command),
    Operator(Operator),
    Event(Event),
    Timing(Timing),
}

impl RecordedMessage {
    /// Returns the tick of the message; parameters come before all messages to which they may apply.
    fn tick(&self) -> i64 {
        match self {
            Self::State(m) => m.tick,
            Self::Reference(m) => m.tick,
            Self::Request(m) => m.tick,
            Self::Command(m) => m.tick,
            Self::Operator(_) => i64::MIN,
            Self::Event(m) => m.tick,
            Self::Timing(m) => m.tick,
        }
    }
}

/// Result of a recorder, which it leaves in the run's folder.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct RecordingOutcome {
    /// Figures of what this recorder has written.
    pub figures: Option<LogFigures>,
    /// Brakes and stops.
    pub incidents: Option<IncidentSummary>,
    /// Conditions of the task that held.
    pub tasks: Vec<TaskReport>,
    /// First error.
    pub error: Option<String>,
}

impl RecordingOutcome {
    /// Path of the result of a recorder by its generation.
    fn path(root: &Path, generation: u32) -> PathBuf {
        root.join(format!("recorder-{generation}.json"))
    }

    fn write(&self, root: &Path, generation: u32) -> anyhow::Result<()> {
        Ok(replace(&Self::path(root, generation), &serde_json::to_vec(self)?)?)
    }

    /// The result of a recorder; `None` if it has left none.
    fn read(root: &Path, generation: u32) -> Option<Self> {
        serde_json::from_slice(&fs::read(Self::path(root, generation)).ok()?).ok()
    }
}

/// Path of the conditions of the task in a run's folder, which the recorder keeps up to date.
fn tasks_file(root: &Path) -> PathBuf {
    root.join("tasks.json")
}

/// Conditions of the task that hold or have held; none before the recorder has found any.
#[must_use]
pub fn tasks(root: &Path) -> Vec<TaskReport> {
    fs::read(tasks_file(root)).ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
}

/// Replaces a file in the run's folder, so that a reader sees the old or the new one.
pub(crate) fn replace(path: &Path, content: &[u8]) -> std::io::Result<()> {
    let new = path.with_extension("new");
    fs::write(&new, content)?;
    fs::rename(new, path)
}
