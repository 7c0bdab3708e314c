//! Findings about forces: beyond the law, against the surface, beyond the drive.

use super::{AXES, Advisor, Case, Finding, changed, number, vector};
use nalgebra::Vector3;

/// Share of x_b up to which the force profile is linear (equation 4).
const LINEAR: f64 = 0.95;
/// Torque of F_max above which it means nothing, relative to the effort limit.
///
/// F_max above the effort is common: the drive cuts the torque of a large error, and the paper's own F_max is such. Ten
/// times as much is a slip of a digit, or a limit that limits nothing.
const FAR_ABOVE: f64 = 10.0;
/// Distance from which on the foot touches nothing [m].
const APART: f64 = 0.01;
/// Distance up to which a target is reached [m].
const REACHED: f64 = 1e-3;
/// Component of F_d into a surface that counts, relative to F_d.
const INTO: f64 = 1e-3;

impl Advisor {
    /// Adds the findings about F_d and F_max.
    pub(super) fn force(&self, case: &Case<'_>, findings: &mut Vec<Finding>) {
        findings.extend((0..3).filter_map(|axis| self.beyond_profile(case, axis)));
        findings.extend(self.pulls(case));
        findings.extend(self.touches_nothing(case));
        // A force that the law does not reach needs no torque.
        if (0..3).all(|axis| case.set.desired_force[axis].abs() <= case.set.max_force[axis]) {
            findings.extend(self.beyond_effort(case));
        }
        findings.extend(self.far_above_effort(case));
    }

    /// F_d beyond F_max, or beyond the linear part of the force profile.
    fn beyond_profile(&self, case: &Case<'_>, axis: usize) -> Option<Finding> {
        let set = case.set;
        let (desired, limit) = (set.desired_force[axis].abs(), set.max_force[axis]);
        let linear = LINEAR * set.stiffness[axis] * set.position_bound[axis];
        let found = format!("F_d = {} N on {}", number(set.desired_force[axis]), AXES[axis]);
        if desired > limit {
            let name = changed(case.change, &["desired_force", "max_force"])?;
            let expected = format!("at most F_max = {} N", number(limit));
            let help = "the law never pushes harder than F_max: raise max_force, or lower desired_force".to_owned();
            return Some(self.finding(case, name, true, [found, expected, help]));
        }
        if desired > linear {
            let name = changed(case.change, &["desired_force", "stiffness", "position_bound"])?;
            let expected = format!("at most 0.95 K0 x_b = {} N, the linear part of the force profile", number(linear));
            let help = "beyond it the force jumps towards F_max within a small error: raise stiffness or position_bound, or \
                        lower desired_force";
            return Some(self.finding(case, name, true, [found, expected, help.to_owned()]));
        }
        None
    }

    /// F_d that points into the surface nearest to the target.
    fn pulls(&self, case: &Case<'_>) -> Option<Finding> {
        let desired = Vector3::from(case.set.desired_force);
        let name = changed(case.change, &["desired_force", "target_position"])?;
        let surface = self.nearest_surface(case)?;
        if desired.dot(&surface.normal) >= -INTO * desired.norm() {
            return None;
        }
        let found = format!("F_d = {} N, which points into {}", vector(case.set.desired_force), surface.name);
        let n = surface.normal;
        let expected = format!("a reaction that points out of it, along {}: a surface pushes and never pulls", vector(n.into()));
        let turned = desired - n * (2.0 * desired.dot(&n));
        let help = format!("F_d is the force of the surface on the foot: pressing is {}", vector(turned.into()));
        Some(self.finding(case, name, false, [found, expected, help]))
    }

    /// F_d at a target at which the foot touches nothing, on a floor alone: objects move.
    fn touches_nothing(&self, case: &Case<'_>) -> Option<Finding> {
        let name = changed(case.change, &["desired_force", "target_position"])?;
        // A target that is out of reach is a finding of its own.
        let elsewhere = !self.settings.world.objects.is_empty() || case.reach.distance_m > REACHED;
        if case.set.desired_force == [0.0; 3] || elsewhere {
            return None;
        }
        let surface = self.nearest_surface(case).filter(|surface| surface.depth_m < -APART)?;
        let found = format!(
            "F_d = {} N at a target whose foot is {} mm away from {}",
            vector(case.set.desired_force),
            number((-1e3 * surface.depth_m).round()),
            surface.name
        );
        let expected = "a target at which the foot touches it, or lies in it".to_owned();
        let help = "without contact the search rests, and no force comes: move the target to the surface".to_owned();
        // Told for the first target: a script moves on with the same force.
        let cause = format!("no contact {:?}", case.set.desired_force);
        Some(Finding { cause, ..self.finding(case, name, false, [found, expected, help]) })
    }

    /// F_d that takes more torque than a joint has, at the posture of the target.
    fn beyond_effort(&self, case: &Case<'_>) -> Option<Finding> {
        let desired = Vector3::from(case.set.desired_force);
        let name = changed(case.change, &["desired_force", "target_position"])?;
        if desired.norm() == 0.0 {
            return None;
        }
        // Balance at rest: tau + J^T F = g.
        let kin = self.chain.kinematics(&case.reach.q);
        let weight = self.chain.gravity_torque(&kin, &self.gravity);
        let reaction = self.chain.jacobian(&kin).linear_transpose_mul(&desired);
        let needed = std::array::from_fn(|i| weight[i] - reaction[i]);
        let (joint, torque, effort) = self.hardest(needed);
        if torque <= effort {
            return None;
        }
        let found = format!(
            "F_d = {} N, which takes {} N m at joint '{joint}' in the posture of the target",
            vector(case.set.desired_force),
            number(torque)
        );
        let expected = format!("at most its effort of {} N m", number(effort));
        let help = "the drive cuts the torque: lower desired_force, or choose another posture".to_owned();
        // Told for the first posture: a script moves on with the same force.
        let cause = format!("effort {:?}", case.set.desired_force);
        Some(Finding { cause, ..self.finding(case, name, false, [found, expected, help]) })
    }

    /// F_max far above what the effort of the joints allows.
    fn far_above_effort(&self, case: &Case<'_>) -> Option<Finding> {
        let name = changed(case.change, &["max_force"])?;
        let kin = self.chain.kinematics(&case.reach.q);
        let jacobian = self.chain.jacobian(&kin);
        let ratios = (0..3).map(|axis| {
            let force = Vector3::ith(axis, case.set.max_force[axis]);
            let (joint, torque, effort) = self.hardest(jacobian.linear_transpose_mul(&force));
            (axis, joint, torque, effort)
        });
        let (axis, joint, torque, effort) = ratios.max_by(|a, b| (a.2 / a.3).total_cmp(&(b.2 / b.3)))?;
        if torque <= FAR_ABOVE * effort {
            return None;
        }
        let limit = number(case.set.max_force[axis]);
        let found = format!("F_max = {limit} N on {}, which takes {} N m at joint '{joint}'", AXES[axis], number(torque));
        let expected = format!("at most {FAR_ABOVE} times its effort of {} N m", number(effort));
        let help = "the drive limits the force long before max_force does: lower max_force".to_owned();
        Some(self.finding(case, name, true, [found, expected, help]))
    }

    /// The joint that is loaded most relative to its effort: name, |torque| and effort [N m or N].
    fn hardest(&self, torque: [f64; hapfic_robot::MAX_JOINTS]) -> (&str, f64, f64) {
        let joints = self.chain.joints().iter().enumerate();
        joints
            .map(|(i, joint)| (joint.name.as_str(), torque[i].abs(), self.effort[i]))
            .max_by(|a, b| (a.1 / a.2).total_cmp(&(b.1 / b.2)))
            .unwrap_or(("", 0.0, f64::INFINITY))
    }
}
