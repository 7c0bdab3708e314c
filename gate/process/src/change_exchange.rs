//! Changes on their way to the gate, and its answers: two wait-free queues of bounded length.
//!
//! Who asks waits only so long. A change that he has given up must not be made later, behind his back: one atomic number says
//! whether the newest change is still offered, so that either the gate takes it or it is withdrawn, never both.

use hapfic_config::{OperatorChange, Parameters};
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Changes, or answers, under way. Only one is offered at a time; the others have been withdrawn.
const DEPTH: usize = 4;
/// How often the one who waits looks for the answer.
const LOOK_EVERY: Duration = Duration::from_micros(500);

/// A change for the gate.
#[derive(Clone, Copy, Debug)]
pub struct Offer {
    id: u64,
    /// Version of the set the change was made on; `None`: it fits any.
    pub made_on: Option<u64>,
    /// The change; its tick is the gate's to choose.
    pub change: OperatorChange,
}

/// What the gate makes of a change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It will take effect.
    Placed,
    /// It was made on another set than the one it would follow.
    Stale,
    /// The run ends before it could take effect.
    TooLate,
    /// Too many changes are waiting for their tick.
    Full,
}

/// The gate's answer.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    id: u64,
    /// What became of it.
    pub verdict: Verdict,
    /// Version that the set has, or would have.
    pub version: u64,
    /// First tick at which it is, or would be, in force.
    pub effective_tick: i64,
    /// Tick that was due when the gate took it.
    pub taken_tick: i64,
    /// The set it follows.
    pub before: Parameters,
}

impl Answer {
    /// The answer to an offer.
    #[must_use]
    pub fn new(offer: &Offer, verdict: Verdict, version: u64, effective_tick: i64, taken_tick: i64, before: Parameters) -> Self {
        Self { id: offer.id, verdict, version, effective_tick, taken_tick, before }
    }
}

/// The offer with this id may be taken.
const fn offered(id: u64) -> u64 {
    2 * id
}

/// The offer with this id may not be taken any more: the gate has it, or it was withdrawn.
const fn settled(id: u64) -> u64 {
    2 * id + 1
}

/// The side that offers.
#[derive(Debug)]
pub struct Desk {
    offers: Producer<Offer>,
    answers: Consumer<Answer>,
    state: Arc<AtomicU64>,
    last: u64,
}

/// The gate's side: nothing in it waits or allocates.
#[derive(Debug)]
pub struct Hatch {
    offers: Consumer<Offer>,
    answers: Producer<Answer>,
    state: Arc<AtomicU64>,
}

/// Both sides.
#[must_use]
pub fn exchange() -> (Desk, Hatch) {
    let (offer, offers) = RingBuffer::new(DEPTH);
    let (answer, answers) = RingBuffer::new(DEPTH);
    let state = Arc::new(AtomicU64::new(settled(0)));
    let hatch = Hatch { offers, answers: answer, state: Arc::clone(&state) };
    (Desk { offers: offer, answers, state, last: 0 }, hatch)
}

impl Desk {
    /// Offers a change and waits for the answer; `None` if the gate did not take it in time: then it never will.
    pub fn ask(&mut self, made_on: Option<u64>, change: &OperatorChange, patience: Duration) -> Option<Answer> {
        self.last += 1;
        let id = self.last;
        // Answers that came too late.
        while self.answers.pop().is_ok() {}
        self.state.store(offered(id), Ordering::Release);
        // Full of withdrawn offers: the gate does not look.
        self.offers.push(Offer { id, made_on, change: *change }).ok()?;
        let asked = Instant::now();
        loop {
            if let Ok(answer) = self.answers.pop()
                && answer.id == id
            {
                return Some(answer);
            }
            if asked.elapsed() > patience && self.withdraw(id) {
                return None;
            }
            // The gate has it, and ended before it could answer.
            if asked.elapsed() > 2 * patience {
                return None;
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    fn withdraw(&self, id: u64) -> bool {
        self.state.compare_exchange(offered(id), settled(id), Ordering::AcqRel, Ordering::Acquire).is_ok()
    }
}

impl Hatch {
    /// The change that is offered, if there is one. To be answered at once.
    pub fn take(&mut self) -> Option<Offer> {
        while let Ok(offer) = self.offers.pop() {
            let taken =
                self.state.compare_exchange(offered(offer.id), settled(offer.id), Ordering::AcqRel, Ordering::Acquire).is_ok();
            if taken {
                return Some(offer);
            }
        }
        None
    }

    /// Says what became of it.
    pub fn answer(&mut self, answer: Answer) {
        // Whoever does not take his answers has stopped waiting for them.
        let _ = self.answers.push(answer);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_config::Settings;

    const SHORT: Duration = Duration::from_millis(5);
    const LONG: Duration = Duration::from_secs(20);

    fn answer(offer: &Offer, before: Parameters) -> Answer {
        Answer::new(offer, Verdict::Placed, 2, 7, 2, before)
    }

    #[test]
    fn what_was_given_up_is_never_taken() {
        let (mut desk, mut hatch) = exchange();
        let change = OperatorChange::default();
        for _ in 0..10 * DEPTH {
            assert!(desk.ask(None, &change, SHORT).is_none());
        }
        assert!(hatch.take().is_none());
    }

    #[test]
    fn an_answer_belongs_to_its_offer() {
        let before = Settings::load("floor", &[]).unwrap().initial;
        let (mut desk, mut hatch) = exchange();
        assert!(desk.ask(None, &OperatorChange::default(), SHORT).is_none());
        let gate = std::thread::spawn(move || {
            loop {
                if let Some(offer) = hatch.take() {
                    // One that nobody waits for comes first.
                    hatch.answer(Answer { id: offer.id - 1, ..answer(&offer, before) });
                    hatch.answer(Answer { version: offer.made_on.unwrap() + 1, ..answer(&offer, before) });
                    return;
                }
                std::thread::yield_now();
            }
        });
        let answer = desk.ask(Some(41), &OperatorChange::default(), LONG).unwrap();
        assert_eq!((answer.verdict, answer.version), (Verdict::Placed, 42));
        gate.join().unwrap();
    }
}
