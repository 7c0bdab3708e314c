//! The robot as a multibody of rapier.

use hapfic_robot::{Chain, JointKind, JointVector, Kinematics, MAX_JOINTS};
use nalgebra::{Isometry3, Unit, UnitQuaternion, Vector3};
use rapier3d_f64::math::{Matrix, Pose, Rotation, Vector};
use rapier3d_f64::prelude::{
    GenericJoint, GenericJointBuilder, JointAxesMask, JointAxis, MassProperties, Multibody, MultibodyJointHandle,
    MultibodyJointSet, RigidBodyBuilder, RigidBodyHandle, RigidBodySet,
};

pub(crate) fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

pub(crate) fn back(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

pub(crate) fn pose(p: &Isometry3<f64>) -> Pose {
    let q = p.rotation;
    Pose::from_parts(vector(&p.translation.vector), Rotation::from_xyzw(q.i, q.j, q.k, q.w))
}

/// The robot: a fixed base, and a body for each joint.
#[derive(Clone, Debug)]
pub(crate) struct Robot {
    base: RigidBodyHandle,
    links: Vec<RigidBodyHandle>,
    /// The joint of the first link, by which the set finds the multibody.
    first: MultibodyJointHandle,
    /// Whether a joint turns, and its axis in the frame of its body.
    axes: Vec<(bool, Vector3<f64>)>,
}

impl Robot {
    /// Inserts the robot at rest.
    pub(crate) fn new(chain: &Chain, position: &JointVector, bodies: &mut RigidBodySet, joints: &mut MultibodyJointSet) -> Self {
        // Joint coordinates count from the posture in which the bodies are inserted, all zero.
        let zero = chain.kinematics(&[0.0; MAX_JOINTS]);
        let base = bodies.insert(RigidBodyBuilder::fixed().pose(pose(&chain.base_pose())));
        let mut robot = Self { base, links: Vec::new(), first: MultibodyJointHandle::invalid(), axes: Vec::new() };
        for i in 0..chain.dof() {
            let inertia = chain.inertia(i);
            let columns: Vec<f64> = inertia.inertia_kg_m2.iter().copied().collect();
            let mass = MassProperties::with_inertia_matrix(vector(&inertia.center_m), inertia.mass_kg, matrix(&columns));
            let link = bodies.insert(
                RigidBodyBuilder::dynamic()
                    .pose(pose(&zero.body_pose(i)))
                    .additional_mass_properties(mass)
                    .can_sleep(false)
                    .allow_fast_rotation(true),
            );
            let parent = if i == 0 { base } else { robot.links[i - 1] };
            let (joint, rotational, axis) = joint(chain, &zero, i);
            let handle = joints.insert(parent, link, joint, true);
            if i == 0 {
                robot.first = handle.unwrap_or(robot.first);
            }
            robot.links.push(link);
            robot.axes.push((rotational, axis));
        }
        // Fixes the root, which has six degrees of freedom until then.
        robot.multibody(joints).forward_kinematics(bodies, true);
        let multibody = robot.multibody(joints);
        for (i, joint) in chain.joints().iter().enumerate() {
            multibody.armature_mut()[i] = joint.armature;
            multibody.frictions_mut()[i] = joint.friction;
        }
        robot.set_motion(position, &[0.0; MAX_JOINTS], bodies, joints);
        robot
    }

    pub(crate) fn link(&self, body: usize) -> RigidBodyHandle {
        self.links[body]
    }

    /// The multibody, which exists as long as the set.
    pub(crate) fn multibody<'a>(&self, joints: &'a mut MultibodyJointSet) -> &'a mut Multibody {
        #[allow(clippy::expect_used)]
        let (multibody, _) = joints.get_mut(self.first).expect("the robot is never removed");
        multibody
    }

    /// Joint positions and velocities.
    pub(crate) fn motion(&self, joints: &MultibodyJointSet) -> (JointVector, JointVector) {
        let (mut q, mut qd) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        if let Some((multibody, _)) = joints.get(self.first) {
            let velocity = multibody.generalized_velocity();
            for (i, (rotational, _)) in self.axes.iter().enumerate() {
                // Link 0 is the base; the joint's free axis is the x axis of its frame.
                let coordinate = if *rotational { 3 } else { 0 };
                q[i] = multibody.link(i + 1).map_or(f64::NAN, |link| link.joint().coords()[coordinate]);
                qd[i] = velocity[i];
            }
        }
        (q, qd)
    }

    /// Sets joint positions and velocities.
    pub(crate) fn set_motion(
        &self,
        q: &JointVector,
        qd: &JointVector,
        bodies: &mut RigidBodySet,
        joints: &mut MultibodyJointSet,
    ) {
        let (now, _) = self.motion(joints);
        let n = self.links.len();
        let shift: Vec<f64> = (0..n).map(|i| q[i] - now[i]).collect();
        let multibody = self.multibody(joints);
        multibody.apply_displacements(&shift);
        multibody.generalized_velocity_mut().copy_from_slice(&qd[..n]);
        multibody.forward_kinematics(bodies, false);
        multibody.update_rigid_bodies(bodies, true);
    }

    /// Sets the damping of the joints.
    pub(crate) fn set_damping(&self, damping: &JointVector, joints: &mut MultibodyJointSet) {
        self.multibody(joints).damping_mut().copy_from_slice(&damping[..self.links.len()]);
    }

    /// Applies joint torques, [N m] or [N]: equal and opposite ones to the two bodies of each joint, until the next call.
    pub(crate) fn apply(&self, torque: &JointVector, bodies: &mut RigidBodySet) {
        for link in &self.links {
            bodies[*link].reset_forces(false);
            bodies[*link].reset_torques(false);
        }
        for (i, (rotational, axis)) in self.axes.iter().enumerate() {
            let (link, parent) = (self.links[i], if i == 0 { self.base } else { self.links[i - 1] });
            let direction = *bodies[link].rotation() * vector(axis) * torque[i];
            if *rotational {
                bodies[link].add_torque(direction, false);
                bodies[parent].add_torque(-direction, false);
            } else {
                let point = bodies[link].translation();
                bodies[link].add_force_at_point(direction, point, false);
                bodies[parent].add_force_at_point(-direction, point, false);
            }
        }
    }
}

fn matrix(columns: &[f64]) -> Matrix {
    let mut array = [0.0; 9];
    array.copy_from_slice(columns);
    Matrix::from_cols_array(&array)
}

/// The joint of a body, whether it turns, and its axis in the frame of the body.
fn joint(chain: &Chain, zero: &Kinematics, i: usize) -> (GenericJoint, bool, Vector3<f64>) {
    let description = &chain.joints()[i];
    let rotational = description.kind != JointKind::Prismatic;
    let parent = if i == 0 { chain.base_pose() } else { zero.body_pose(i - 1) };
    let body = zero.body_pose(i);
    let axis = body.rotation.inverse() * zero.joint_axis(i);
    // The free axis of a joint is the x axis of its frame.
    let to_axis = UnitQuaternion::rotation_between_axis(&Vector3::x_axis(), &Unit::new_normalize(axis))
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), core::f64::consts::PI));
    let in_body = Isometry3::from_parts(nalgebra::Translation3::identity(), to_axis);
    let in_parent = parent.inverse() * body * in_body;
    let (locked, free) = if rotational {
        (JointAxesMask::LOCKED_REVOLUTE_AXES, JointAxis::AngX)
    } else {
        (JointAxesMask::LOCKED_PRISMATIC_AXES, JointAxis::LinX)
    };
    let mut builder =
        GenericJointBuilder::new(locked).local_frame1(pose(&in_parent)).local_frame2(pose(&in_body)).contacts_enabled(false);
    if description.lower.is_finite() && description.upper.is_finite() {
        builder = builder.limits(free, [description.lower, description.upper]);
    }
    (builder.build(), rotational, axis)
}
