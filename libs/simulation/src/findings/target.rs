//! Findings about targets: out of reach, or too deep in a body.

use super::{AXES, Advisor, Case, Finding, changed, number, vector};

/// Distance from the nearest posture above which a target is out of reach [m].
const OUT_OF_REACH_M: f64 = 2e-3;

impl Advisor {
    /// Adds the findings about the target.
    pub(super) fn target(&self, case: &Case<'_>, findings: &mut Vec<Finding>) {
        findings.extend(self.out_of_reach(case));
        findings.extend(self.too_deep(case));
    }

    /// A target that no posture reaches. It is dangerous if the error that remains exceeds x_b: the force is F_max then.
    fn out_of_reach(&self, case: &Case<'_>) -> Option<Finding> {
        let name = changed(case.change, &["target_position"])?;
        if case.reach.distance_m <= OUT_OF_REACH_M {
            return None;
        }
        let gap = case.target - case.reach.position;
        let beyond = (0..3).any(|axis| gap[axis].abs() > case.set.position_bound[axis]);
        let found = format!("{} m, {} mm out of reach", vector(case.target.into()), number(1e3 * case.reach.distance_m));
        let expected = format!("a point that the joints reach; the nearest is {} m", vector(case.reach.position.into()));
        let force = if beyond { ", and pushes with F_max" } else { "" };
        let help = format!("the robot stretches towards it{force}: choose a nearer target");
        Some(self.finding(case, name, beyond, [found, expected, help]))
    }

    /// A target so deep in floor or object that the error exceeds x_b, and the force is F_max without a search.
    ///
    /// A foot on a body of stiffness k, K0 behind it, keeps the share k / (k + K0) of the depth as error.
    fn too_deep(&self, case: &Case<'_>) -> Option<Finding> {
        let name = changed(case.change, &["target_position", "position_bound"])?;
        case.set.target_position?;
        let surface = self.nearest_surface(case)?;
        let set = case.set;
        let n = surface.normal;
        let own: f64 = (0..3).map(|axis| set.stiffness[axis] * n[axis] * n[axis]).sum();
        let share = surface.stiffness / (surface.stiffness + own);
        let depth = |axis: usize| set.position_bound[axis] / (share * n[axis].abs());
        let limits = (0..3).filter(|&axis| n[axis] != 0.0).map(|axis| (axis, depth(axis)));
        let (axis, deepest) = limits.min_by(|a, b| a.1.total_cmp(&b.1))?;
        if surface.depth_m <= deepest {
            return None;
        }
        let found = format!("{} m, {} mm inside {}", vector(case.target.into()), number(1e3 * surface.depth_m), surface.name);
        let expected = format!("at most {} mm, where the error is x_b on {}", number(1e3 * deepest), AXES[axis]);
        let help = format!(
            "a few mm inside are the way to press; deeper, the foot pushes with F_max = {} N before a search acts",
            number(set.max_force[axis])
        );
        Some(self.finding(case, name, true, [found, expected, help]))
    }
}
