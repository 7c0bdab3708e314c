//! The whole state of a world as bytes: poses, speeds, and what the solver remembers of its contacts.

use crate::world::RapierWorld;
use rapier3d_f64::dynamics::{CCDSolver, IslandManager};
use rapier3d_f64::geometry::{BroadPhaseBvh, ColliderSet, NarrowPhase};
use rapier3d_f64::pipeline::PhysicsPipeline;
use rapier3d_f64::prelude::{ImpulseJointSet, MultibodyJointSet, RigidBodySet};
use serde::{Deserialize, Serialize};

#[derive(Serialize)]
struct Saved<'a> {
    bodies: &'a RigidBodySet,
    colliders: &'a ColliderSet,
    joints: &'a MultibodyJointSet,
    impulse_joints: &'a ImpulseJointSet,
    islands: &'a IslandManager,
    broad_phase: &'a BroadPhaseBvh,
    narrow_phase: &'a NarrowPhase,
    ccd: &'a CCDSolver,
}

#[derive(Deserialize)]
struct Loaded {
    bodies: RigidBodySet,
    colliders: ColliderSet,
    joints: MultibodyJointSet,
    impulse_joints: ImpulseJointSet,
    islands: IslandManager,
    broad_phase: BroadPhaseBvh,
    narrow_phase: NarrowPhase,
    ccd: CCDSolver,
}

impl RapierWorld {
    /// The state as bytes, for a world that was built in the same way by the same program; empty if it cannot be written.
    #[must_use]
    pub fn save(&self) -> Vec<u8> {
        let saved = Saved {
            bodies: &self.bodies,
            colliders: &self.colliders,
            joints: &self.joints,
            impulse_joints: &self.impulse_joints,
            islands: &self.islands,
            broad_phase: &self.broad_phase,
            narrow_phase: &self.narrow_phase,
            ccd: &self.ccd,
        };
        postcard::to_stdvec(&saved).unwrap_or_default()
    }

    /// Continues from a saved state; returns whether it is one of such a world. If not, nothing has changed.
    #[must_use]
    pub fn load(&mut self, bytes: &[u8]) -> bool {
        let Ok(loaded) = postcard::from_bytes::<Loaded>(bytes) else { return false };
        if (loaded.bodies.len(), loaded.colliders.len()) != (self.bodies.len(), self.colliders.len()) {
            return false;
        }
        self.bodies = loaded.bodies;
        self.colliders = loaded.colliders;
        self.joints = loaded.joints;
        self.impulse_joints = loaded.impulse_joints;
        self.islands = loaded.islands;
        self.broad_phase = loaded.broad_phase;
        self.narrow_phase = loaded.narrow_phase;
        self.ccd = loaded.ccd;
        self.pipeline = PhysicsPipeline::new();
        true
    }
}
