//! Implicit sub-steps that do not converge, cut until they do.

use crate::contact_step::Attempt;
use crate::step_scope::StepScope;
use crate::world::PhysicsWorld;
use hapfic_robot::{JointVector, Kinematics};

/// Parts of a sub-step at the finest cut.
const FINEST: u32 = 1024;

impl PhysicsWorld {
    /// Advances the bodies in `scope` by `h` [s], in as many implicit sub-steps as that needs.
    ///
    /// A sub-step that does not converge is repeated in halves, these again in halves, down to [`FINEST`] parts. Each
    /// part that converges lets the next ones grow again. A sub-step that converges is taken as it is.
    pub(crate) fn contact_step(
        &mut self,
        scope: StepScope,
        kin: &Kinematics,
        torque: &JointVector,
        damping: &JointVector,
        h: f64,
    ) {
        if self.try_contact_step(scope, kin, torque, damping, h, Attempt::Whole) {
            return;
        }
        self.tick_sums.physics.cut_substeps += 1;
        let (mut done, mut part) = (0, FINEST / 2);
        while done < FINEST {
            let kin = self.kinematics();
            self.update_colliders(&kin);
            let length = h * f64::from(part) / f64::from(FINEST);
            let attempt = if part == 1 { Attempt::Last } else { Attempt::Part };
            if self.try_contact_step(scope, &kin, torque, damping, length, attempt) {
                done += part;
                while part < FINEST / 2 && done % (2 * part) == 0 {
                    part *= 2;
                }
            } else {
                self.tick_sums.physics.cut_substeps += 1;
                part /= 2;
            }
        }
    }
}
