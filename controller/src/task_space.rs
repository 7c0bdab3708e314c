//! Task-space FIC: haptic search, error and attractor on the three axes of the world frame (eqs. 1, 4, 5, Algorithm 1).

use crate::axis::{AxisInput, AxisLaw, AxisState};
use hapfic_messages::{ControllerState, Parameters, ResetPolicy, Saturation, Search};

/// Error of the task-space law: it gives no force.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TaskSpaceError {
    /// An input, or the error computed from it, is not finite.
    #[error(
        "task-space FIC: {quantity}[{index}] is {found}, expected a finite number; reject its message and publish no request \
        for this tick"
    )]
    NotFinite {
        /// Name of the quantity.
        quantity: &'static str,
        /// Axis; 0 for a scalar.
        index: usize,
        /// Value found.
        found: f64,
    },
    /// The code of a policy is unknown.
    #[error("task-space FIC: {quantity} has code {found}, expected 0 to {last}; reject its parameter set")]
    UnknownPolicy {
        /// Name of the policy.
        quantity: &'static str,
        /// Code found.
        found: u32,
        /// Largest known code.
        last: usize,
    },
    /// The control tick is not a finite, positive time.
    #[error("task-space FIC: the period is {found} s, expected a finite, positive time; pass the control tick")]
    Period {
        /// Value found [s].
        found: f64,
    },
}

/// Decoded policies of a parameter set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Policies {
    /// Treatment of the offset while the search is at rest.
    pub reset_policy: ResetPolicy,
    /// Saturation of the force profile.
    pub saturation: Saturation,
    /// Step of the haptic search.
    pub search: Search,
    /// Whether dx stops at F_max (conditional integration), and gets a bumpless offset after a change of gains.
    pub offset_anti_windup: bool,
    /// Whether a convergence that came to rest restarts from there.
    pub stall_release: bool,
    /// Whether in contact dx follows the reference, keeps the force, and returns slowly.
    pub force_hold: bool,
    /// Whether the force is continuous where divergence is entered again.
    pub continuous_reentry: bool,
}

/// Decodes the policies; `None` if a code is unknown.
#[must_use]
pub fn policies(p: &Parameters) -> Option<Policies> {
    decode(p).ok()
}

/// Inputs of the law in one tick, world frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TaskSpaceInput {
    /// x, foot position [m].
    pub position: [f64; 3],
    /// J q', foot velocity [m/s].
    pub velocity: [f64; 3],
    /// x_d [m].
    pub reference_position: [f64; 3],
    /// x_d' [m/s].
    pub reference_velocity: [f64; 3],
    /// F, measured reaction on the foot, unfiltered [N].
    pub contact_force: [f64; 3],
}

/// Outputs of the law in one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TaskSpaceOutput {
    /// State after this tick.
    pub state: ControllerState,
    /// e = x_d + dx - x [m].
    pub error: [f64; 3],
    /// e' = x_d' - J q' [m/s], without the motion of the search; where dx follows the reference, -J q'.
    pub error_rate: [f64; 3],
    /// F_c, within +-F_max [N].
    pub force: [f64; 3],
}

/// Runs one control tick of `period_s` [s] from the state after the previous tick. The law itself keeps no state.
///
/// # Errors
/// [`TaskSpaceError`] if a number of state, input or parameters is not finite, the code of a policy is unknown, or the
/// period is not a positive time.
#[inline]
pub fn step(
    state: ControllerState,
    input: &TaskSpaceInput,
    p: &Parameters,
    period_s: f64,
) -> Result<TaskSpaceOutput, TaskSpaceError> {
    check(&state, input, p, period_s)?;
    let policies = decode(p)?;
    let mut output = TaskSpaceOutput { state, ..TaskSpaceOutput::default() };
    for axis in 0..3 {
        let law = AxisLaw::new(p, &policies, axis, period_s);
        let motion = AxisInput {
            distance: input.reference_position[axis] - input.position[axis],
            reference: input.reference_position[axis],
            position: input.position[axis],
            reference_velocity: input.reference_velocity[axis],
            velocity: input.velocity[axis],
            measured: input.contact_force[axis],
        };
        let out = law.step(AxisState::read(&state, axis), &motion);
        out.state.write(&mut output.state, axis);
        output.error[axis] = out.error;
        output.error_rate[axis] = out.error_rate;
        output.force[axis] = out.force;
    }
    // A difference of finite numbers near the largest can overflow.
    check_finite("error", &output.error)?;
    check_finite("error_rate", &output.error_rate)?;
    Ok(output)
}

fn decode(p: &Parameters) -> Result<Policies, TaskSpaceError> {
    let unknown = |quantity, found, variants: usize| TaskSpaceError::UnknownPolicy { quantity, found, last: variants - 1 };
    Ok(Policies {
        reset_policy: ResetPolicy::from_code(p.reset_policy)
            .ok_or_else(|| unknown("reset_policy", p.reset_policy, ResetPolicy::ALL.len()))?,
        saturation: Saturation::from_code(p.saturation)
            .ok_or_else(|| unknown("saturation", p.saturation, Saturation::ALL.len()))?,
        search: Search::from_code(p.search).ok_or_else(|| unknown("search", p.search, Search::ALL.len()))?,
        offset_anti_windup: switch(p.offset_anti_windup).ok_or_else(|| unknown("offset_anti_windup", p.offset_anti_windup, 2))?,
        stall_release: switch(p.stall_release).ok_or_else(|| unknown("stall_release", p.stall_release, 2))?,
        force_hold: switch(p.force_hold).ok_or_else(|| unknown("force_hold", p.force_hold, 2))?,
        continuous_reentry: switch(p.continuous_reentry).ok_or_else(|| unknown("continuous_reentry", p.continuous_reentry, 2))?,
    })
}

/// Decodes a switch; `None` if the code is unknown.
fn switch(code: u32) -> Option<bool> {
    match code {
        0 => Some(false),
        1 => Some(true),
        _ => None,
    }
}

/// Names of the vectors that are checked, in their order.
const VECTORS: [&str; 20] = [
    "state.offset",
    "state.x_max",
    "state.stiffness",
    "state.max_force",
    "state.position_bound",
    "state.force",
    "state.taper",
    "state.force_error",
    "state.slow_error",
    "state.free_time",
    "state.x_max_force",
    "position",
    "velocity",
    "reference_position",
    "reference_velocity",
    "contact_force",
    "desired_force",
    "stiffness",
    "max_force",
    "position_bound",
];
/// Names of the numbers.
const NUMBERS: [&str; 5] = ["taper", "damping", "posture_lead", "search_scale", "force_resolution"];

fn check(state: &ControllerState, input: &TaskSpaceInput, p: &Parameters, period_s: f64) -> Result<(), TaskSpaceError> {
    if !period_s.is_finite() || period_s <= 0.0 {
        return Err(TaskSpaceError::Period { found: period_s });
    }
    let vectors = [
        &state.offset,
        &state.x_max,
        &state.stiffness,
        &state.max_force,
        &state.position_bound,
        &state.force,
        &state.taper,
        &state.force_error,
        &state.slow_error,
        &state.free_time,
        &state.x_max_force,
        &input.position,
        &input.velocity,
        &input.reference_position,
        &input.reference_velocity,
        &input.contact_force,
        &p.desired_force,
        &p.stiffness,
        &p.max_force,
        &p.position_bound,
    ];
    let numbers = [p.taper, p.damping, p.posture_lead, p.search_scale, p.force_resolution];
    // 0 times a number is 0, unless it is infinite or NaN: one branch for all. Three sums, so that none waits for another.
    let mut sums = [0.0; 3];
    for vector in vectors {
        sums.iter_mut().zip(vector).for_each(|(sum, value)| *sum += 0.0 * value);
    }
    let rest: f64 = numbers.iter().map(|number| 0.0 * number).sum();
    if sums[0] + sums[1] + sums[2] + rest == 0.0 {
        return Ok(());
    }
    VECTORS.iter().zip(vectors).try_for_each(|(quantity, vector)| check_finite(quantity, vector))?;
    NUMBERS.iter().zip(&numbers).try_for_each(|(quantity, number)| check_finite(quantity, core::slice::from_ref(number)))
}

#[inline]
fn check_finite(quantity: &'static str, values: &[f64]) -> Result<(), TaskSpaceError> {
    match values.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        Some((index, &found)) => Err(TaskSpaceError::NotFinite { quantity, index, found }),
        None => Ok(()),
    }
}
