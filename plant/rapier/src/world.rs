//! The world: bodies, contacts, and their advance.

use crate::multibody::{Robot, back, pose, vector};
use crate::start::{Parent, RapierCollider, RapierShape, RapierStart, Softness};
use hapfic_robot::{JointVector, MAX_JOINTS};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d_f64::dynamics::{CCDSolver, CoefficientCombineRule, FrictionModel, IslandManager, SoftBodySet, SpringCoefficients};
use rapier3d_f64::geometry::{BroadPhaseBvh, ColliderSet, NarrowPhase, SolverFlags};
use rapier3d_f64::math::Vector;
use rapier3d_f64::pipeline::{PairFilterContext, PhysicsHooks, PhysicsPipeline};
use rapier3d_f64::prelude::{
    ActiveHooks, ColliderBuilder, ImpulseJointSet, IntegrationParameters, MassProperties, MultibodyJointSet, RigidBodyBuilder,
    RigidBodyHandle, RigidBodySet, SharedShape,
};

/// Distance below which contacts are looked for [m].
const PREDICTION: f64 = 2e-3;
/// Damping of the joints under the brakes [N m s/rad]: what creeps nevertheless is put back after each sub-step.
const HELD_DAMPING: f64 = 1e9;

/// What drives the joints, constant over an advance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointDrive {
    /// Torque of each joint, [N m] or [N].
    pub torque: JointVector,
    /// Damping of each joint, [N m s/rad] or [N s/m].
    pub damping: JointVector,
}

/// Pose and velocities of a free body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectMotion {
    /// Pose of its frame.
    pub pose: Isometry3<f64>,
    /// Velocity of its centre [m/s].
    pub velocity: Vector3<f64>,
    /// Angular velocity in the world frame [rad/s].
    pub angular_velocity: Vector3<f64>,
}

/// A contact point that acted in a sub-step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RapierContact {
    /// Index of the pair.
    pub pair: usize,
    /// Where [m].
    pub point: Vector3<f64>,
    /// Unit normal, from the second collider of the pair to the first.
    pub normal: Vector3<f64>,
    /// Force on the first one [N].
    pub force: Vector3<f64>,
    /// Depth at the start of the sub-step [m]; negative: a gap that the sub-step would have closed.
    pub depth: f64,
}

/// Pairs that may touch, as a square table of their indices plus one.
#[derive(Clone, Debug)]
struct Pairs {
    count: usize,
    indices: Vec<u32>,
}

impl Pairs {
    fn new(count: usize, pairs: &[[usize; 2]]) -> Self {
        let mut indices = vec![0; count * count];
        for (number, [a, b]) in pairs.iter().enumerate() {
            indices[a * count + b] = number as u32 + 1;
        }
        Self { count, indices }
    }

    /// Index of the pair of two colliders, and whether they are in its order.
    fn find(&self, a: usize, b: usize) -> Option<(usize, bool)> {
        let at = |row: usize, column: usize| self.indices[row * self.count + column].checked_sub(1).map(|index| index as usize);
        at(a, b).map(|index| (index, true)).or_else(|| at(b, a).map(|index| (index, false)))
    }
}

impl PhysicsHooks for Pairs {
    fn filter_contact_pair(&self, context: &PairFilterContext) -> Option<SolverFlags> {
        let number = |handle| context.colliders.get(handle).map(|collider| collider.user_data as usize);
        let pair = number(context.collider1).zip(number(context.collider2));
        pair.and_then(|(a, b)| self.find(a, b)).map(|_| SolverFlags::COMPUTE_RIGID_IMPULSES)
    }
}

/// Robot, floor and objects in rapier.
pub struct RapierWorld {
    robot: Robot,
    objects: Vec<RigidBodyHandle>,
    pub(crate) bodies: RigidBodySet,
    pub(crate) colliders: ColliderSet,
    pub(crate) joints: MultibodyJointSet,
    pub(crate) impulse_joints: ImpulseJointSet,
    soft_bodies: SoftBodySet,
    pub(crate) islands: IslandManager,
    pub(crate) broad_phase: BroadPhaseBvh,
    pub(crate) narrow_phase: NarrowPhase,
    pub(crate) ccd: CCDSolver,
    pub(crate) pipeline: PhysicsPipeline,
    parameters: IntegrationParameters,
    gravity: Vector,
    pairs: Pairs,
}

impl core::fmt::Debug for RapierWorld {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("RapierWorld").field("bodies", &self.bodies.len()).finish_non_exhaustive()
    }
}

impl Clone for RapierWorld {
    fn clone(&self) -> Self {
        Self {
            robot: self.robot.clone(),
            objects: self.objects.clone(),
            bodies: self.bodies.clone(),
            colliders: self.colliders.clone(),
            joints: self.joints.clone(),
            impulse_joints: self.impulse_joints.clone(),
            soft_bodies: SoftBodySet::new(),
            islands: self.islands.clone(),
            broad_phase: self.broad_phase.clone(),
            narrow_phase: self.narrow_phase.clone(),
            ccd: self.ccd.clone(),
            // Buffers only.
            pipeline: PhysicsPipeline::new(),
            parameters: self.parameters,
            gravity: self.gravity,
            pairs: self.pairs.clone(),
        }
    }
}

impl RapierWorld {
    /// Builds a world at rest.
    #[must_use]
    pub fn new(start: &RapierStart<'_>) -> Self {
        let (mut bodies, mut colliders) = (RigidBodySet::new(), ColliderSet::new());
        let (mut joints, ground) = (MultibodyJointSet::new(), bodies.insert(RigidBodyBuilder::fixed()));
        let robot = Robot::new(start.chain, &start.position, &mut bodies, &mut joints);
        let mut objects = Vec::new();
        for object in &start.objects {
            let inertia = vector(&object.inertia);
            objects.push(
                bodies.insert(
                    RigidBodyBuilder::dynamic()
                        .pose(pose(&object.pose))
                        .additional_mass_properties(MassProperties::new(Vector::ZERO, object.mass, inertia))
                        .can_sleep(false)
                        .allow_fast_rotation(true)
                        .gyroscopic_forces_enabled(true),
                ),
            );
        }
        for (number, collider) in start.colliders.iter().enumerate() {
            let parent = match collider.parent {
                Parent::World => ground,
                Parent::Link(body) => robot.link(body),
                Parent::Object(index) => objects[index],
            };
            // A hull without volume touches nothing.
            if let Some(builder) = builder(collider) {
                let built = builder
                    .position(pose(&collider.pose))
                    .density(0.0)
                    .friction(collider.friction)
                    .friction_combine_rule(CoefficientCombineRule::Min)
                    .restitution(0.0)
                    .active_hooks(ActiveHooks::FILTER_CONTACT_PAIRS)
                    .user_data(number as u128);
                colliders.insert_with_parent(built, parent, &mut bodies);
            }
        }
        Self {
            robot,
            objects,
            bodies,
            colliders,
            joints,
            impulse_joints: ImpulseJointSet::new(),
            soft_bodies: SoftBodySet::new(),
            islands: IslandManager::new(),
            broad_phase: BroadPhaseBvh::new(),
            narrow_phase: NarrowPhase::new(),
            ccd: CCDSolver::new(),
            pipeline: PhysicsPipeline::new(),
            parameters: parameters(start.softness),
            gravity: vector(&start.gravity),
            pairs: Pairs::new(start.colliders.len(), &start.pairs),
        }
    }

    /// Joint positions and velocities.
    #[must_use]
    pub fn joints(&self) -> (JointVector, JointVector) {
        self.robot.motion(&self.joints)
    }

    /// Sets joint positions and velocities.
    pub fn set_joints(&mut self, q: &JointVector, qd: &JointVector) {
        self.robot.set_motion(q, qd, &mut self.bodies, &mut self.joints);
    }

    /// Motion of a free body.
    #[must_use]
    pub fn object(&self, index: usize) -> ObjectMotion {
        let body = &self.bodies[self.objects[index]];
        let (translation, q) = (back(body.translation()), body.rotation());
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.x, q.y, q.z));
        ObjectMotion {
            pose: Isometry3::from_parts(Translation3::from(translation), rotation),
            velocity: back(body.linvel()),
            angular_velocity: back(body.angvel()),
        }
    }

    /// Sets the motion of a free body.
    pub fn set_object(&mut self, index: usize, motion: &ObjectMotion) {
        let body = &mut self.bodies[self.objects[index]];
        body.set_position(pose(&motion.pose), true);
        body.set_linvel(vector(&motion.velocity), true);
        body.set_angvel(vector(&motion.angular_velocity), true);
    }

    /// Advances by `duration` [s] in `substeps` equal sub-steps, and reports the contact points that acted in each, with its
    /// number from 1 and its length [s]. Without a drive the joints stay where they are.
    pub fn advance(
        &mut self,
        drive: Option<&JointDrive>,
        duration: f64,
        substeps: u32,
        mut report: impl FnMut(&RapierContact, u32, f64),
    ) {
        self.parameters.dt = duration / f64::from(substeps);
        let (held, _) = self.joints();
        let still = [0.0; MAX_JOINTS];
        let held_drive = JointDrive { torque: still, damping: [HELD_DAMPING; MAX_JOINTS] };
        let JointDrive { torque, damping } = drive.unwrap_or(&held_drive);
        self.robot.set_damping(damping, &mut self.joints);
        if drive.is_none() {
            self.set_joints(&held, &still);
        }
        for number in 1..=substeps {
            self.robot.apply(torque, &mut self.bodies);
            self.pipeline.step(
                self.gravity,
                &self.parameters,
                &mut self.islands,
                &mut self.broad_phase,
                &mut self.narrow_phase,
                &mut self.bodies,
                &mut self.colliders,
                &mut self.impulse_joints,
                &mut self.joints,
                &mut self.soft_bodies,
                &mut self.ccd,
                &self.pairs,
                &(),
            );
            if drive.is_none() {
                self.set_joints(&held, &still);
            }
            self.report_contacts(&mut |contact| report(contact, number, self.parameters.dt));
        }
    }

    fn report_contacts(&self, report: &mut impl FnMut(&RapierContact)) {
        let h = self.parameters.dt;
        for contact in self.narrow_phase.contact_pairs() {
            let (Some(first), Some(second)) = (self.colliders.get(contact.collider1), self.colliders.get(contact.collider2))
            else {
                continue;
            };
            let Some((pair, in_order)) = self.pairs.find(first.user_data as usize, second.user_data as usize) else { continue };
            for manifold in contact.manifolds() {
                let normal = manifold.data.normal;
                for solved in &manifold.data.solver_contacts {
                    // The others keep impulses of earlier steps.
                    let Some(point) = manifold.points.get(solved.contact_indices()[0] as usize) else { continue };
                    // With one iteration the friction that is kept for the next sub-step is all of this one's.
                    let impulse = point.data.warmstart_tangent_world - normal * point.data.impulse;
                    if impulse == Vector::ZERO {
                        continue;
                    }
                    let place = (*first.position() * point.local_p1 + *second.position() * point.local_p2) * 0.5;
                    let sign = if in_order { 1.0 } else { -1.0 };
                    let found = RapierContact {
                        pair,
                        point: back(place),
                        normal: -sign * back(normal),
                        force: sign * back(impulse) / h,
                        depth: -point.dist,
                    };
                    report(&found);
                }
            }
        }
    }
}

fn builder(collider: &RapierCollider) -> Option<ColliderBuilder> {
    Some(match &collider.shape {
        RapierShape::HalfSpace => ColliderBuilder::new(SharedShape::halfspace(Vector::Z)),
        RapierShape::Ball { radius } => ColliderBuilder::ball(*radius),
        RapierShape::Capsule { axis: [from, to], radius } => {
            ColliderBuilder::capsule_from_endpoints(Vector::Z * *from, Vector::Z * *to, *radius)
        }
        RapierShape::Box { half: [x, y, z] } => ColliderBuilder::cuboid(*x, *y, *z),
        RapierShape::Hull { corners } => {
            let corners: Vec<Vector> = corners.iter().map(|corner| Vector::from_array(*corner)).collect();
            ColliderBuilder::convex_hull(&corners)?
        }
    })
}

fn parameters(softness: Softness) -> IntegrationParameters {
    let spring = SpringCoefficients { natural_frequency: softness.frequency_hz, damping_ratio: softness.damping_ratio };
    IntegrationParameters {
        contact_softness: spring,
        static_contact_softness: spring,
        // Sub-steps are the plant's own: the forces of the joints are renewed in each.
        num_solver_iterations: 1,
        // Each point has its own friction, which the report needs; contacts of the robot always do so.
        friction_model: FrictionModel::Coulomb,
        num_internal_stabilization_iterations: 0,
        max_ccd_substeps: 0,
        // Kept contacts are up to 5 cm away from where they were found.
        contact_recycling: false,
        normalized_allowed_linear_error: 0.0,
        normalized_prediction_distance: PREDICTION,
        ..IntegrationParameters::default()
    }
}
