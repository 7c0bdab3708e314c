//! What a run is asked to be.

use hapfic_config::Settings;
use hapfic_messages::{Clock, RealtimeMode};
use std::path::PathBuf;
use std::time::Instant;

/// What to run.
#[derive(Clone, Debug)]
pub struct RunRequest {
    /// Name for messages and the log.
    pub scenario: String,
    /// The checked scenario.
    pub settings: Settings,
    /// How time passes.
    pub clock: Clock,
    /// How hard to try for real time.
    pub realtime: RealtimeMode,
    /// Where to log.
    pub log: PathBuf,
    /// When the program started.
    pub since: Instant,
}
