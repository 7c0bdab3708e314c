//! What a tick's sub-steps add up to: the sensor, the contacts, the integrator's own account.

use crate::contact_point::ContactPoint;
use crate::scene::Pair;
use hapfic_messages::{ContactState, MAX_CONTACTS, Physics};
use hapfic_robot::JointVector;
use nalgebra::Vector3;

/// What came out of a tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct Advance {
    /// Mean force on the sensor, N.
    pub sensed_force: Vector3<f64>,
    /// Mean torque of the drive.
    pub torque: JointVector,
    /// Largest normal force of any sub-step at any contact point, N.
    pub peak_normal: f64,
    /// Contacts of the tick, one a pair; the first [`MAX_CONTACTS`] of them.
    pub contacts: [ContactState; MAX_CONTACTS],
    /// How many of them.
    pub contact_count: usize,
    /// The account; energies are filled in by the plant.
    pub physics: Physics,
}

/// Sums of a pair over a tick.
#[derive(Clone, Copy, Debug, Default)]
struct PairSum {
    impulse: Vector3<f64>,
    /// Points, weighted by the impulse's size, and the sum of the weights.
    moment: Vector3<f64>,
    weight: f64,
    /// Deepest point of the sub-step numbered `substep`.
    depth: f64,
    substep: u32,
}

/// Sums over the sub-steps of a tick.
#[derive(Clone, Debug)]
pub(crate) struct Account {
    sensed: Vector3<f64>,
    pairs: Vec<PairSum>,
    pub(crate) peak_normal: f64,
    pub(crate) physics: Physics,
}

impl Account {
    pub(crate) fn new(pairs: usize) -> Self {
        Self { sensed: Vector3::zeros(), pairs: vec![PairSum::default(); pairs], peak_normal: 0.0, physics: Physics::default() }
    }

    /// For the next tick.
    pub(crate) fn clear(&mut self) {
        self.sensed = Vector3::zeros();
        self.pairs.fill(PairSum::default());
        self.peak_normal = 0.0;
        self.physics = Physics::default();
    }

    /// Adds the force that acts at a point of a pair for `h`, s.
    pub(crate) fn add(&mut self, pair: usize, sensed: bool, touch: &ContactPoint, force: Vector3<f64>, h: f64) {
        if sensed {
            self.sensed += force * h;
        }
        let sum = &mut self.pairs[pair];
        let weight = force.norm() * h;
        sum.impulse += force * h;
        sum.moment += weight * touch.point;
        sum.weight += weight;
        if sum.substep != self.physics.substeps || touch.depth > sum.depth {
            (sum.substep, sum.depth) = (self.physics.substeps, touch.depth);
        }
    }

    pub(crate) fn finish(&self, pairs: &[Pair], duration: f64) -> Advance {
        let mut advance = Advance {
            sensed_force: self.sensed / duration,
            peak_normal: self.peak_normal,
            physics: self.physics,
            ..Advance::default()
        };
        let touched = pairs.iter().zip(&self.pairs).filter(|(_, sum)| sum.weight > 0.0);
        for (place, (pair, sum)) in advance.contacts.iter_mut().zip(touched) {
            *place = ContactState {
                body: pair.body.name as u32,
                against: pair.against.name as u32,
                point: (sum.moment / sum.weight).into(),
                force: (sum.impulse / duration).into(),
                depth: sum.depth,
            };
            advance.contact_count += 1;
        }
        advance
    }
}
