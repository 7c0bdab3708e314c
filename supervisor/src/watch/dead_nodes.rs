//! Dead processes whose nodes have to be cleaned up, and ports that have to reconnect.

use super::clean_up::{CleanUp, CleanUpState, SegmentRemover};
use anyhow::Result;
use std::path::Path;
use std::time::{Duration, Instant};

/// Time that a successor waits for the clean-up behind its predecessor.
const TAKE_OVER_TIMEOUT: Duration = Duration::from_millis(500);
/// Interval at which it looks.
const LOOK_INTERVAL: Duration = Duration::from_millis(1);

/// Dead processes of a run, and their clean-up.
#[derive(Debug)]
pub struct DeadNodes {
    pub(super) helper: CleanUp,
    pub(super) segments: SegmentRemover,
    /// Dead processes whose nodes are not cleaned up yet.
    pub(super) count: u32,
    /// Whether all ports reconnect after the clean-up.
    pub(super) reconnect_due: bool,
    /// Failed connections of this process that were repaired.
    pub(super) own_failed: u32,
}

impl DeadNodes {
    /// Starts to look for what killed processes have left unfinished. `prefix` begins the names of the run's segments.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub fn new(prefix: &str) -> Result<Self> {
        let segments = SegmentRemover::start(prefix.to_owned())?;
        Ok(Self { helper: CleanUp::default(), segments, count: 0, reconnect_due: false, own_failed: 0 })
    }

    /// Cleans up behind a lost supervisor, before its successor opens ports: those of the dead take up places.
    pub fn clean_up_predecessor(&mut self, run_file: &Path, priority: Option<u32>) {
        self.segments.process_lost();
        self.helper.request();
        let begun = Instant::now();
        while self.helper.poll(run_file, priority) == CleanUpState::Running && begun.elapsed() < TAKE_OVER_TIMEOUT {
            std::thread::sleep(LOOK_INTERVAL);
        }
    }
}
