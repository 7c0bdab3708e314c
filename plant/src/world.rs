//! Integrator: advances robot and objects through free flight and contact.
//!
//! Time is counted in whole microseconds, so that a tick is always the same sum of sub-steps. Without contact, a
//! sub-step is one of the classic fourth-order Runge-Kutta method (`free_step.rs`). Near a contact or a joint's stop it
//! is a short implicit one (`contact_step.rs`, [`crate::newton`]). A leg in the air keeps its long sub-steps while an
//! object lies on the floor.

use crate::account::{TickResult, TickSums};
use crate::energy::EnergyAccount;
use crate::newton::{ConstraintForce, Newton};
use crate::object::FreeBody;
use crate::point::ConstraintPoint;
use crate::scene::{CollisionScene, PairContacts};
use crate::step_scope::{ConstraintSource, StepScope};
use hapfic_robot::{JointVector, Kinematics, MAX_JOINTS};
use nalgebra::Vector3;

/// Action of the drive for a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriveAction {
    /// The brakes hold the joints where they are.
    Held,
    /// A torque on each joint, constant over the tick [N m], [N] for a prismatic joint.
    Torque(JointVector),
    /// No torque; damping on each joint [N m s/rad].
    Damped(f64),
}

/// Lengths of the sub-steps [us].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Substeps {
    /// Without contact.
    pub flight_us: u32,
    /// In contact.
    pub contact_us: u32,
}

/// Speed at which the friction of a joint reaches half of its Coulomb value [rad/s], [m/s]: below, the joint creeps.
const FRICTION_SPEED: f64 = 1e-3;

/// State of robot and objects, with the integrator's buffers.
#[derive(Clone, Debug)]
pub struct PhysicsWorld {
    pub(crate) scene: CollisionScene,
    /// Joint positions q [rad or m].
    pub q: JointVector,
    /// Joint velocities q' [rad/s or m/s].
    pub qd: JointVector,
    /// The free bodies, in the order of the scenario.
    pub objects: Vec<FreeBody>,
    /// Gravity [m/s^2].
    pub gravity: Vector3<f64>,
    pub(crate) damping: JointVector,
    pub(crate) effort: JointVector,
    substeps: Substeps,
    pub(crate) newton: Newton,
    pub(crate) points: Vec<ConstraintPoint>,
    pub(crate) forces: Vec<ConstraintForce>,
    pub(crate) sources: Vec<ConstraintSource>,
    pub(crate) contacts: PairContacts,
    pub(crate) tick_sums: TickSums,
    /// Works and the error of the balance since the start.
    pub(crate) account: EnergyAccount,
}

impl PhysicsWorld {
    pub(crate) fn new(
        scene: CollisionScene,
        q: JointVector,
        objects: Vec<FreeBody>,
        gravity: Vector3<f64>,
        damping: JointVector,
        effort: JointVector,
        substeps: Substeps,
    ) -> Self {
        // Room for both stops of every joint and every point of every pair, so that no sub-step allocates.
        let contacts = scene.pairs.len() * crate::contact_point::MAX_CONTACT_POINTS;
        let room = 2 * scene.chain.dof() + contacts;
        Self {
            newton: Newton::new(scene.chain.dof(), room),
            tick_sums: TickSums::new(scene.pairs.len()),
            contacts: PairContacts::with_capacity(contacts),
            scene,
            q,
            qd: [0.0; MAX_JOINTS],
            objects,
            gravity,
            damping,
            effort,
            substeps,
            points: Vec::with_capacity(room),
            forces: vec![ConstraintForce::zeros(); room],
            sources: Vec::with_capacity(room),
            account: EnergyAccount::default(),
        }
    }

    pub(crate) fn n(&self) -> usize {
        self.scene.chain.dof()
    }

    /// Updates the poses of all colliders before contact queries.
    pub(crate) fn update_colliders(&mut self, kin: &Kinematics) {
        self.scene.update_colliders(kin, &self.qd, &self.objects);
        self.scene.note_passages(&mut self.tick_sums.physics);
    }

    /// Forward kinematics at the present position.
    #[must_use]
    pub fn kinematics(&self) -> Kinematics {
        self.scene.chain.kinematics(&self.q)
    }

    /// Kinetic and potential energy of robot and objects [J].
    #[must_use]
    pub fn energy(&self) -> f64 {
        self.energy_at(&self.kinematics())
    }

    pub(crate) fn energy_at(&self, kin: &Kinematics) -> f64 {
        let chain = &self.scene.chain;
        let objects: f64 = self.objects.iter().map(|body| body.energy(&self.gravity)).sum();
        chain.kinetic_energy(kin, &self.qd) + chain.potential_energy(kin, &self.gravity) + objects
    }

    /// Work that the contacts have done on the bodies since the start [J].
    #[must_use]
    pub fn contact_work(&self) -> f64 {
        self.account.contact_work_j
    }

    /// Whether all positions and velocities are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let leg = self.q.iter().chain(&self.qd).all(|v| v.is_finite());
        leg && self.objects.iter().all(|body| {
            let parts = [body.position, body.velocity, body.angular_velocity];
            parts.iter().flat_map(|v| v.iter()).chain(body.rotation.coords.iter()).all(|v| v.is_finite())
        })
    }

    /// Advances by a whole number of microseconds, at least one, under one action.
    pub fn advance(&mut self, action: DriveAction, duration_us: u32) -> TickResult {
        self.tick_sums.clear();
        self.account.begin();
        self.scene.forget_sides();
        // The state is the world's only memory, so that a successor can resume from it.
        self.newton.reset_warm_start();
        let (mut torque, extra) = match action {
            DriveAction::Held => return self.hold(duration_us),
            DriveAction::Torque(torque) => (torque, 0.0),
            DriveAction::Damped(damping) => ([0.0; MAX_JOINTS], damping),
        };
        let n = self.n();
        let mut damping = self.damping;
        for i in 0..n {
            torque[i] = torque[i].clamp(-self.effort[i], self.effort[i]);
            damping[i] += extra;
        }
        let (before, start_j) = (self.q, self.energy());
        let mut friction_loss = [0.0; MAX_JOINTS];
        let mut left = duration_us;
        while left > 0 {
            let kin = self.kinematics();
            self.update_colliders(&kin);
            let flight = left.min(self.substeps.flight_us);
            let friction = self.friction_damping();
            let mut resisting = damping;
            resisting.iter_mut().zip(&friction).for_each(|(damping, friction)| *damping += friction);
            let damped = self.account.tick.damped;
            if self.leg_is_clear(seconds(flight)) && self.is_explicit_stable(&kin, &resisting, seconds(flight)) {
                self.tick_sums.physics.substeps += 1;
                self.move_objects(StepScope::Objects, &kin, flight);
                self.free_step(&kin, &torque, &resisting, seconds(flight));
                left -= flight;
            } else {
                let step = left.min(self.substeps.contact_us);
                self.contact_step(StepScope::All, &kin, &torque, &resisting, seconds(step));
                left -= step;
            }
            for i in 0..n {
                friction_loss[i] += friction[i] * (self.account.tick.damped[i] - damped[i]);
            }
        }
        for i in 0..n {
            let damped = self.account.tick.damped[i];
            self.account.joint_work(torque[i] * (self.q[i] - before[i]) - extra * damped);
            self.account.joint_loss(self.damping[i] * damped + friction_loss[i]);
        }
        self.finish_account(start_j);
        let mut advance = self.result(duration_us);
        for i in 0..n {
            // The damping torque integrates to the damping times the joint's travel.
            advance.torque[i] = torque[i] - extra * (self.q[i] - before[i]) / seconds(duration_us);
        }
        advance
    }

    /// Coulomb friction of the joints as the damping that gives it at the present speeds: `f q' / (|q'| + v_c)`.
    ///
    /// A damping that is fixed over a sub-step takes energy whatever the speed does, so friction never drives a joint.
    fn friction_damping(&self) -> JointVector {
        let mut damping = [0.0; MAX_JOINTS];
        for (i, joint) in self.scene.chain.joints().iter().enumerate() {
            if joint.friction > 0.0 {
                damping[i] = joint.friction / (self.qd[i].abs() + FRICTION_SPEED);
            }
        }
        damping
    }

    /// Moves the objects while the brakes hold the leg.
    fn hold(&mut self, duration_us: u32) -> TickResult {
        let kin = self.kinematics();
        let start_j = self.energy();
        // The brakes take the motion of the leg.
        self.account.joint_work(-self.scene.chain.kinetic_energy(&kin, &self.qd));
        self.qd = [0.0; MAX_JOINTS];
        self.tick_sums.physics.substeps = 1;
        self.move_objects(StepScope::ObjectsAndHeldLeg, &kin, duration_us);
        self.update_colliders(&kin);
        self.tick_sums.tip = kin.tip_position();
        self.read_held_contact(seconds(duration_us));
        self.finish_account(start_j);
        self.result(duration_us)
    }

    fn result(&self, duration_us: u32) -> TickResult {
        let mut result = self.tick_sums.finish(&self.scene.pairs, seconds(duration_us));
        self.account.write(&mut result.physics);
        result
    }

    /// Moves the objects; the leg stays out of the equations.
    fn move_objects(&mut self, scope: StepScope, kin: &Kinematics, duration_us: u32) {
        if self.objects.is_empty() {
            return;
        }
        let none = [0.0; MAX_JOINTS];
        let mut left = duration_us;
        while left > 0 {
            let flight = left.min(self.substeps.flight_us);
            self.update_colliders(kin);
            let clear =
                self.objects_are_clear(seconds(flight)) && (scope == StepScope::Objects || self.leg_is_clear(seconds(flight)));
            if clear {
                for body in &mut self.objects {
                    body.free_step(&self.gravity, seconds(flight));
                }
                left -= flight;
            } else {
                let step = left.min(self.substeps.contact_us);
                self.contact_step(scope, kin, &none, &none, seconds(step));
                left -= step;
            }
        }
    }
}

pub(crate) fn seconds(us: u32) -> f64 {
    f64::from(us) * 1e-6
}
