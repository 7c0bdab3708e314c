//! Velocities of a world as one vector: the leg's joints first, then six per object.

use hapfic_messages::{MAX_JOINTS, MAX_OBJECTS};

/// Maximum number of velocities of a world.
pub(crate) const MAX_SPEEDS: usize = MAX_JOINTS + 6 * MAX_OBJECTS;

/// One value per velocity.
pub(crate) type VelocityVector = [f64; MAX_SPEEDS];
