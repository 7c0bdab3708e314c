//! Motion without contact: the classic fourth-order Runge-Kutta method, and the conditions for its use.

use crate::scene::ContactPair;
use crate::step_scope::CLEARANCE;
use crate::world::PhysicsWorld;
use hapfic_robot::cholesky::{factor, substitute};
use hapfic_robot::{JointVector, Kinematics, MAX_JOINTS};

/// Largest decay of a damped velocity in a Runge-Kutta sub-step, as rate times length; the method is unstable beyond
/// 2.8.
const DECAY: f64 = 0.5;

impl PhysicsWorld {
    /// Whether the leg is certain to touch nothing within a free sub-step of `h` [s].
    pub(crate) fn leg_is_clear(&mut self, h: f64) -> bool {
        let stops = self.scene.chain.joints().iter().zip(&self.q).zip(&self.qd).all(|((joint, q), qd)| {
            let travel = CLEARANCE + 2.0 * h * qd.abs();
            *q - travel > joint.lower && *q + travel < joint.upper
        });
        stops && self.are_clear(h, ContactPair::has_link)
    }

    /// Whether the objects are certain to touch neither each other nor the floor within a free sub-step of `h` [s].
    pub(crate) fn objects_are_clear(&mut self, h: f64) -> bool {
        self.are_clear(h, |pair| !pair.has_link())
    }

    fn are_clear(&mut self, h: f64, which: impl Fn(&ContactPair) -> bool) -> bool {
        (0..self.scene.pairs.len()).all(|index| {
            if !which(&self.scene.pairs[index]) {
                return true;
            }
            let reach = CLEARANCE + 2.0 * h * self.scene.closing_speed(index);
            self.scene.pair_contacts(index, &self.objects, reach).next().is_none()
        })
    }

    /// Whether damping is weak enough for an explicit sub-step of `h` [s]: the trace of M^-1 D bounds the fastest
    /// decay.
    pub(crate) fn is_explicit_stable(&self, kin: &Kinematics, damping: &JointVector, h: f64) -> bool {
        let n = self.n();
        if damping[..n].iter().all(|c| *c == 0.0) {
            return true;
        }
        let Some(factor) = self.factor(kin) else { return false };
        let mut rate = 0.0;
        for i in 0..n {
            let mut unit = [0.0; MAX_JOINTS];
            unit[i] = 1.0;
            substitute(&factor, &mut unit, n);
            rate += damping[i] * unit[i];
        }
        h * rate < DECAY
    }

    /// Cholesky factor of the mass matrix; `None` if it is singular.
    fn factor(&self, kin: &Kinematics) -> Option<[JointVector; MAX_JOINTS]> {
        // Symmetric: columns equal rows.
        let mut matrix: [JointVector; MAX_JOINTS] = self.scene.chain.mass_matrix(kin).into();
        factor(&mut matrix, self.n()).then_some(matrix)
    }

    /// q'' under a torque; NaN where the mass matrix is singular, which the plant reports.
    fn acceleration(&self, kin: &Kinematics, qd: &JointVector, torque: &JointVector, damping: &JointVector) -> JointVector {
        let n = self.n();
        let bias = self.scene.chain.bias(kin, &qd[..n], &self.gravity);
        let Some(factor) = self.factor(kin) else { return [f64::NAN; MAX_JOINTS] };
        let mut qdd = [0.0; MAX_JOINTS];
        for i in 0..n {
            qdd[i] = torque[i] - damping[i] * qd[i] - bias[i];
        }
        substitute(&factor, &mut qdd, n);
        qdd
    }

    /// Advances the leg by one Runge-Kutta sub-step of `h` [s].
    pub(crate) fn free_step(&mut self, kin: &Kinematics, torque: &JointVector, damping: &JointVector, h: f64) {
        let n = self.n();
        let (q0, v0) = (self.q, self.qd);
        let at = |v: &JointVector, a: &JointVector, s: f64| {
            let (mut q, mut w) = (q0, v0);
            for i in 0..n {
                q[i] += s * v[i];
                w[i] += s * a[i];
            }
            (q, w)
        };
        let a1 = self.acceleration(kin, &v0, torque, damping);
        let (q2, v2) = at(&v0, &a1, 0.5 * h);
        let a2 = self.acceleration(&self.scene.chain.kinematics(&q2), &v2, torque, damping);
        let (q3, v3) = at(&v2, &a2, 0.5 * h);
        let a3 = self.acceleration(&self.scene.chain.kinematics(&q3), &v3, torque, damping);
        let (q4, v4) = at(&v3, &a3, h);
        let a4 = self.acceleration(&self.scene.chain.kinematics(&q4), &v4, torque, damping);
        for i in 0..n {
            self.account.tick.damped[i] += h / 6.0 * (v0[i] * v0[i] + 2.0 * (v2[i] * v2[i] + v3[i] * v3[i]) + v4[i] * v4[i]);
            self.q[i] = q0[i] + h / 6.0 * (v0[i] + 2.0 * (v2[i] + v3[i]) + v4[i]);
            self.qd[i] = v0[i] + h / 6.0 * (a1[i] + 2.0 * (a2[i] + a3[i]) + a4[i]);
        }
    }
}
