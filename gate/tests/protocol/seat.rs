//! A controller's place: the process in it, and what the supervisor knows of it.
//!
//! The code's times would never repeat, and the states would have no end. A seat keeps ages instead: how long ago a restart was and
//! how far off one is. Before each sign the life is made anew from them, as if it were always the same millisecond.

use crate::mutation::{self, Mutation};
use crate::rules::{Broken, Rule};
use hapfic_gate::restart::{Life, Order, Policy, Sign, Stage};

/// Length of the window, ms.
const WINDOW: usize = 2;
/// How places are restarted. The first restart is at once, the second waits 1 ms, a third within the window is one too many.
pub const POLICY: Policy = Policy { budget: 2, window_ms: WINDOW as u64, backoff_ms: 1 };
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
    /// What it sends is refused.
    Garbage,
}

/// A place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Seat {
    pub process: Process,
    /// Where its life stands; when a restart is due, counted from [`NOW_MS`].
    pub stage: Stage,
    /// Restarts by their age in ms, youngest first.
    restarts: [u8; WINDOW],
    /// The rules' own account: the budget was spent, and nobody has re-armed since.
    pub spent: bool,
}

impl Default for Seat {
    /// At the start of a run.
    fn default() -> Self {
        Self { process: Process::Joining, stage: Stage::Starting, restarts: [0; WINDOW], spent: false }
    }
}

impl Seat {
    /// The supervisor takes note of something.
    pub fn take_note(&mut self, sign: Sign, mutation: Option<Mutation>, broken: &mut Broken) -> Option<Order> {
        let recent: u32 = self.restarts.iter().map(|n| u32::from(*n)).sum();
        let (life, order) = mutation::live(mutation, self.life(), sign);
        match sign {
            Sign::Lost => {
                self.process = Process::Absent;
                self.spent = self.spent || recent >= POLICY.budget;
            }
            Sign::Rearmed => {
                self.restarts = [0; WINDOW];
                self.spent = false;
            }
            Sign::Ticked | Sign::Time => {}
        }
        if order == Some(Order::Start) {
            broken.expect(Rule::Budget, recent < POLICY.budget);
            broken.expect(Rule::Spent, !self.spent);
            self.process = Process::Joining;
            // One more than allowed is enough to tell, and keeps a mutant's states finite.
            self.restarts[0] = (self.restarts[0] + 1).min(POLICY.budget as u8 + 1);
        }
        self.stage = life.stage;
        broken.expect(Rule::Ages, self.life() == life);
        order
    }

    /// A millisecond passes. What has left the window is forgotten: it counts for nothing any more.
    pub fn grow_older(&mut self) {
        self.restarts.rotate_right(1);
        self.restarts[0] = 0;
        if let Stage::Due(at) = self.stage {
            self.stage = Stage::Due((at - 1).max(NOW_MS));
        }
    }

    /// What the code would know.
    fn life(&self) -> Life {
        let mut life = Life::default();
        for (age, count) in self.restarts.iter().enumerate().rev() {
            for _ in 0..*count {
                life.stage = Stage::Due(0);
                (life, _) = life.after(Sign::Time, NOW_MS - age as u64, &POLICY);
            }
        }
        life.stage = self.stage;
        life
    }
}
