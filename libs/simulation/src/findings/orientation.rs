//! Findings about orientation and moments of a pose task.

use super::{AXES, Advisor, Case, Finding, changed, number};
use nalgebra::{Rotation3, UnitQuaternion};

/// Share of x_b,R up to which the moment is linear, as of x_b.
const LINEAR: f64 = 0.95;

impl Advisor {
    /// Adds the findings about moments and the target orientation.
    pub(super) fn orientation(&self, case: &Case<'_>, findings: &mut Vec<Finding>) {
        findings.extend((0..3).filter_map(|axis| self.beyond_moment(case, axis)));
        findings.extend(self.out_of_turn(case));
    }

    /// A desired moment beyond T_max, or beyond the linear part of its profile.
    fn beyond_moment(&self, case: &Case<'_>, axis: usize) -> Option<Finding> {
        let rotation = case.set.rotation?;
        let name = changed(case.change, &["desired_moment", "max_moment", "rotation_stiffness"])?;
        let linear = LINEAR * rotation.rotation_stiffness[axis] * rotation.rotation_bound[axis];
        let most = rotation.max_moment[axis].min(linear);
        let desired = rotation.desired_moment[axis];
        if desired.abs() <= most {
            return None;
        }
        let found = format!("a desired moment of {} N m about {}", number(desired), AXES[axis]);
        let expected = format!("at most {} N m, the smaller one of T_max and 0.95 K_R x_b,R", number(most));
        let help = "raise max_moment and rotation_stiffness, or lower desired_moment".to_owned();
        Some(self.finding(case, name, true, [found, expected, help]))
    }

    /// A target orientation that the joints do not reach at the target position.
    fn out_of_turn(&self, case: &Case<'_>) -> Option<Finding> {
        let rotation = case.set.rotation?;
        let [roll, pitch, yaw] = rotation.target_orientation?;
        let name = changed(case.change, &["target_orientation", "target_position"])?;
        let turn = |rotation: Rotation3<f64>| UnitQuaternion::from_rotation_matrix(&rotation);
        let reached = turn(Rotation3::from_matrix_unchecked(self.chain.kinematics(&case.reach.q).tip_rotation()));
        let angle = reached.angle_to(&turn(Rotation3::from_euler_angles(roll, pitch, yaw)));
        let bound = rotation.rotation_bound.into_iter().fold(f64::INFINITY, f64::min);
        if angle <= bound {
            return None;
        }
        let found = format!("an orientation that the joints miss by {} degrees at the target", number(angle.to_degrees()));
        let expected = format!("at most x_b,R = {} degrees", number(bound.to_degrees()));
        let help = "choose another orientation or position; the search for a posture starts from the one before".to_owned();
        Some(self.finding(case, name, true, [found, expected, help]))
    }
}
