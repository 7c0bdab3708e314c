//! Restart of a lost process: its back-off and its budget.
//!
//! Pure: the supervisor's main thread runs it, and `tests/protocol` explores it together with the gate's protocol.

/// Restart policy of the supervisor for a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RestartPolicy {
    /// Restarts within the window.
    pub budget: u32,
    /// Length of the window [ms].
    pub window_ms: u64,
    /// Back-off of the second restart within a window [ms], doubled at each further one. The first does not wait.
    pub backoff_ms: u64,
}

/// Longest back-off [ms].
const LONGEST_BACKOFF_MS: u64 = 1000;

/// Restart state of a process's slot.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct RestartState {
    /// Current stage.
    pub stage: RestartStage,
    /// Times of the restarts within the window [ms].
    restarts_ms: Vec<u64>,
}

/// Stage of a slot's restart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum RestartStage {
    /// The process was started and has not run a tick yet.
    #[default]
    Starting,
    /// The process runs ticks.
    Working,
    /// The process was lost; the next start is at this time [ms].
    BackOff(u64),
    /// The budget is spent; only the operator can cause another start.
    BudgetSpent,
}

/// Signal to a slot's restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RestartSignal {
    /// The process has run a tick.
    Ticked,
    /// The process has ended, or a detector reported it and it was killed.
    Lost,
    /// Time has passed.
    Time,
    /// The operator has re-armed.
    Rearmed,
}

/// Action that the supervisor has to take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RestartAction {
    /// Start a process.
    Start,
    /// Trip a latched stop: the budget is spent.
    Stop,
    /// Mark the process as ready.
    MarkReady,
}

impl RestartState {
    /// State of a slot that another supervisor has watched: its earlier restarts are not known.
    #[must_use]
    pub fn at(stage: RestartStage) -> Self {
        Self { stage, restarts_ms: Vec::new() }
    }

    /// State after a signal at a time, and the action to take.
    #[must_use]
    pub fn after(mut self, signal: RestartSignal, now_ms: u64, policy: &RestartPolicy) -> (Self, Option<RestartAction>) {
        let action = match (self.stage, signal) {
            (RestartStage::Starting, RestartSignal::Ticked) => {
                self.stage = RestartStage::Working;
                Some(RestartAction::MarkReady)
            }
            (RestartStage::Starting | RestartStage::Working, RestartSignal::Lost) => self.lost(now_ms, policy),
            (RestartStage::BackOff(at), RestartSignal::Time) if now_ms >= at => {
                self.stage = RestartStage::Starting;
                self.restarts_ms.push(now_ms);
                Some(RestartAction::Start)
            }
            (RestartStage::BudgetSpent, RestartSignal::Rearmed) => {
                self.restarts_ms.clear();
                self.stage = RestartStage::BackOff(now_ms);
                None
            }
            (_, RestartSignal::Rearmed) => {
                self.restarts_ms.clear();
                None
            }
            _ => None,
        };
        (self, action)
    }

    fn lost(&mut self, now_ms: u64, policy: &RestartPolicy) -> Option<RestartAction> {
        self.restarts_ms.retain(|at| now_ms.saturating_sub(*at) < policy.window_ms);
        let before = self.restarts_ms.len() as u32;
        if before >= policy.budget {
            self.stage = RestartStage::BudgetSpent;
            return Some(RestartAction::Stop);
        }
        let wait = match before {
            0 => 0,
            n => policy.backoff_ms.saturating_mul(1 << (n - 1).min(20)).min(LONGEST_BACKOFF_MS),
        };
        self.stage = RestartStage::BackOff(now_ms + wait);
        None
    }

    /// Restarts within the window that ended at the last loss.
    #[must_use]
    pub fn restarts(&self) -> usize {
        self.restarts_ms.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POLICY: RestartPolicy = RestartPolicy { budget: 3, window_ms: 10_000, backoff_ms: 10 };

    #[test]
    fn restart_first_immediate_then_backoff_doubles() {
        let mut restart = RestartState { stage: RestartStage::Working, ..RestartState::default() };
        let mut now = 1000;
        for wait in [0, 10, 20] {
            (restart, _) = restart.after(RestartSignal::Lost, now, &POLICY);
            assert_eq!(restart.stage, RestartStage::BackOff(now + wait));
            if wait > 0 {
                let (early, action) = restart.clone().after(RestartSignal::Time, now + wait - 1, &POLICY);
                assert_eq!((early.stage, action), (restart.stage, None));
            }
            now += wait;
            let action;
            (restart, action) = restart.after(RestartSignal::Time, now, &POLICY);
            assert_eq!((restart.stage, action), (RestartStage::Starting, Some(RestartAction::Start)));
        }
        let action;
        (restart, action) = restart.after(RestartSignal::Lost, now, &POLICY);
        assert_eq!((restart.stage, action), (RestartStage::BudgetSpent, Some(RestartAction::Stop)));
        assert_eq!(
            restart.clone().after(RestartSignal::Time, now + 100_000, &POLICY).0.stage,
            RestartStage::BudgetSpent,
            "latched"
        );
        (restart, _) = restart.after(RestartSignal::Rearmed, now, &POLICY);
        assert_eq!(restart.stage, RestartStage::BackOff(now));
    }

    #[test]
    fn restart_rearm_of_working_process_restores_budget() {
        let mut restart = RestartState { stage: RestartStage::Working, ..RestartState::default() };
        assert_eq!(restart.restarts(), 0);
        for number in 1..=3 {
            (restart, _) = restart.after(RestartSignal::Lost, 1000, &POLICY);
            (restart, _) = restart.after(RestartSignal::Time, 2000, &POLICY);
            assert_eq!(restart.restarts(), number);
        }
        (restart, _) = restart.after(RestartSignal::Ticked, 2000, &POLICY);
        let (rearmed, action) = restart.clone().after(RestartSignal::Rearmed, 2000, &POLICY);
        assert_eq!((rearmed.stage, action, rearmed.restarts()), (RestartStage::Working, None, 0));
        assert_eq!(rearmed.after(RestartSignal::Lost, 2000, &POLICY).0.stage, RestartStage::BackOff(2000));
        assert_eq!(restart.after(RestartSignal::Lost, 2000, &POLICY).0.stage, RestartStage::BudgetSpent);
    }

    #[test]
    fn restart_outside_window_not_counted() {
        let mut restart = RestartState { stage: RestartStage::Working, ..RestartState::default() };
        for n in 0..50 {
            let now = n * 10_000;
            (restart, _) = restart.after(RestartSignal::Lost, now, &POLICY);
            assert_eq!(restart.stage, RestartStage::BackOff(now), "loss {n}");
            (restart, _) = restart.after(RestartSignal::Time, now, &POLICY);
            (restart, _) = restart.after(RestartSignal::Ticked, now + 5, &POLICY);
            assert_eq!((restart.stage, restart.restarts()), (RestartStage::Working, 1));
        }
    }

    #[test]
    fn restart_backoff_capped_for_any_budget() {
        let policy = RestartPolicy { budget: 200, window_ms: u64::MAX, backoff_ms: 10 };
        let mut restart = RestartState { stage: RestartStage::Working, ..RestartState::default() };
        let mut now = 0;
        for loss in 0..200_u32 {
            (restart, _) = restart.after(RestartSignal::Lost, now, &policy);
            let wait = match loss {
                0 => 0,
                n if n <= 7 => 10 << (n - 1),
                _ => 1000,
            };
            assert_eq!(restart.stage, RestartStage::BackOff(now + wait), "loss {loss}");
            now += wait;
            (restart, _) = restart.after(RestartSignal::Time, now, &policy);
        }
        // A back-off above the cap from the start.
        let slow = RestartPolicy { backoff_ms: u64::MAX, ..policy };
        let mut restart = RestartState { stage: RestartStage::Working, ..RestartState::default() };
        for expected in [0, 1000, 1000] {
            (restart, _) = restart.after(RestartSignal::Lost, 0, &slow);
            assert_eq!(restart.stage, RestartStage::BackOff(expected));
            (restart, _) = restart.after(RestartSignal::Time, expected, &slow);
        }
    }
}
