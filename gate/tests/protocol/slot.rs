//! Model of a controller's slot: its process, and the supervisor's knowledge of it.
//!
//! The code's times would never repeat, so the states would have no end. The model keeps ages instead: the time since
//! each restart, and until the next. Before each signal it rebuilds the restart state from them, at a constant time.

use crate::mutation::{self, Mutation};
use crate::rules::{BrokenRules, Rule};
use hapfic_gate::restart_policy::{RestartAction, RestartPolicy, RestartSignal, RestartStage, RestartState};

/// Length of the window [ms].
const WINDOW: usize = 2;
/// Policy of the restarts. The first is immediate, the second waits 1 ms, a third within the window exceeds the budget.
pub const POLICY: RestartPolicy = RestartPolicy { budget: 2, window_ms: WINDOW as u64, backoff_ms: 1 };
/// Constant time of the model [ms].
pub const NOW_MS: u64 = 1000;

/// Process in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ProcessModel {
    /// There is no process, and the supervisor knows it.
    Missing,
    /// The process was started and does not answer yet.
    Joining,
    /// The process answers, in time or late.
    Present,
    /// The process was killed or hangs: until a detector reports, both are indistinguishable.
    Silent,
    /// The gate rejects its requests.
    Garbage,
}

/// Model of a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SlotModel {
    pub process: ProcessModel,
    /// Stage of its restart; a due time counts from [`NOW_MS`].
    pub stage: RestartStage,
    /// Number of restarts by age [ms], youngest first.
    restarts: [u8; WINDOW],
    /// The rules' own account: the budget is spent, without a re-arm since.
    pub spent: bool,
}

impl Default for SlotModel {
    /// Slot at the start of a run.
    fn default() -> Self {
        Self { process: ProcessModel::Joining, stage: RestartStage::Starting, restarts: [0; WINDOW], spent: false }
    }
}

impl SlotModel {
    /// Processes a signal to the supervisor.
    pub fn on_signal(
        &mut self,
        signal: RestartSignal,
        mutation: Option<Mutation>,
        broken: &mut BrokenRules,
    ) -> Option<RestartAction> {
        let recent: u32 = self.restarts.iter().map(|n| u32::from(*n)).sum();
        let (restart, action) = mutation::restart_after(mutation, self.restart(), signal);
        match signal {
            RestartSignal::Lost => {
                self.process = ProcessModel::Missing;
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
            self.process = ProcessModel::Joining;
            // One restart above the budget breaks the rule, and keeps a mutant's states finite.
            self.restarts[0] = (self.restarts[0] + 1).min(POLICY.budget as u8 + 1);
        }
        self.stage = restart.stage;
        broken.expect(Rule::Ages, self.restart() == restart);
        action
    }

    /// Lets a millisecond pass. Restarts that leave the window no longer count.
    pub fn advance_ms(&mut self) {
        self.restarts.rotate_right(1);
        self.restarts[0] = 0;
        if let RestartStage::BackOff(at) = self.stage {
            self.stage = RestartStage::BackOff((at - 1).max(NOW_MS));
        }
    }

    /// Restart state of the code that corresponds to the model.
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
