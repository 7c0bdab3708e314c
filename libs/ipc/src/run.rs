//! Run file: data from the launcher for the supervisor and for the processes that it starts.

use crate::error::IpcError;
use hapfic_messages::{Clock, RealtimeMode};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Everything that a process of the stack needs to take part in a run, as JSON. The environment variable
/// [`RunFile::VARIABLE`] of every process of the run holds its path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFile {
    /// Prefix of the run's shared memory.
    pub prefix: String,
    /// The run's folder.
    pub root: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Path of the log.
    pub log: PathBuf,
    /// The same as the user has given it.
    pub log_name: PathBuf,
    /// Time of tick 0 [ns since the Unix epoch]; zero in lockstep.
    pub start_unix_ns: u64,
    /// Process that starts the supervisor and its successors.
    pub launcher_pid: i32,
    /// Start of the program, `CLOCK_MONOTONIC` [ns].
    pub launched_ns: u64,
    /// Clock of the run.
    pub clock: Clock,
    /// Whether to request real-time privileges.
    pub realtime: RealtimeMode,
    /// Core of the real-time threads without a configured core; `None`: any.
    pub core: Option<u32>,
    /// Core of the standby without a configured core; `None`: any.
    pub standby_core: Option<u32>,
    /// Core of the gate; `None`: any.
    pub gate_core: Option<u32>,
    /// Whether the gate may busy-poll for requests, since plant and controller have other cores.
    pub gate_busy_polls: bool,
    /// Core of the spare gate; `None`: that of the threads without one.
    pub spare_core: Option<u32>,
    /// Pose of the tip at the start: position [m], roll, pitch, yaw [rad].
    pub start_pose: [[f64; 3]; 2],
    /// The effective configuration, TOML.
    pub settings: String,
    /// Source of the URDF.
    pub urdf_name: String,
    /// Text of the URDF.
    pub urdf: String,
}

impl RunFile {
    /// Environment variable that holds the run file's path.
    pub const VARIABLE: &'static str = "HAPFIC_RUN";
    /// Environment variable that holds the number of the start: 0 for the first.
    pub const GENERATION: &'static str = "HAPFIC_GENERATION";
    /// Environment variable that holds the name of the process.
    pub const PROCESS: &'static str = "HAPFIC_PROCESS";

    /// Reads a run file.
    ///
    /// # Errors
    /// [`IpcError::RunFile`] with the file and the cause.
    pub fn read(path: &Path) -> Result<Self, IpcError> {
        let fail = |cause: String| IpcError::RunFile { path: path.to_owned(), cause };
        let text = std::fs::read_to_string(path).map_err(|e| fail(e.to_string()))?;
        serde_json::from_str(&text).map_err(|e| fail(e.to_string()))
    }

    /// Writes the run file.
    ///
    /// # Errors
    /// [`IpcError::RunFile`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), IpcError> {
        let fail = |cause: String| IpcError::RunFile { path: path.to_owned(), cause };
        let text = serde_json::to_string_pretty(self).map_err(|e| fail(e.to_string()))?;
        std::fs::write(path, text).map_err(|e| fail(e.to_string()))
    }
}
