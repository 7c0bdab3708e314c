//! Sums over the sub-steps of a tick: force sensor, contacts, and the integrator's counters.

use crate::contact_point::ContactPoint;
use crate::scene::ContactPair;
use hapfic_messages::{ContactState, MAX_CONTACTS, Physics};
use hapfic_robot::JointVector;
use nalgebra::Vector3;

/// Result of a tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct TickResult {
    /// Mean force on the sensor [N].
    pub sensed_force: Vector3<f64>,
    /// Mean moment on the sensor about the tip [N m].
    pub sensed_moment: Vector3<f64>,
    /// Mean torque of the drive [N m], [N] for a prismatic joint.
    pub torque: JointVector,
    /// Largest normal force of any sub-step at any contact point [N].
    pub peak_normal: f64,
    /// Contacts of the tick, at most one per pair and [`MAX_CONTACTS`] in all.
    pub contacts: [ContactState; MAX_CONTACTS],
    /// Number of valid entries in `contacts`.
    pub contact_count: usize,
    /// Account of the integrator.
    pub physics: Physics,
}

/// Sums of a pair over a tick.
#[derive(Clone, Copy, Debug, Default)]
struct PairSum {
    impulse: Vector3<f64>,
    /// Sum of the points, weighted by the size of the impulse.
    moment: Vector3<f64>,
    weight: f64,
    /// Largest depth in sub-step number `substep` [m].
    depth: f64,
    substep: u32,
}

/// Sums over the sub-steps of a tick.
#[derive(Clone, Debug)]
pub(crate) struct TickSums {
    sensed: Vector3<f64>,
    sensed_moment: Vector3<f64>,
    /// Tip of the robot in the present sub-step [m].
    pub(crate) tip: Vector3<f64>,
    pairs: Vec<PairSum>,
    pub(crate) peak_normal: f64,
    pub(crate) physics: Physics,
}

impl TickSums {
    pub(crate) fn new(pairs: usize) -> Self {
        Self {
            sensed: Vector3::zeros(),
            sensed_moment: Vector3::zeros(),
            tip: Vector3::zeros(),
            pairs: vec![PairSum::default(); pairs],
            peak_normal: 0.0,
            physics: Physics::default(),
        }
    }

    /// Resets all sums for the next tick.
    pub(crate) fn clear(&mut self) {
        self.sensed = Vector3::zeros();
        self.sensed_moment = Vector3::zeros();
        self.pairs.fill(PairSum::default());
        self.peak_normal = 0.0;
        self.physics = Physics::default();
    }

    /// Adds the force that acts at a contact point of a pair for `h` [s].
    pub(crate) fn add(&mut self, pair: usize, sensed: bool, contact: &ContactPoint, force: Vector3<f64>, h: f64) {
        if sensed {
            self.sensed += force * h;
            self.sensed_moment += (contact.point - self.tip).cross(&force) * h;
        }
        let sum = &mut self.pairs[pair];
        let weight = force.norm() * h;
        sum.impulse += force * h;
        sum.moment += weight * contact.point;
        sum.weight += weight;
        if sum.substep != self.physics.substeps || contact.depth > sum.depth {
            (sum.substep, sum.depth) = (self.physics.substeps, contact.depth);
        }
    }

    pub(crate) fn finish(&self, pairs: &[ContactPair], duration: f64) -> TickResult {
        let mut result = TickResult {
            sensed_force: self.sensed / duration,
            sensed_moment: self.sensed_moment / duration,
            peak_normal: self.peak_normal,
            physics: self.physics,
            ..TickResult::default()
        };
        let touched = pairs.iter().zip(&self.pairs).filter(|(_, sum)| sum.weight > 0.0);
        for (contact, (pair, sum)) in result.contacts.iter_mut().zip(touched) {
            *contact = ContactState {
                body: pair.body.name_index as u32,
                against: pair.against.name_index as u32,
                point: (sum.moment / sum.weight).into(),
                force: (sum.impulse / duration).into(),
                depth: sum.depth,
            };
            result.contact_count += 1;
        }
        result
    }
}
