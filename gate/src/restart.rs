//! The restart of a process's place: when a lost process is started again, and when no more. Pure: the supervisor's main thread runs
//! it, and `supervisor/tests/protocol` explores it together with the gate's protocol.

/// How often, and how fast, a process is started again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RestartPolicy {
    /// Restarts within the window.
    pub budget: u32,
    /// Length of the window, ms.
    pub window_ms: u64,
    /// How long the second restart within a window waits, ms; each further one twice as long. The first does not wait.
    pub backoff_ms: u64,
}

/// Longest back-off, ms.
const LONGEST_BACKOFF_MS: u64 = 1000;

/// What is known of a place.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct RestartState {
    /// Where it stands.
    pub stage: RestartStage,
    /// When it was started again within the window, ms.
    restarts_ms: Vec<u64>,
}

/// Where a place stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum RestartStage {
    /// Its process was started and has not done a tick yet.
    #[default]
    Starting,
    /// Its process does ticks.
    Working,
    /// Its process was lost; the next one is started at this time, ms.
    BackOff(u64),
    /// Its budget is spent; only the operator starts it again.
    GivenUp,
}

/// What the supervisor sees of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RestartSignal {
    /// Its process has done a tick.
    Ticked,
    /// Its process is gone, or was taken for gone and killed.
    Lost,
    /// Time passes.
    Time,
    /// The operator re-arms.
    Rearmed,
}

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RestartAction {
    /// Start a process.
    Start,
    /// The budget is spent: a latched stop.
    Stop,
    /// It is back.
    MarkReady,
}

impl RestartState {
    /// The restart after a signal at a time, and what is to be done.
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
            (RestartStage::GivenUp, RestartSignal::Rearmed) => {
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
            self.stage = RestartStage::GivenUp;
            return Some(RestartAction::Stop);
        }
        let wait = match before {
            0 => 0,
            n => policy.backoff_ms.saturating_mul(1 << (n - 1).min(20)).min(LONGEST_BACKOFF_MS),
        };
        self.stage = RestartStage::BackOff(now_ms + wait);
        None
    }

    /// Restarts within the window that ended when it was lost last.
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
    fn the_first_restart_is_at_once_and_the_others_wait_twice_as_long_each() {
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
        assert_eq!((restart.stage, action), (RestartStage::GivenUp, Some(RestartAction::Stop)));
        assert_eq!(restart.clone().after(RestartSignal::Time, now + 100_000, &POLICY).0.stage, RestartStage::GivenUp, "latched");
        (restart, _) = restart.after(RestartSignal::Rearmed, now, &POLICY);
        assert_eq!(restart.stage, RestartStage::BackOff(now));
    }

    #[test]
    fn restarts_outside_the_window_are_forgotten() {
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
}
