//! Contact pairs: duration and peak force.

use super::label::{Label, List};
use super::moments::{MAX_PAIRS, PairSummary};
use super::objects::norm;
use super::sample::ContactSample;

/// Contact pairs, in the order of their first contact.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Contacts {
    pairs: List<PairSummary, MAX_PAIRS>,
}

impl Contacts {
    /// Adds the contacts of a tick; `foot_free`: the foot touches nothing.
    pub(super) fn tick(&mut self, contacts: &[ContactSample], foot_free: bool) {
        for (i, contact) in contacts.iter().enumerate() {
            let pair = names(contact);
            if contacts[..i].iter().any(|before| names(before) == pair) {
                continue;
            }
            // A pair may have several contact points: their forces add up.
            let mut force = [0.0; 3];
            for part in contacts[i..].iter().filter(|other| names(other) == pair) {
                force = std::array::from_fn(|axis| force[axis] + part.force[axis]);
            }
            let new = || PairSummary { body: pair.0, against: pair.1, ..PairSummary::default() };
            if let Some(sum) = self.pairs.entry(|sum| (sum.body, sum.against) == pair, new) {
                sum.ticks += 1;
                sum.foot_free_ticks += u64::from(foot_free);
                sum.peak_n = sum.peak_n.max(norm(force));
            }
        }
    }

    pub(super) fn summary(&self) -> List<PairSummary, MAX_PAIRS> {
        self.pairs
    }
}

fn names(contact: &ContactSample) -> (Label, Label) {
    (contact.body, contact.against)
}
