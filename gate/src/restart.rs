//! The life of a process's place: when a lost process is started again, and when no more. Pure: the supervisor's main thread runs
//! it, and `supervisor/tests/protocol` explores it together with the gate's protocol.

/// How often, and how fast, a process is started again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Policy {
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
pub struct Life {
    /// Where it stands.
    pub stage: Stage,
    /// When it was started again within the window, ms.
    restarts_ms: Vec<u64>,
}

/// Where a place stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Its process was started and has not done a tick yet.
    #[default]
    Starting,
    /// Its process does ticks.
    Working,
    /// Its process was lost; the next one is started at this time, ms.
    Due(u64),
    /// Its budget is spent; only the operator starts it again.
    GivenUp,
}

/// What the supervisor sees of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sign {
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
pub enum Order {
    /// Start a process.
    Start,
    /// The budget is spent: a latched stop.
    Stop,
    /// It is back.
    Welcome,
}

impl Life {
    /// The life after a sign at a time, and what is to be done.
    #[must_use]
    pub fn after(mut self, sign: Sign, now_ms: u64, policy: &Policy) -> (Self, Option<Order>) {
        let order = match (self.stage, sign) {
            (Stage::Starting, Sign::Ticked) => {
                self.stage = Stage::Working;
                Some(Order::Welcome)
            }
            (Stage::Starting | Stage::Working, Sign::Lost) => self.lost(now_ms, policy),
            (Stage::Due(at), Sign::Time) if now_ms >= at => {
                self.stage = Stage::Starting;
                self.restarts_ms.push(now_ms);
                Some(Order::Start)
            }
            (Stage::GivenUp, Sign::Rearmed) => {
                self.restarts_ms.clear();
                self.stage = Stage::Due(now_ms);
                None
            }
            (_, Sign::Rearmed) => {
                self.restarts_ms.clear();
                None
            }
            _ => None,
        };
        (self, order)
    }

    fn lost(&mut self, now_ms: u64, policy: &Policy) -> Option<Order> {
        self.restarts_ms.retain(|at| now_ms.saturating_sub(*at) < policy.window_ms);
        let before = self.restarts_ms.len() as u32;
        if before >= policy.budget {
            self.stage = Stage::GivenUp;
            return Some(Order::Stop);
        }
        let wait = match before {
            0 => 0,
            n => policy.backoff_ms.saturating_mul(1 << (n - 1).min(20)).min(LONGEST_BACKOFF_MS),
        };
        self.stage = Stage::Due(now_ms + wait);
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

    const POLICY: Policy = Policy { budget: 3, window_ms: 10_000, backoff_ms: 10 };

    #[test]
    fn the_first_restart_is_at_once_and_the_others_wait_twice_as_long_each() {
        let mut life = Life { stage: Stage::Working, ..Life::default() };
        let mut now = 1000;
        for wait in [0, 10, 20] {
            (life, _) = life.after(Sign::Lost, now, &POLICY);
            assert_eq!(life.stage, Stage::Due(now + wait));
            if wait > 0 {
                let (early, order) = life.clone().after(Sign::Time, now + wait - 1, &POLICY);
                assert_eq!((early.stage, order), (life.stage, None));
            }
            now += wait;
            let order;
            (life, order) = life.after(Sign::Time, now, &POLICY);
            assert_eq!((life.stage, order), (Stage::Starting, Some(Order::Start)));
        }
        let order;
        (life, order) = life.after(Sign::Lost, now, &POLICY);
        assert_eq!((life.stage, order), (Stage::GivenUp, Some(Order::Stop)));
        assert_eq!(life.clone().after(Sign::Time, now + 100_000, &POLICY).0.stage, Stage::GivenUp, "latched");
        (life, _) = life.after(Sign::Rearmed, now, &POLICY);
        assert_eq!(life.stage, Stage::Due(now));
    }

    #[test]
    fn restarts_outside_the_window_are_forgotten() {
        let mut life = Life { stage: Stage::Working, ..Life::default() };
        for n in 0..50 {
            let now = n * 10_000;
            (life, _) = life.after(Sign::Lost, now, &POLICY);
            assert_eq!(life.stage, Stage::Due(now), "loss {n}");
            (life, _) = life.after(Sign::Time, now, &POLICY);
            (life, _) = life.after(Sign::Ticked, now + 5, &POLICY);
            assert_eq!((life.stage, life.restarts()), (Stage::Working, 1));
        }
    }
}
