//! Postures at which gains must hold: the start, the targets of the script, and the ways between them.

use super::padded;
use hapfic_config::{ParameterSettings, Settings};
use hapfic_robot::{Chain, JointVector, MAX_JOINTS};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Points on the way from one target to the next.
const BETWEEN: usize = 4;
/// Most steps of the inverse kinematics.
const STEPS: usize = 60;
/// Starts that are tried if the present posture does not lead to a target.
const OTHER_STARTS: u32 = 12;
/// Damping of its steps, over the mean square of the Jacobian.
const DAMPING: f64 = 1e-4;

/// The postures, each reached from the one before.
pub(super) fn postures(settings: &Settings, chain: &Chain) -> Vec<JointVector> {
    let start = padded(&settings.robot.start_position);
    let kin = chain.kinematics(&start);
    let pose = settings.initial.rotation.is_some();
    let mut all = vec![start];
    let (mut q, mut point, mut turned) = (start, kin.tip_position(), rotation(&kin.tip_rotation()));
    let mut set = settings.initial;
    let changes = settings.operator.iter().map(Some);
    for change in core::iter::once(None).chain(changes) {
        if let Some(change) = change {
            set = set.with(change);
        }
        let target = set.target_position.map_or(point, Vector3::from);
        let towards = set.rotation.and_then(|rotation| rotation.target_orientation).map_or(turned, |[roll, pitch, yaw]| {
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_euler_angles(roll, pitch, yaw))
        });
        if (target - point).norm() < 1e-3 && towards.angle_to(&turned) < 1e-2 {
            continue;
        }
        let (from, turned_from) = (point, turned);
        for step in 1..=BETWEEN {
            let share = step as f64 / BETWEEN as f64;
            point = from + (target - from) * share;
            turned = turned_from.slerp(&towards, share);
            q = near(chain, &q, &point, pose.then_some(&turned));
            all.push(q);
        }
    }
    all
}

/// Postures that [`start_posture`] compares.
const TRIED: u32 = 2000;

/// A posture for a robot of which only the description is known: far from its limits and from singularities, and with the
/// tip below all of its other shapes if there is such a one.
///
/// The measure is the volume of the tip's mobility (Yoshikawa 1985) times the smallest distance from a limit, as a share of
/// half the range.
#[must_use]
pub fn start_posture(chain: &Chain) -> Vec<f64> {
    let n = chain.dof();
    let rows = if n >= 6 { 6 } else { n.min(3) };
    let measure = |q: &JointVector| {
        let kin = chain.kinematics(q);
        let jacobian = chain.jacobian(&kin);
        let j = DMatrix::from_fn(rows, n, |row, i| if row < 3 { jacobian.linear[i][row] } else { jacobian.angular[i][row - 3] });
        let volume = (&j * j.transpose()).determinant().max(0.0).sqrt();
        let distance = chain.joints().iter().zip(q).fold(1.0_f64, |least, (joint, q)| {
            let half = 0.5 * (joint.upper - joint.lower);
            if half.is_finite() && half > 0.0 { least.min((half - (q - joint.lower - half).abs()) / half) } else { least }
        });
        let tip = kin.tip_position().z;
        let lowest = chain
            .collisions()
            .iter()
            .filter(|shape| shape.body.is_some() && shape.link != chain.tip_link())
            .map(|shape| chain.collision_pose(&kin, shape).translation.z)
            .fold(f64::INFINITY, f64::min);
        let below = if tip < lowest - 0.02 { 1.0 } else { 0.01 };
        volume * distance.max(1e-3) * below
    };
    let best = (0..TRIED).map(|index| chain.posture(index)).max_by(|a, b| measure(a).total_cmp(&measure(b)));
    // To a hundredth of a degree: a posture that a person can write.
    best.unwrap_or([0.0; MAX_JOINTS])[..n].iter().map(|q| (q * 1e3).round() / 1e3).collect()
}

fn rotation(matrix: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*matrix))
}

/// Posture of a set's target: its position, and in a pose task its orientation, or that of `start`.
pub(crate) fn posture_at(chain: &Chain, set: &ParameterSettings, start: &JointVector) -> JointVector {
    let kin = chain.kinematics(start);
    let point = set.target_position.map_or(kin.tip_position(), Vector3::from);
    let Some(wanted) = set.rotation else {
        return if set.target_position.is_some() { chain.reach(&point, start).q } else { *start };
    };
    let turned = wanted.target_orientation.map_or(rotation(&kin.tip_rotation()), |[roll, pitch, yaw]| {
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_euler_angles(roll, pitch, yaw))
    });
    // The first start is where the robot is; others only where that does not get there.
    let miss = |q: &JointVector| {
        let kin = chain.kinematics(q);
        (point - kin.tip_position()).norm() + 0.1 * turned.angle_to(&rotation(&kin.tip_rotation()))
    };
    let mut best = near(chain, start, &point, Some(&turned));
    for index in 0..OTHER_STARTS {
        if miss(&best) < 1e-4 {
            break;
        }
        let other = near(chain, &chain.posture(index), &point, Some(&turned));
        if miss(&other) < miss(&best) {
            best = other;
        }
    }
    best
}

/// Posture within the joint limits with the tip at a point, and with an orientation if there is one, or as near to it as
/// damped least squares get from `start`.
fn near(chain: &Chain, start: &JointVector, point: &Vector3<f64>, turned: Option<&UnitQuaternion<f64>>) -> JointVector {
    let n = chain.dof();
    let rows = if turned.is_some() { 6 } else { 3 };
    let mut q = *start;
    for _ in 0..STEPS {
        let kin = chain.kinematics(&q);
        let away = point - kin.tip_position();
        let turn = turned.map_or_else(Vector3::zeros, |t| (t * rotation(&kin.tip_rotation()).inverse()).scaled_axis());
        if away.norm() < 1e-6 && turn.norm() < 1e-5 {
            break;
        }
        let jacobian = chain.jacobian(&kin);
        let j = DMatrix::from_fn(rows, n, |row, i| if row < 3 { jacobian.linear[i][row] } else { jacobian.angular[i][row - 3] });
        let error = DVector::from_fn(rows, |row, _| if row < 3 { away[row] } else { turn[row - 3] });
        let mut square = &j * j.transpose();
        let damping = DAMPING * square.trace() / rows as f64;
        for row in 0..rows {
            square[(row, row)] += damping;
        }
        let Some(solved) = square.cholesky().map(|root| root.solve(&error)) else { break };
        let step = j.transpose() * solved;
        for (i, joint) in chain.joints().iter().enumerate().take(MAX_JOINTS) {
            q[i] = (q[i] + step[i].clamp(-0.5, 0.5)).clamp(joint.lower, joint.upper);
        }
    }
    q
}
