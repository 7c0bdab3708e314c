//! Contact pairs: duration and peak force.

use super::label::{FixedList, Label};
use super::moments::{MAX_PAIRS, PairSummary};
use super::sample::ContactSample;
use nalgebra::Vector3;

/// Contact pairs, in the order of their first contact.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ContactSums {
    pairs: FixedList<PairSummary, MAX_PAIRS>,
}

impl ContactSums {
    /// Adds the contacts of a tick; `foot_free`: the foot touches nothing.
    pub(super) fn tick(&mut self, contacts: &[ContactSample], foot_free: bool) {
        for (i, contact) in contacts.iter().enumerate() {
            let pair = names(contact);
            if contacts[..i].iter().any(|before| names(before) == pair) {
                continue;
            }
            // A pair may have several contact points: their forces add up.
            let parts = contacts[i..].iter().filter(|other| names(other) == pair);
            let force: Vector3<f64> = parts.map(|part| part.force).sum();
            let new = || PairSummary { body: pair.0, against: pair.1, ..PairSummary::default() };
            if let Some(sum) = self.pairs.entry(|sum| (sum.body, sum.against) == pair, new) {
                sum.ticks += 1;
                sum.foot_free_ticks += u64::from(foot_free);
                sum.peak_n = sum.peak_n.max(force.norm());
            }
        }
    }

    pub(super) fn summary(&self) -> FixedList<PairSummary, MAX_PAIRS> {
        self.pairs
    }
}

fn names(contact: &ContactSample) -> (Label, Label) {
    (contact.body, contact.against)
}
