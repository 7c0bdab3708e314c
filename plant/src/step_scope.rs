//! What takes part in a sub-step, and where its constraints come from.

use crate::contact_point::ContactPoint;
use crate::scene::Pair;
use nalgebra::Matrix3;

/// A contact this near, m, is treated as one, besides the way that can be covered in a sub-step.
pub(crate) const CLEARANCE: f64 = 1e-4;

/// What takes part in a sub-step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StepScope {
    /// Leg and objects.
    All,
    /// The objects; the leg is far away.
    Objects,
    /// The objects; the leg is held where it is, and may be in their way.
    ObjectsAndHeldLeg,
}

impl StepScope {
    pub(crate) fn pair(self, pair: &Pair) -> bool {
        match self {
            Self::All => true,
            Self::Objects => !pair.has_link(),
            Self::ObjectsAndHeldLeg => pair.has_object(),
        }
    }
}

/// Whose a point is: a pair with its place and directions, or a joint's stop.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ConstraintSource {
    Pair { index: usize, touch: ContactPoint, axes: Matrix3<f64> },
    Stop,
}
