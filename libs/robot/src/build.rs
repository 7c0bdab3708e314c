//! Builds a chain from a checked URDF tree: picks the path, lumps fixed links, checks every number.

use crate::chain::{Chain, ChainBody, Joint, JointKind, MAX_JOINTS};
use crate::collision::{Collision, Shape};
use crate::error::RobotError;
use crate::inertia::RigidInertia;
use crate::urdf::{UrdfTree, type_name};
use arrayvec::ArrayVec;
use nalgebra::{Isometry3, IsometryMatrix3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use urdf_rs::{Geometry, JointLimit, JointType, Pose};

/// Tolerance of the checks of inertia, relative to the sum of the principal moments: rounding in the file.
const INERTIA_TOLERANCE: f64 = 1e-6;
/// Length below which an axis has no direction.
const SHORTEST_AXIS: f64 = 1e-9;
/// Largest moment of inertia that counts as zero [kg m^2].
const ZERO_INERTIA: f64 = 1e-15;

impl Chain {
    /// The chain from `base_link` to `tip_link` of a URDF; `name_of_source`, such as a path, is for messages.
    ///
    /// Links that fixed joints connect to a body, on the path or off it, are lumped into that body: their inertia and
    /// their collision shapes. Links off the path behind a movable joint are left out, and so is everything above the
    /// base. Links without `<inertial>` have no mass. The base link does not move, so only its shapes count. It is at
    /// the world's origin; [`Chain::with_base`] moves it.
    ///
    /// # Errors
    /// Every [`RobotError`]. Names, parents and loops are checked in the whole file, all the rest only in the chain.
    pub fn from_urdf(text: &str, name_of_source: &str, base_link: &str, tip_link: &str) -> Result<Self, RobotError> {
        let tree = UrdfTree::read(text, name_of_source)?;
        let base = tree.find("base", base_link)?;
        let tip = tree.find("tip", tip_link)?;
        let path = tree.path(base, tip)?;

        let mut kinds = Vec::with_capacity(path.len());
        for &joint in &path {
            kinds.push(kind(&tree, joint)?);
        }
        let movable = kinds.iter().flatten().count();
        let file = || name_of_source.to_owned();
        if movable == 0 {
            return Err(RobotError::NoMovableJoint { file: file(), base: base_link.into(), tip: tip_link.into() });
        }
        if movable > MAX_JOINTS {
            let (base, tip) = (base_link.into(), tip_link.into());
            return Err(RobotError::TooManyJoints { file: file(), base, tip, found: movable });
        }

        let mut builder = ChainBuilder { tree: &tree, path: &path, tip_link, joints: ArrayVec::new(), collisions: Vec::new() };
        let mut bodies: ArrayVec<ChainBody, MAX_JOINTS> = ArrayVec::new();
        // Pose of the current link in the frame of its body.
        let mut pose = IsometryMatrix3::identity();
        builder.lump(None, base, pose)?;
        for (&index, kind) in path.iter().zip(kinds) {
            let joint = tree.joint(index);
            let link = tree.child(index);
            pose *= builder.pose(&joint.origin, || format!("joint '{}' <origin>", joint.name))?;
            if let Some(kind) = kind {
                bodies.push(builder.joint(index, kind, &pose)?);
                pose = IsometryMatrix3::identity();
            }
            let inertia = builder.lump(bodies.len().checked_sub(1), link, pose)?;
            if let Some(body) = bodies.last_mut() {
                body.inertia = body.inertia.plus(&inertia);
            }
        }
        builder.check_masses(&bodies)?;

        Ok(Self {
            base_link: base_link.to_owned(),
            tip_link: tip_link.to_owned(),
            joints: builder.joints,
            bodies,
            collisions: builder.collisions,
            base_position: Vector3::zeros(),
            base_rotation: Matrix3::identity(),
            tip_position: pose.translation.vector,
            tip_rotation: pose.rotation.into_inner(),
        })
    }
}

/// Kind of a joint on the path; `None` if it is fixed.
fn kind(tree: &UrdfTree<'_>, index: usize) -> Result<Option<JointKind>, RobotError> {
    let joint = tree.joint(index);
    let kind = match joint.joint_type {
        JointType::Fixed => return Ok(None),
        JointType::Revolute => JointKind::Revolute,
        JointType::Continuous => JointKind::Continuous,
        JointType::Prismatic => JointKind::Prismatic,
        JointType::Floating | JointType::Planar | JointType::Spherical => {
            return Err(RobotError::UnsupportedJoint {
                file: tree.file().to_owned(),
                joint: joint.name.clone(),
                found: type_name(&joint.joint_type),
            });
        }
    };
    if let Some(mimic) = &joint.mimic {
        return Err(RobotError::Mimic { file: tree.file().to_owned(), joint: joint.name.clone(), mimicked: mimic.joint.clone() });
    }
    Ok(Some(kind))
}

/// Joints and collision shapes collected along the path.
struct ChainBuilder<'t> {
    tree: &'t UrdfTree<'t>,
    path: &'t [usize],
    tip_link: &'t str,
    joints: ArrayVec<Joint, MAX_JOINTS>,
    collisions: Vec<Collision>,
}

impl ChainBuilder<'_> {
    fn file(&self) -> String {
        self.tree.file().to_owned()
    }

    /// Adds a movable joint whose frame is at `pose` in the previous body; returns its body, still without mass.
    fn joint(&mut self, index: usize, kind: JointKind, pose: &IsometryMatrix3<f64>) -> Result<ChainBody, RobotError> {
        let joint = self.tree.joint(index);
        let name = &joint.name;
        let written = joint.axis.xyz.0;
        let length = Vector3::from(written).norm();
        if !length.is_finite() || length < SHORTEST_AXIS {
            return Err(RobotError::Axis { file: self.file(), joint: name.clone(), found: written });
        }
        let axis = Vector3::from(written) / length;

        let limit = &joint.limit;
        // The reader fills a missing <limit> with zeros, which are invalid anyway.
        if *limit == JointLimit::default() {
            let expected = match kind {
                JointKind::Continuous => "<limit effort=.. velocity=../>",
                JointKind::Revolute | JointKind::Prismatic => "<limit lower=.. upper=.. effort=.. velocity=../>",
            };
            let kind = type_name(&joint.joint_type);
            return Err(RobotError::MissingLimit { file: self.file(), joint: name.clone(), kind, expected });
        }
        let (lower, upper) = if kind == JointKind::Continuous {
            (f64::NEG_INFINITY, f64::INFINITY)
        } else {
            self.finite(limit.lower, || format!("joint '{name}' <limit lower>"))?;
            self.finite(limit.upper, || format!("joint '{name}' <limit upper>"))?;
            if limit.lower > limit.upper {
                let (lower, upper) = (limit.lower, limit.upper);
                return Err(RobotError::LimitsReversed { file: self.file(), joint: name.clone(), lower, upper });
            }
            (limit.lower, limit.upper)
        };
        self.finite(limit.effort, || format!("joint '{name}' <limit effort>"))?;
        if limit.effort <= 0.0 {
            return Err(RobotError::Effort { file: self.file(), joint: name.clone(), found: limit.effort });
        }
        // URDF 1.2 defines an omitted speed limit as infinite.
        if limit.velocity != f64::INFINITY {
            self.not_negative(limit.velocity, || format!("joint '{name}' <limit velocity>"))?;
        }
        let damping = joint.dynamics.as_ref().map_or(0.0, |dynamics| dynamics.damping);
        self.not_negative(damping, || format!("joint '{name}' <dynamics damping>"))?;

        self.joints.push(Joint {
            name: name.clone(),
            child_link: joint.child.link.clone(),
            kind,
            lower,
            upper,
            effort: limit.effort,
            velocity_limit: limit.velocity,
            damping,
        });
        let rotation = *pose.rotation.matrix();
        let cross = axis.cross_matrix();
        Ok(ChainBody {
            rotational: kind != JointKind::Prismatic,
            joint_position: pose.translation.vector,
            joint_rotation: rotation,
            joint_rotation_sin: rotation * cross,
            joint_rotation_versin: rotation * cross * cross,
            axis: rotation * axis,
            inertia: RigidInertia::zero(),
        })
    }

    /// Lumps a link at `pose` in a body's frame with all links fixed to it off the path.
    ///
    /// Adds their collision shapes and returns their inertia in the body's frame.
    fn lump(&mut self, body: Option<usize>, link: usize, pose: IsometryMatrix3<f64>) -> Result<RigidInertia, RobotError> {
        let tree = self.tree;
        let mut inertia = RigidInertia::zero();
        let mut open = vec![(link, pose)];
        while let Some((index, pose)) = open.pop() {
            let link = tree.link(index);
            inertia = inertia.plus(&self.inertia(index)?.placed(&pose));
            for collision in &link.collision {
                let own = self.pose(&collision.origin, || format!("link '{}' <collision><origin>", link.name))?;
                // Only the tip needs an exact shape; other meshes are left out.
                if matches!(collision.geometry, Geometry::Mesh { .. }) && link.name != self.tip_link {
                    continue;
                }
                let shape = self.shape(&link.name, &collision.geometry)?;
                let placed = pose * own;
                let origin = Isometry3::from_parts(placed.translation, UnitQuaternion::from_rotation_matrix(&placed.rotation));
                self.collisions.push(Collision { link: link.name.clone(), body, origin, shape });
            }
            // Reversed, so that the stack returns them in the order of the file.
            for &below in tree.below(index).iter().rev() {
                let joint = tree.joint(below);
                if joint.joint_type == JointType::Fixed && !self.path.contains(&below) {
                    let own = self.pose(&joint.origin, || format!("joint '{}' <origin>", joint.name))?;
                    open.push((tree.child(below), pose * own));
                }
            }
        }
        Ok(inertia)
    }

    /// The checked inertia of one link, in its own frame.
    fn inertia(&self, index: usize) -> Result<RigidInertia, RobotError> {
        let link = self.tree.link(index);
        let name = &link.name;
        let inertial = &link.inertial;
        let pose = self.pose(&inertial.origin, || format!("link '{name}' <inertial><origin>"))?;
        let mass_kg = inertial.mass.value;
        self.not_negative(mass_kg, || format!("link '{name}' <mass value>"))?;
        let i = &inertial.inertia;
        for (value, attribute) in [(i.ixx, "ixx"), (i.ixy, "ixy"), (i.ixz, "ixz"), (i.iyy, "iyy"), (i.iyz, "iyz"), (i.izz, "izz")]
        {
            self.finite(value, || format!("link '{name}' <inertia {attribute}>"))?;
        }
        let inertia = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
        self.check_moments(name, &inertia)?;
        let about_center = RigidInertia { mass_kg, center_m: Vector3::zeros(), inertia_kg_m2: inertia };
        Ok(about_center.placed(&pose))
    }

    /// Checks that no principal moment is negative or above the sum of the other two.
    fn check_moments(&self, link: &str, inertia: &Matrix3<f64>) -> Result<(), RobotError> {
        let reject = |principal: [f64; 3], expected: &'static str| {
            Err(RobotError::Inertia { file: self.file(), link: link.to_owned(), principal, expected })
        };
        if *inertia == Matrix3::zeros() {
            return Ok(());
        }
        let Some(eigen) = inertia.try_symmetric_eigen(f64::EPSILON, 1000) else {
            return reject([f64::NAN; 3], "numbers that have principal moments");
        };
        let mut principal = [eigen.eigenvalues[0], eigen.eigenvalues[1], eigen.eigenvalues[2]];
        principal.sort_by(f64::total_cmp);
        let [small, middle, large] = principal;
        let tolerance = INERTIA_TOLERANCE * inertia.trace().abs().max(large.abs());
        if small < -tolerance {
            return reject(principal, "none of them negative");
        }
        if large > small + middle + tolerance {
            return reject(principal, "none of them above the sum of the other two");
        }
        Ok(())
    }

    /// Checks that the mass matrix is not singular.
    fn check_masses(&self, bodies: &[ChainBody]) -> Result<(), RobotError> {
        for (body, joint) in bodies.iter().zip(&self.joints) {
            if body.inertia.mass_kg <= 0.0 {
                return Err(RobotError::Massless {
                    file: self.file(),
                    joint: joint.name.clone(),
                    link: joint.child_link.clone(),
                });
            }
        }
        if let (Some(body), Some(joint)) = (bodies.last(), self.joints.last()) {
            // In the frame of the body; rotation about the axis does not change it.
            let axis = body.joint_rotation.tr_mul(&body.axis);
            let found = body.inertia.about_axis(&axis);
            if body.rotational && found <= ZERO_INERTIA {
                return Err(RobotError::NoInertia {
                    file: self.file(),
                    joint: joint.name.clone(),
                    link: joint.child_link.clone(),
                    found,
                });
            }
        }
        Ok(())
    }

    /// The checked shape of a collision element.
    fn shape(&self, link: &str, geometry: &Geometry) -> Result<Shape, RobotError> {
        let place = |attribute: &'static str| move || format!("link '{link}' <collision> {attribute}");
        match *geometry {
            Geometry::Sphere { radius } => {
                self.positive(radius, place("sphere radius"))?;
                Ok(Shape::Sphere { radius })
            }
            Geometry::Cylinder { radius, length } => {
                self.positive(radius, place("cylinder radius"))?;
                self.positive(length, place("cylinder length"))?;
                Ok(Shape::Cylinder { radius, length })
            }
            Geometry::Capsule { radius, length } => {
                self.positive(radius, place("capsule radius"))?;
                self.positive(length, place("capsule length"))?;
                Ok(Shape::Capsule { radius, length })
            }
            Geometry::Box { size } => {
                for edge in size.0 {
                    self.positive(edge, place("box size"))?;
                }
                Ok(Shape::Box { size: size.0 })
            }
            Geometry::Mesh { ref filename, .. } => {
                Err(RobotError::Mesh { file: self.file(), link: link.to_owned(), mesh: filename.clone() })
            }
        }
    }

    /// A checked `<origin>`.
    fn pose(&self, pose: &Pose, place: impl Fn() -> String) -> Result<IsometryMatrix3<f64>, RobotError> {
        for value in pose.xyz.0 {
            self.finite(value, || format!("{} xyz", place()))?;
        }
        for value in pose.rpy.0 {
            self.finite(value, || format!("{} rpy", place()))?;
        }
        let [roll, pitch, yaw] = pose.rpy.0;
        let translation = Translation3::from(Vector3::from(pose.xyz.0));
        Ok(IsometryMatrix3::from_parts(translation, Rotation3::from_euler_angles(roll, pitch, yaw)))
    }

    fn finite(&self, found: f64, place: impl FnOnce() -> String) -> Result<(), RobotError> {
        if found.is_finite() {
            return Ok(());
        }
        Err(RobotError::NotFinite { file: self.file(), place: place(), found })
    }

    fn not_negative(&self, found: f64, place: impl Fn() -> String) -> Result<(), RobotError> {
        self.finite(found, &place)?;
        if found >= 0.0 {
            return Ok(());
        }
        Err(RobotError::Negative { file: self.file(), place: place(), found })
    }

    fn positive(&self, found: f64, place: impl Fn() -> String) -> Result<(), RobotError> {
        self.finite(found, &place)?;
        if found > 0.0 {
            return Ok(());
        }
        Err(RobotError::NotPositive { file: self.file(), place: place(), found })
    }
}
