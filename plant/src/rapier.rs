//! The engine rapier: translates the scene, and sums the contacts of a tick.

use crate::account::{TickResult, TickSums};
use crate::collider::{BodyId, Collider};
use crate::contact_point::{ContactPoint, ContactShape};
use crate::energy::EnergyAccount;
use crate::engine::Engine;
use crate::object::FreeBody;
use crate::scene::CollisionScene;
use crate::world::{DriveAction, seconds};
use hapfic_config::RapierSettings;
use hapfic_messages::{MAX_OBJECTS, ObjectState, Physics, State};
use hapfic_plant_rapier::{
    JointDrive, ObjectMotion, Parent, RapierCollider, RapierObject, RapierShape, RapierStart, RapierWorld, Softness,
};
use hapfic_robot::{JointVector, MAX_JOINTS};
use nalgebra::{Isometry3, Translation3, Vector3};

/// Robot and objects in rapier.
#[derive(Clone, Debug)]
pub(crate) struct RapierEngine {
    scene: CollisionScene,
    world: RapierWorld,
    /// Masses and inertias of the objects, for their energy.
    objects: Vec<FreeBody>,
    gravity: Vector3<f64>,
    damping: JointVector,
    effort: JointVector,
    substep_us: u32,
    sums: TickSums,
    account: EnergyAccount,
    /// Whether the world is a saved one, until its state is restored.
    remembers: bool,
}

impl RapierEngine {
    /// Builds the world of a scene at rest.
    pub(crate) fn new(
        scene: CollisionScene,
        position: JointVector,
        objects: Vec<FreeBody>,
        gravity: Vector3<f64>,
        (damping, effort): (JointVector, JointVector),
        settings: &RapierSettings,
    ) -> Self {
        let start = RapierStart {
            chain: &scene.chain,
            position,
            objects: objects.iter().map(|o| RapierObject { pose: o.pose(), mass: o.mass, inertia: o.inertia }).collect(),
            colliders: scene.colliders().iter().map(|collider| translate(&scene, collider)).collect(),
            pairs: scene.pairs.iter().map(|pair| [pair.body.index, pair.against.index]).collect(),
            gravity,
            softness: Softness { frequency_hz: settings.frequency_hz, damping_ratio: settings.damping_ratio },
        };
        let world = RapierWorld::new(&start);
        let sums = TickSums::new(scene.pairs.len());
        let substep_us = settings.substep_us;
        let mut engine = Self {
            scene,
            world,
            objects,
            gravity,
            damping,
            effort,
            substep_us,
            sums,
            account: EnergyAccount::default(),
            remembers: false,
        };
        engine.account.begin();
        let energy_j = engine.energy();
        engine.account.finish(energy_j, energy_j);
        engine
    }

    /// Kinetic and potential energy of all bodies [J].
    fn energy(&self) -> f64 {
        let chain = &self.scene.chain;
        let (q, qd) = self.world.joints();
        let kin = chain.kinematics(&q);
        let objects: f64 = (0..self.objects.len()).map(|index| self.body(index).energy(&self.gravity)).sum();
        chain.kinetic_energy(&kin, &qd) + chain.potential_energy(&kin, &self.gravity) + objects
    }

    /// An object in its present motion.
    fn body(&self, index: usize) -> FreeBody {
        let motion = self.world.object(index);
        FreeBody {
            position: motion.pose.translation.vector,
            rotation: motion.pose.rotation,
            velocity: motion.velocity,
            angular_velocity: motion.angular_velocity,
            ..self.objects[index]
        }
    }
}

impl Engine for RapierEngine {
    fn scene(&self) -> &CollisionScene {
        &self.scene
    }

    fn joints(&self) -> (JointVector, JointVector) {
        self.world.joints()
    }

    fn set_joints(&mut self, position: &JointVector, velocity: &JointVector) {
        self.world.set_joints(position, velocity);
    }

    fn objects(&self, states: &mut [ObjectState; MAX_OBJECTS]) -> usize {
        for (index, state) in states.iter_mut().enumerate().take(self.objects.len()) {
            *state = self.body(index).state();
        }
        self.objects.len()
    }

    fn write_energy(&self, physics: &mut Physics) {
        self.account.write(physics);
        physics.energy_j = self.energy();
    }

    fn advance(&mut self, action: DriveAction, duration_us: u32) -> TickResult {
        let n = self.scene.chain.dof();
        let duration = seconds(duration_us);
        let (before, _) = self.world.joints();
        let start_j = self.energy();
        let (mut torque, mut damping, extra) = match action {
            DriveAction::Held => ([0.0; MAX_JOINTS], self.damping, 0.0),
            DriveAction::Torque(torque) => (torque, self.damping, 0.0),
            DriveAction::Damped(extra) => ([0.0; MAX_JOINTS], self.damping, extra),
        };
        for i in 0..n {
            torque[i] = torque[i].clamp(-self.effort[i], self.effort[i]);
            damping[i] += extra;
        }
        let drive = JointDrive { torque, damping };
        let drive = (action != DriveAction::Held).then_some(&drive);
        let substeps = duration_us.div_ceil(self.substep_us);
        self.sums.clear();
        self.sums.tip = self.scene.chain.kinematics(&before).tip_position();
        let (sums, pairs) = (&mut self.sums, &self.scene.pairs);
        self.world.advance(drive, duration, substeps, |contact, number, h| {
            sums.physics.substeps = number;
            let point = ContactPoint { point: contact.point, normal: contact.normal, depth: contact.depth };
            sums.add(contact.pair, pairs[contact.pair].sensed, &point, contact.force, h);
            sums.peak_normal = sums.peak_normal.max(contact.force.dot(&contact.normal));
        });
        self.sums.physics.substeps = substeps;
        let (after, _) = self.world.joints();
        let mut result = self.sums.finish(&self.scene.pairs, duration);
        self.account.begin();
        for i in 0..n {
            let travel = after[i] - before[i];
            let damped = travel * travel / duration;
            result.torque[i] = torque[i] - extra * travel / duration;
            self.account.joint_work(result.torque[i] * travel);
            self.account.joint_loss(self.damping[i] * damped);
        }
        // rapier reports no work of the contacts: what the joints do not explain counts as theirs.
        let end_j = self.energy();
        self.account.contact_rest(start_j, end_j);
        self.account.finish(start_j, end_j);
        self.account.write(&mut result.physics);
        result
    }

    fn memory(&self) -> Option<Vec<u8>> {
        Some(self.world.save())
    }

    fn remember(&mut self, memory: &[u8]) -> bool {
        self.remembers = self.world.load(memory);
        self.remembers
    }

    fn resume(&mut self, state: &State) {
        self.account = EnergyAccount::resumed(&state.physics);
        if std::mem::take(&mut self.remembers) {
            // Bit for bit, with its contacts.
            return;
        }
        self.world.set_joints(&state.joint_position, &state.joint_velocity);
        for (index, at) in state.objects.iter().enumerate().take(self.objects.len()) {
            let mut body = self.objects[index];
            body.resume(at);
            let pose = Isometry3::from_parts(Translation3::from(body.position), body.rotation);
            let motion = ObjectMotion { pose, velocity: body.velocity, angular_velocity: body.angular_velocity };
            self.world.set_object(index, &motion);
        }
    }

    fn boxed_clone(&self) -> Box<dyn Engine> {
        Box::new(self.clone())
    }
}

fn translate(scene: &CollisionScene, collider: &Collider) -> RapierCollider {
    let parent = match collider.parent {
        BodyId::World => Parent::World,
        BodyId::Link(body) => Parent::Link(body),
        BodyId::Object(index) => Parent::Object(index),
    };
    let shape = match collider.shape {
        ContactShape::HalfSpace(_) => RapierShape::HalfSpace,
        ContactShape::Ball(ball) => RapierShape::Ball { radius: ball.radius },
        ContactShape::Capsule { axis, radius } => RapierShape::Capsule { axis, radius },
        ContactShape::Box(cuboid) => RapierShape::Box { half: cuboid.half_extents.to_array() },
        ContactShape::Hull { index, .. } => {
            RapierShape::Hull { corners: scene.hull(index).points().iter().map(|corner| corner.to_array()).collect() }
        }
    };
    // Links have no surface of their own: the smaller friction of the two is that of the other body.
    let friction = scene.friction(collider).unwrap_or(f64::MAX);
    RapierCollider { parent, shape, pose: collider.local(), friction }
}
