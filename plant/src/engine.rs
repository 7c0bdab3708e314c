//! Physics engines: what moves robot and objects. Drive, dead time, sensor noise, clock and messages are the plant's.

use crate::account::TickResult;
use crate::scene::CollisionScene;
use crate::world::{DriveAction, PhysicsWorld};
use hapfic_messages::{MAX_OBJECTS, ObjectState, Physics, State};
use hapfic_robot::JointVector;

/// A physics engine with a robot and its world.
pub(crate) trait Engine: core::fmt::Debug + Send + Sync {
    /// The robot, the names of the bodies, and the pairs that may touch.
    fn scene(&self) -> &CollisionScene;

    /// Joint positions q [rad or m] and velocities q' [rad/s or m/s].
    fn joints(&self) -> (JointVector, JointVector);

    /// Sets joint positions and velocities.
    fn set_joints(&mut self, position: &JointVector, velocity: &JointVector);

    /// Writes the motion of the objects; returns their number.
    fn objects(&self, states: &mut [ObjectState; MAX_OBJECTS]) -> usize;

    /// Writes the energy of all bodies and its account.
    fn write_energy(&self, physics: &mut Physics);

    /// Advances by a whole number of microseconds, at least one, under one action.
    fn advance(&mut self, action: DriveAction, duration_us: u32) -> TickResult;

    /// Restores a published state. Joints and objects are as many as here.
    fn resume(&mut self, state: &State);

    /// What this world remembers beside its state; `None`: nothing.
    fn memory(&self) -> Option<Vec<u8>> {
        None
    }

    /// Restores that, before the state; returns whether it could.
    fn remember(&mut self, _memory: &[u8]) -> bool {
        true
    }

    /// A copy.
    fn boxed_clone(&self) -> Box<dyn Engine>;

    /// The world of the plant's own engine, if this is it.
    fn own(&mut self) -> Option<&mut PhysicsWorld> {
        None
    }

    /// Whether all positions and velocities are finite.
    fn is_finite(&self) -> bool {
        let (q, qd) = self.joints();
        let mut objects = [ObjectState::default(); MAX_OBJECTS];
        let count = self.objects(&mut objects);
        let finite = |body: &ObjectState| {
            let parts = [&body.position[..], &body.orientation, &body.linear_velocity, &body.angular_velocity];
            parts.iter().all(|part| part.iter().all(|value| value.is_finite()))
        };
        q.iter().chain(&qd).all(|value| value.is_finite()) && objects[..count].iter().all(finite)
    }
}

impl Clone for Box<dyn Engine> {
    fn clone(&self) -> Self {
        self.boxed_clone()
    }
}

impl Engine for PhysicsWorld {
    fn scene(&self) -> &CollisionScene {
        &self.scene
    }

    fn joints(&self) -> (JointVector, JointVector) {
        (self.q, self.qd)
    }

    fn set_joints(&mut self, position: &JointVector, velocity: &JointVector) {
        (self.q, self.qd) = (*position, *velocity);
    }

    fn objects(&self, states: &mut [ObjectState; MAX_OBJECTS]) -> usize {
        for (state, body) in states.iter_mut().zip(&self.objects) {
            *state = body.state();
        }
        self.objects.len()
    }

    fn write_energy(&self, physics: &mut Physics) {
        self.account.write(physics);
        physics.energy_j = self.energy();
    }

    fn advance(&mut self, action: DriveAction, duration_us: u32) -> TickResult {
        Self::advance(self, action, duration_us)
    }

    fn resume(&mut self, state: &State) {
        (self.q, self.qd) = (state.joint_position, state.joint_velocity);
        for (body, at) in self.objects.iter_mut().zip(&state.objects) {
            body.resume(at);
        }
        self.account = crate::energy::EnergyAccount::resumed(&state.physics);
    }

    fn boxed_clone(&self) -> Box<dyn Engine> {
        Box::new(self.clone())
    }

    fn own(&mut self) -> Option<&mut PhysicsWorld> {
        Some(self)
    }
}
