//! A controller's place: the process in it, and what the supervisor knows of it.
//!
//! The code's times would never repeat, and the states would have no end. A seat keeps ages instead: how long ago a restart was and
//! how far off one is. Before each signal the restart is made anew from them, as if it were always the same millisecond.

use crate::mutation::{self, Mutation};
use crate::rules::{Broken, Rule};
use hapfic_gate::restart::{RestartAction, RestartPolicy, RestartSignal, RestartStage, RestartState};

/// Length of the window, ms.
const WINDOW: usize = 2;
/// How places are restarted. The first restart is at once, the second waits 1 ms, a third within the window is one too many.
pub const POLICY: RestartPolicy = RestartPolicy { budget: 2, window_ms: WINDOW as u64, backoff_ms: 1 };
/// The millisecond that it always is.
pub const NOW_MS: u64 = 1000;

/// The process in a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Process {
    /// There is none, and the supervisor knows it.
    Absent,
    /// It was started and does not answer yet.
    Joining,
    /// It answers, in time or late.
    Present,
    /// It was killed or hangs: until a detector speaks, both are silence.
    Silent,
    /// What it sends is rejected.
    Garbage,
}

/// A place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Seat {
    pub process: Process,
    /// Where its restart stands; when a restart is due, counted from [`NOW_MS`].
    pub stage: RestartStage,
    /// Restarts by their age in ms, youngest first.
    restarts: [u8; WINDOW],
    /// The rules' own account: the budget was spent, and nobody has re-armed since.
    pub spent: bool,
}

impl Default for Seat {
    /// At the start of a run.
    fn default() -> Self {
        Self { process: Process::Joining, stage: RestartStage::Starting, restarts: [0; WINDOW], spent: false }
    }
}

impl Seat {
    /// The supervisor takes note of something.
    pub fn take_note(&mut self, signal: RestartSignal, mutation: Option<Mutation>, broken: &mut Broken) -> Option<RestartAction> {
        let recent: u32 = self.restarts.iter().map(|n| u32::from(*n)).sum();
        let (restart, action) = mutation::live(mutation, self.restart(), signal);
        match signal {
            RestartSignal::Lost => {
                self.process = Process::Absent;
                self.spent = self.spent || recent >= POLICY.budget;
            }
            RestartSignal::Rearmed => {
                self.restarts = [0; WINDOW];
                self.spent = false;
            }
            RestartSignal::Ticked | RestartSignal::Time => {}
        }
        if action == Some(RestartAction::Start) {
            broken.expect(Rule::Budget, recent < POLICY.budget);
            broken.expect(Rule::Spent, !self.spent);
            self.process = Process::Joining;
            // One more than allowed is enough to tell, and keeps a mutant's states finite.
            self.restarts[0] = (self.restarts[0] + 1).min(POLICY.budget as u8 + 1);
        }
        self.stage = restart.stage;
        broken.expect(Rule::Ages, self.restart() == restart);
        action
    }

    /// A millisecond passes. What has left the window is forgotten: it counts for nothing any more.
    pub fn grow_older(&mut self) {
        self.restarts.rotate_right(1);
        self.restarts[0] = 0;
        if let RestartStage::BackOff(at) = self.stage {
            self.stage = RestartStage::BackOff((at - 1).max(NOW_MS));
        }
    }

    /// What the code would know.
    fn restart(&self) -> RestartState {
        let mut restart = RestartState::default();
        for (age, count) in self.restarts.iter().enumerate().rev() {
            for _ in 0..*count {
                restart.stage = RestartStage::BackOff(0);
                (restart, _) = restart.after(RestartSignal::Time, NOW_MS - age as u64, &POLICY);
            }
        }
        restart.stage = self.stage;
        restart
    }
}
