//! Harmonic planner (HapFIC, eqs. 2-3): moves the reference smoothly to a target position.
//!
//! The reference moves from rest to rest along a harmonic arc. It is a piecewise closed form of the time since
//! acceptance of the target, without integration. It therefore ends on the target at rest, without drift or chatter. A
//! new target is valid at any tick: position and velocity stay continuous, and the acceleration never exceeds its
//! limit.
//!
//! Read `harmonic_arc.rs` first: the formula of one axis. `planner.rs` has three of them, `plan.rs` the tick.
//!
//! The law is pure: [`step`] takes a state and returns the next one. The state is plain data
//! ([`hapfic_messages::PlannerState`]) and complete: a planner that restarts from a copy continues bit for bit.
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

mod harmonic_arc;
mod plan;
mod planner;
mod rotation;

pub use plan::TickPlan;
pub use planner::{PEAK_TO_MEAN, PlannerParameters, Setpoint, hold, setpoint, step};
