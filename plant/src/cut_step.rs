//! Implicit sub-steps that are checked after the fact, rolled back, and cut until they hold.

use crate::contact_step::Turn;
use crate::object::FreeBody;
use crate::step_scope::StepScope;
use crate::world::PhysicsWorld;
use arrayvec::ArrayVec;
use hapfic_messages::MAX_OBJECTS;
use hapfic_robot::{JointVector, Kinematics};

/// Pieces of a sub-step at the finest cut.
const FINEST: u32 = 1024;

/// Positions and velocities at the start of a sub-step.
pub(crate) struct Origin {
    q: JointVector,
    qd: JointVector,
    objects: ArrayVec<FreeBody, MAX_OBJECTS>,
}

impl PhysicsWorld {
    fn origin(&self) -> Origin {
        Origin { q: self.q, qd: self.qd, objects: self.objects.iter().copied().collect() }
    }

    fn roll_back(&mut self, origin: &Origin) {
        self.q = origin.q;
        self.qd = origin.qd;
        self.objects.copy_from_slice(&origin.objects);
    }

    /// Advances the bodies in `scope` by `h` [s], in as many implicit sub-steps as that needs.
    ///
    /// A sub-step that does not hold is repeated in halves, these again in halves, down to [`FINEST`] parts. Each part
    /// that holds lets the next ones grow again.
    pub(crate) fn contact_step(
        &mut self,
        scope: StepScope,
        kin: &Kinematics,
        torque: &JointVector,
        damping: &JointVector,
        h: f64,
    ) {
        let origin = self.origin();
        if self.try_contact_step(scope, kin, torque, damping, h, Turn::Plain) {
            return;
        }
        self.tick_sums.physics.cut_substeps += 1;
        self.roll_back(&origin);
        let (mut done, mut part) = (0, FINEST / 2);
        while done < FINEST {
            let kin = self.kinematics();
            self.update_colliders(&kin);
            let origin = self.origin();
            let last = part == 1;
            let length = h * f64::from(part) / f64::from(FINEST);
            if self.try_contact_step(scope, &kin, torque, damping, length, Turn::KeepsEnergy { last }) {
                done += part;
                while part < FINEST / 2 && done % (2 * part) == 0 {
                    part *= 2;
                }
            } else {
                self.tick_sums.physics.cut_substeps += 1;
                self.roll_back(&origin);
                part /= 2;
            }
        }
    }
}
