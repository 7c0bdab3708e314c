//! The harmonic planner (HapFIC, eqs. 2-3): from a target position to a reference that moves there smoothly.
//!
//! The reference goes from rest to rest along a harmonic arc. It is a piecewise closed form of the time since its target
//! was accepted and is never integrated, so it lands on the target at rest, without drift or chatter. A new target may
//! come at any tick: position and velocity stay continuous and the acceleration never exceeds its limit.
//!
//! The law is pure: [`step`] takes a state and returns the next one. The state is plain data
//! ([`hapfic_messages::PlannerState`]) and holds everything, so a planner that is restarted from a copy of it goes on
//! bit for bit.
//!
//! ```
//! use hapfic_planner::{PlannerParameters, hold, step};
//!
//! let parameters = PlannerParameters { mean_speed_m_per_s: 0.5, max_acceleration_m_per_s2: 10.0 };
//! let target = [0.3, 0.0, -0.4];
//! let mut state = hold([0.1, 0.0, -0.5]);
//! let mut reference = [0.0; 3];
//! for _ in 0..1000 {
//!     let (next, setpoint) = step(state, target, &parameters, 1e-3);
//!     state = next;
//!     reference = setpoint.position_m;
//! }
//! assert_eq!(reference, target);
//! ```

mod axis;
mod plan;
mod planner;

pub use plan::Plan;
pub use planner::{PEAK_TO_MEAN, PlannerParameters, Setpoint, hold, setpoint, step};
