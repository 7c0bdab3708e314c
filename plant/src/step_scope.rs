//! Bodies that take part in a sub-step, and the sources of its constraints.

use crate::contact_point::ContactPoint;
use crate::scene::ContactPair;
use nalgebra::Matrix3;

/// Gap up to which a pair counts as a contact [m], on top of the travel possible in a sub-step.
pub(crate) const CLEARANCE: f64 = 1e-4;

/// Bodies that take part in a sub-step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StepScope {
    /// Leg and objects.
    All,
    /// The objects alone; the leg is far away.
    Objects,
    /// The objects, with the leg as a fixed obstacle.
    ObjectsAndHeldLeg,
}

impl StepScope {
    pub(crate) fn pair(self, pair: &ContactPair) -> bool {
        match self {
            Self::All => true,
            Self::Objects => !pair.has_link(),
            Self::ObjectsAndHeldLeg => pair.has_object(),
        }
    }
}

/// Source of a constraint point: a pair with its contact point and directions, or a joint's stop.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ConstraintSource {
    Pair { index: usize, contact: ContactPoint, axes: Matrix3<f64> },
    Stop,
}
