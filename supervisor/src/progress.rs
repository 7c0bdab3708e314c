//! The progress line of a run, on a terminal only.

use crate::latest::StatusSnapshot;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Interval between two updates of the line.
const UPDATE_INTERVAL: Duration = Duration::from_millis(100);

/// Progress line on standard error, rewritten in place.
#[derive(Debug)]
pub struct Progress {
    duration_s: f64,
    terminal: bool,
    updated: Option<Instant>,
}

impl Progress {
    /// Creates a hidden line for a run of `duration_s` [s].
    #[must_use]
    pub fn new(duration_s: f64) -> Self {
        Self { duration_s, terminal: std::io::stderr().is_terminal(), updated: None }
    }

    /// Updates the line if standard error is a terminal and the update interval has passed.
    pub fn show(&mut self, snapshot: &StatusSnapshot, missed: u64) {
        // The default snapshot precedes the first tick.
        if !self.terminal || *snapshot == StatusSnapshot::default() || self.updated.is_some_and(|t| t.elapsed() < UPDATE_INTERVAL)
        {
            return;
        }
        self.updated = Some(Instant::now());
        let width = 24;
        let done = ((snapshot.time_s / self.duration_s).clamp(0.0, 1.0) * f64::from(width)) as usize;
        let [x, y, z] = snapshot.foot_position.map(|v| v * 1e3);
        let line = format!(
            "[{}{}] {:6.2} / {:.0} s  foot {x:6.1} {y:6.1} {z:6.1} mm  F_z {:6.1} of {:5.1} N  missed {missed}  late {}",
            "=".repeat(done),
            " ".repeat(width as usize - done),
            snapshot.time_s,
            self.duration_s,
            snapshot.foot_force[2],
            snapshot.desired_force[2],
            snapshot.late,
        );
        // A closed terminal does not end the run.
        let _ = write!(std::io::stderr(), "\r\x1b[2K{line}");
    }

    /// Removes the line.
    pub fn clear(&self) {
        if self.updated.is_some() {
            let _ = write!(std::io::stderr(), "\r\x1b[2K");
        }
    }
}
