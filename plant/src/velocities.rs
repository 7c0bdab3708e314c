//! The velocities of a world as one vector: the leg's joints first, then six for each object.

use hapfic_messages::{MAX_JOINTS, MAX_OBJECTS};

/// Most velocities a world has.
pub(crate) const MAX_SPEEDS: usize = MAX_JOINTS + 6 * MAX_OBJECTS;

/// A value for each velocity.
pub(crate) type VelocityVector = [f64; MAX_SPEEDS];
