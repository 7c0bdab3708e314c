//! The request for a run.

use hapfic_config::Settings;
use hapfic_messages::{Clock, RealtimeMode};
use std::path::PathBuf;
use std::time::Instant;

/// Request for a run.
#[derive(Clone, Debug)]
pub struct RunRequest {
    /// Name of the scenario, for messages and the log.
    pub scenario: String,
    /// The checked scenario.
    pub settings: Settings,
    /// Clock of the run.
    pub clock: Clock,
    /// Whether the run takes, requires or leaves real-time privileges.
    pub realtime: RealtimeMode,
    /// Path of the log.
    pub log: PathBuf,
    /// Start of the program.
    pub since: Instant,
}
