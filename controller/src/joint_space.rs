//! Torques from a request's wrench, and the law in joint space: posture and damping in the null space of the task, damping
//! of the joints, and springs at their limits.
//!
//! Controller and gate call the same function, so the gate can compare to the last digits.

use hapfic_messages::{JointSpaceParameters, MAX_JOINTS, Parameters, State};
use hapfic_robot::{Chain, JointVector, TaskRows};
use nalgebra::Vector3;

/// Largest torque of the posture, and of a limit spring, as a share of the joint's effort limit.
const SHARE_OF_EFFORT: f64 = 0.3;
/// Largest rate of a sampled joint damping [1/s]: damping over inertia. With a dead time of one tick and a half it leaves a
/// third of what is stable.
const FASTEST_DAMPING_PER_S: f64 = 200.0;
/// Largest stiffness of a sampled joint spring over the joint's inertia [1/s^2]: omega tau = 0.17 at one tick of dead time.
const STIFFEST_PER_S2: f64 = 12_500.0;

/// Lengths of arrays in which the law is compiled. The numbers are the same in each; a short chain takes less time in short ones.
pub(crate) const SHORT: usize = 4;
pub(crate) const MIDDLE: usize = 8;
pub(crate) const LONG: usize = MAX_JOINTS;

/// Torques of a request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RequestedTorque {
    /// `J^T W + tau_N`, with g(q) if gravity is compensated [N m; N].
    pub total: JointVector,
    /// tau_N [N m; N].
    pub joint_space: JointVector,
}

impl RequestedTorque {
    fn of<const W: usize>(total: &[f64; W], joint_space: &[f64; W]) -> Self {
        let wide = |values: &[f64; W]| core::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0));
        Self { total: wide(total), joint_space: wide(joint_space) }
    }
}

/// Torques that a wrench at the tip (`force` [N], `moment` [N m], world frame) and the law in joint space request in a state.
///
/// All are those of the predicted posture: the torque acts later than its state. `gravity` is in the world frame [m/s^2];
/// the parameters decide whether it is compensated.
#[must_use]
pub fn requested_torque(
    chain: &Chain,
    gravity: &Vector3<f64>,
    state: &State,
    p: &Parameters,
    force: &Vector3<f64>,
    moment: &Vector3<f64>,
) -> RequestedTorque {
    match chain.dof() {
        n if n <= SHORT => torque_within::<SHORT>(chain, gravity, state, p, force, moment),
        n if n <= MIDDLE => torque_within::<MIDDLE>(chain, gravity, state, p, force, moment),
        _ => torque_within::<LONG>(chain, gravity, state, p, force, moment),
    }
}

/// [`requested_torque`] in arrays of `W` entries, at least the number of joints.
pub(crate) fn torque_within<const W: usize>(
    chain: &Chain,
    gravity: &Vector3<f64>,
    state: &State,
    p: &Parameters,
    force: &Vector3<f64>,
    moment: &Vector3<f64>,
) -> RequestedTorque {
    let ahead = p.predicted_posture(state);
    let gravity = (p.gravity_compensation == 1).then_some(gravity);
    if !p.is_pose() && !p.joint_space.acts() {
        return RequestedTorque::of(&chain.tip_force_torque::<W>(&ahead, force, gravity), &[0.0; W]);
    }
    let kin = chain.kinematics_within::<W>(&ahead);
    let jacobian = chain.jacobian(&kin);
    let mut total = jacobian.linear_transpose_mul(force);
    let mut joint_space = [0.0; W];
    if p.is_pose() {
        add(&mut total, &jacobian.angular_transpose_mul(moment));
    }
    if p.joint_space.acts() {
        let mass = chain.mass_matrix(&kin);
        let inertia: [f64; W] = core::array::from_fn(|i| mass[(i, i)]);
        let rows = if p.is_pose() { TaskRows::Both } else { TaskRows::Linear };
        let desired = posture_torque(chain.dof(), &p.joint_space, &inertia, &ahead, &state.joint_velocity);
        joint_space = bounded(chain, chain.null_space_torque(&mass, &jacobian, rows, &desired));
        add(&mut joint_space, &joint_torque(chain, &p.joint_space, &inertia, &ahead, &state.joint_velocity));
        add(&mut total, &joint_space);
    }
    if let Some(gravity) = gravity {
        add(&mut total, &chain.gravity_torque(&kin, gravity));
    }
    RequestedTorque::of(&total, &joint_space)
}

fn add<const W: usize>(sum: &mut [f64; W], other: &[f64; W]) {
    sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
}

/// `K_n (q_n - q) - D_n q'`, each joint with its share of the largest inertia, so that all move alike.
fn posture_torque<const W: usize>(
    n: usize,
    p: &JointSpaceParameters,
    inertia: &[f64; W],
    q: &JointVector,
    qd: &JointVector,
) -> [f64; W] {
    let largest = inertia[..n].iter().fold(0.0, |most: f64, value| most.max(*value));
    core::array::from_fn(|i| {
        if i >= n || largest <= 0.0 {
            return 0.0;
        }
        inertia[i] / largest * (p.stiffness * (p.posture[i] - q[i]) - p.damping * qd[i])
    })
}

/// The torque, scaled as a whole until every joint has at most its share of the effort: it stays in the null space.
fn bounded<const W: usize>(chain: &Chain, torque: [f64; W]) -> [f64; W] {
    let scale = chain.joints().iter().zip(&torque).fold(1.0, |scale: f64, (joint, torque)| {
        let most = SHARE_OF_EFFORT * joint.effort;
        if torque.abs() > most { scale.min(most / torque.abs()) } else { scale }
    });
    torque.map(|torque| scale * torque)
}

/// Damping of each joint, and the spring that pushes it back from a limit: not projected, so they also act on the task.
fn joint_torque<const W: usize>(
    chain: &Chain,
    p: &JointSpaceParameters,
    inertia: &[f64; W],
    q: &JointVector,
    qd: &JointVector,
) -> [f64; W] {
    let mut torque = [0.0; W];
    for (i, joint) in chain.joints().iter().enumerate() {
        let damping = p.joint_damping.min(FASTEST_DAMPING_PER_S * inertia[i]);
        let stiffness = p.limit_stiffness.min(STIFFEST_PER_S2 * inertia[i]);
        // Where the margins of both limits overlap, the middle is free.
        let margin = p.limit_margin.min(0.5 * (joint.upper - joint.lower));
        let below = (joint.lower + margin - q[i]).max(0.0);
        let above = (q[i] - joint.upper + margin).max(0.0);
        let most = SHARE_OF_EFFORT * joint.effort;
        torque[i] = (stiffness * (below - above)).clamp(-most, most) - damping * qd[i];
    }
    torque
}
