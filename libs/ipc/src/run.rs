//! The run file: what a supervisor tells the processes it starts.

use crate::error::IpcError;
use hapfic_messages::{Clock, RealtimeMode};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Everything a process of the stack needs to take part in a run. JSON; its path is in the environment variable
/// [`RunFile::VARIABLE`] of every process the supervisor starts.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunFile {
    /// Prefix of the run's shared memory.
    pub prefix: String,
    /// The run's folder.
    pub root: String,
    /// The process all others end with.
    pub supervisor_pid: i32,
    /// How time passes.
    pub clock: Clock,
    /// Whether to ask for real-time privileges.
    pub realtime: RealtimeMode,
    /// Core of the real-time threads that the configuration gives none; none: any.
    pub core: Option<u32>,
    /// Core of the standby, where the configuration gives it none; none: any.
    pub reserve_core: Option<u32>,
    /// Core of the gate, for those who measure; none: any.
    pub gate_core: Option<u32>,
    /// The effective configuration, TOML.
    pub settings: String,
    /// Where the URDF came from.
    pub urdf_name: String,
    /// The URDF itself.
    pub urdf: String,
}

impl RunFile {
    /// Environment variable that holds the run file's path.
    pub const VARIABLE: &'static str = "HAPFIC_RUN";
    /// Environment variable that holds the number of the start: 0 for the first.
    pub const GENERATION: &'static str = "HAPFIC_GENERATION";
    /// Environment variable that holds the tick of the message from which a process that is started again goes on; not set where
    /// its forerunner had sent none.
    pub const RESUME: &'static str = "HAPFIC_RESUME";

    /// Reads a run file.
    ///
    /// # Errors
    /// [`IpcError::RunFile`] naming the file and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, IpcError> {
        let fail = |cause: String| IpcError::RunFile { path: path.to_owned(), cause };
        let text = std::fs::read_to_string(path).map_err(|e| fail(e.to_string()))?;
        serde_json::from_str(&text).map_err(|e| fail(e.to_string()))
    }

    /// Writes it.
    ///
    /// # Errors
    /// [`IpcError::RunFile`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), IpcError> {
        let fail = |cause: String| IpcError::RunFile { path: path.to_owned(), cause };
        let text = serde_json::to_string_pretty(self).map_err(|e| fail(e.to_string()))?;
        std::fs::write(path, text).map_err(|e| fail(e.to_string()))
    }
}
