//! The integrator: advances robot and objects through free flight and contact.
//!
//! Time is counted in whole microseconds, so that a tick is always the same sum of sub-steps. Away from everything a sub-step is
//! one of the classic fourth-order Runge-Kutta method (`flight.rs`); near a contact or a joint's stop it is a short implicit one
//! (`press.rs`, [`crate::newton`]). A leg in the air keeps its long sub-steps while an object lies on the floor.

use crate::account::{Account, Advance};
use crate::newton::{MAX_POINTS, Newton, PointForce};
use crate::object::FreeBody;
use crate::point::Point;
use crate::scene::{Contacts, Scene};
use crate::step_scope::{ConstraintSource, StepScope};
use hapfic_robot::{JointVector, Kinematics, MAX_JOINTS};
use nalgebra::Vector3;

/// What the drive does for a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// The brakes hold the joints where they are.
    Held,
    /// A torque on each joint, held for the tick.
    Torque(JointVector),
    /// No torque; damping on each joint, N m s/rad.
    Damped(f64),
}

/// Lengths of the sub-steps, us.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Substeps {
    /// Away from contact.
    pub flight_us: u32,
    /// In contact.
    pub contact_us: u32,
}

/// The world in motion.
#[derive(Clone, Debug)]
pub struct World {
    pub(crate) scene: Scene,
    /// q.
    pub q: JointVector,
    /// q'.
    pub qd: JointVector,
    /// The free bodies, in the order of the scenario.
    pub objects: Vec<FreeBody>,
    /// Gravity, m/s^2.
    pub gravity: Vector3<f64>,
    damping: JointVector,
    pub(crate) effort: JointVector,
    substeps: Substeps,
    pub(crate) newton: Newton,
    pub(crate) points: Vec<Point>,
    pub(crate) forces: Vec<PointForce>,
    pub(crate) owners: Vec<ConstraintSource>,
    pub(crate) found: Contacts,
    pub(crate) account: Account,
    pub(crate) contact_work: f64,
}

impl World {
    pub(crate) fn new(
        scene: Scene,
        q: JointVector,
        objects: Vec<FreeBody>,
        gravity: Vector3<f64>,
        damping: JointVector,
        effort: JointVector,
        substeps: Substeps,
    ) -> Self {
        Self {
            newton: Newton::new(scene.chain.dof()),
            account: Account::new(scene.pairs.len()),
            // Room for every point of every pair, so that no sub-step asks for memory.
            found: Contacts::with_capacity(scene.pairs.len() * crate::contact_point::MAX_TOUCHES),
            scene,
            q,
            qd: [0.0; MAX_JOINTS],
            objects,
            gravity,
            damping,
            effort,
            substeps,
            points: Vec::with_capacity(MAX_POINTS),
            forces: vec![PointForce::zeros(); MAX_POINTS],
            owners: Vec::with_capacity(MAX_POINTS),
            contact_work: 0.0,
        }
    }

    pub(crate) fn n(&self) -> usize {
        self.scene.chain.dof()
    }

    /// Says where everything is, before it is asked what touches.
    pub(crate) fn place(&mut self, kin: &Kinematics) {
        self.scene.place(kin, &self.qd, &self.objects);
    }

    /// Forward kinematics at the present position.
    #[must_use]
    pub fn kinematics(&self) -> Kinematics {
        self.scene.chain.kinematics(&self.q)
    }

    /// Kinetic and potential energy of robot and objects, J.
    #[must_use]
    pub fn energy(&self) -> f64 {
        let kin = self.kinematics();
        let chain = &self.scene.chain;
        let objects: f64 = self.objects.iter().map(|body| body.energy(&self.gravity)).sum();
        chain.kinetic_energy(&kin, &self.qd) + chain.potential_energy(&kin, &self.gravity) + objects
    }

    /// Work the contacts have done on the bodies since the start, J.
    #[must_use]
    pub fn contact_work(&self) -> f64 {
        self.contact_work
    }

    /// Whether position and velocity of everything are numbers.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let leg = self.q.iter().chain(&self.qd).all(|v| v.is_finite());
        leg && self.objects.iter().all(|body| {
            let parts = [body.position, body.velocity, body.angular_velocity];
            parts.iter().flat_map(|v| v.iter()).chain(body.rotation.coords.iter()).all(|v| v.is_finite())
        })
    }

    /// Advances by a whole number of microseconds, at least one, under one action.
    pub fn advance(&mut self, action: Action, duration_us: u32) -> Advance {
        self.account.clear();
        // The world has no memory beyond its state, so that it can go on from there.
        self.newton.forget();
        let (mut torque, extra) = match action {
            Action::Held => return self.hold(duration_us),
            Action::Torque(torque) => (torque, 0.0),
            Action::Damped(damping) => ([0.0; MAX_JOINTS], damping),
        };
        let n = self.n();
        let mut damping = self.damping;
        for i in 0..n {
            torque[i] = torque[i].clamp(-self.effort[i], self.effort[i]);
            damping[i] += extra;
        }
        let before = self.q;
        let mut left = duration_us;
        while left > 0 {
            let kin = self.kinematics();
            self.place(&kin);
            let flight = left.min(self.substeps.flight_us);
            if self.leg_is_clear(seconds(flight)) && self.is_explicit_stable(&kin, &damping, seconds(flight)) {
                self.account.physics.substeps += 1;
                self.move_objects(StepScope::Objects, &kin, flight);
                self.free_step(&kin, &torque, &damping, seconds(flight));
                left -= flight;
            } else {
                let step = left.min(self.substeps.contact_us);
                self.press(StepScope::All, &kin, &torque, &damping, seconds(step));
                left -= step;
            }
        }
        let mut advance = self.account.finish(&self.scene.pairs, seconds(duration_us));
        for i in 0..n {
            // The integral of the drive's damping torque over the tick is what the joint moved.
            advance.torque[i] = torque[i] - extra * (self.q[i] - before[i]) / seconds(duration_us);
        }
        advance
    }

    /// The brakes hold the leg; the objects move.
    fn hold(&mut self, duration_us: u32) -> Advance {
        self.qd = [0.0; MAX_JOINTS];
        let kin = self.kinematics();
        self.account.physics.substeps = 1;
        self.move_objects(StepScope::ObjectsAndHeldLeg, &kin, duration_us);
        self.place(&kin);
        self.read_held_contact(seconds(duration_us));
        self.account.finish(&self.scene.pairs, seconds(duration_us))
    }

    /// Moves the objects alone.
    fn move_objects(&mut self, taking: StepScope, kin: &Kinematics, duration_us: u32) {
        if self.objects.is_empty() {
            return;
        }
        let none = [0.0; MAX_JOINTS];
        let mut left = duration_us;
        while left > 0 {
            let flight = left.min(self.substeps.flight_us);
            self.place(kin);
            let clear =
                self.objects_are_clear(seconds(flight)) && (taking == StepScope::Objects || self.leg_is_clear(seconds(flight)));
            if clear {
                for body in &mut self.objects {
                    body.free_step(&self.gravity, seconds(flight));
                }
                left -= flight;
            } else {
                let step = left.min(self.substeps.contact_us);
                self.press(taking, kin, &none, &none, seconds(step));
                left -= step;
            }
        }
    }
}

fn seconds(us: u32) -> f64 {
    f64::from(us) * 1e-6
}
