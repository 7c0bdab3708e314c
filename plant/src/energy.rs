//! Balance of the energy of robot and objects.
//!
//! Kinetic and potential energy change by the work of the contacts, of the drive with its brakes, of the joints' stops
//! and of their damping, and by nothing else. What remains is the error of the integration. The energy comes from
//! positions and velocities alone, so that the solver's own opinion of its success plays no part.

use hapfic_messages::Physics;
use hapfic_robot::{JointVector, MAX_JOINTS};

/// Works since the start [J], and the error of their balance.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct EnergyAccount {
    /// Work of the contacts on the bodies.
    pub(crate) contact_work_j: f64,
    /// Work of drive, brakes and stops on the joints.
    joint_work_j: f64,
    /// Energy lost to joint damping.
    joint_loss_j: f64,
    /// Kinetic and potential energy now.
    energy_j: f64,
    /// Elastic energy in the contacts now.
    pub(crate) stored_j: f64,
    /// Energy that no work explains.
    error_j: f64,
    /// The same sums over the present tick, whose small differences keep all their digits.
    pub(crate) tick: TickWork,
}

/// Works over a tick.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TickWork {
    /// Work of all forces [J].
    work_j: f64,
    /// Integral of q'^2 [rad^2/s]; the work of a damping is minus that times it.
    pub(crate) damped: JointVector,
}

impl EnergyAccount {
    /// Continues the account of a published state.
    pub(crate) fn resumed(physics: &Physics) -> Self {
        Self {
            energy_j: physics.energy_j,
            contact_work_j: physics.contact_work_j,
            stored_j: physics.contact_stored_j,
            joint_work_j: physics.joint_work_j,
            joint_loss_j: physics.joint_loss_j,
            error_j: physics.energy_error_j,
            tick: TickWork::default(),
        }
    }

    /// Writes the account into a message.
    pub(crate) fn write(&self, physics: &mut Physics) {
        physics.energy_j = self.energy_j;
        physics.contact_work_j = self.contact_work_j;
        physics.contact_stored_j = self.stored_j;
        physics.joint_work_j = self.joint_work_j;
        physics.joint_loss_j = self.joint_loss_j;
        physics.energy_error_j = self.error_j;
    }

    /// Begins a tick.
    pub(crate) fn begin(&mut self) {
        self.tick = TickWork { work_j: 0.0, damped: [0.0; MAX_JOINTS] };
    }

    /// Adds work of a contact [J].
    pub(crate) fn contact_work(&mut self, work_j: f64) {
        self.contact_work_j += work_j;
        self.tick.work_j += work_j;
    }

    /// Adds work of drive, brakes or stops [J].
    pub(crate) fn joint_work(&mut self, work_j: f64) {
        self.joint_work_j += work_j;
        self.tick.work_j += work_j;
    }

    /// Adds energy lost to joint damping [J].
    pub(crate) fn joint_loss(&mut self, loss_j: f64) {
        self.joint_loss_j += loss_j;
        self.tick.work_j -= loss_j;
    }

    /// Counts as work of the contacts what the other works of a tick do not explain, where an engine reports none of it.
    pub(crate) fn contact_rest(&mut self, start_j: f64, end_j: f64) {
        self.contact_work(end_j - start_j - self.tick.work_j);
    }

    /// Ends a tick that has changed the energy of all bodies from `start_j` to `end_j` [J].
    pub(crate) fn finish(&mut self, start_j: f64, end_j: f64) {
        self.energy_j = end_j;
        self.error_j += end_j - start_j - self.tick.work_j;
    }
}
