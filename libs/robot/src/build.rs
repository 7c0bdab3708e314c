//! Builds a chain from a checked URDF tree: picks the path, lumps fixed links, checks the whole.

use crate::chain::{Chain, ChainBody, Joint, JointKind, MAX_JOINTS};
use crate::collision::{Collision, Shape};
use crate::error::RobotError;
use crate::inertia::RigidInertia;
use crate::parts;
use crate::urdf::{self, UrdfTree};
use crate::xml::Element;
use arrayvec::ArrayVec;
use hapfic_config::{Foot, JointValues};
use nalgebra::{Isometry3, IsometryMatrix3, Matrix3, Point3, UnitQuaternion, Vector3};

/// Length below which an axis has no direction.
const SHORTEST_AXIS: f64 = 1e-9;
/// Largest moment of inertia that counts as zero [kg m^2].
const ZERO_INERTIA: f64 = 1e-15;

/// Values of a scenario that replace or complete those of a description, and a foot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Replacements<'a> {
    /// Joint damping [N m s/rad; N s/m].
    pub joint_damping: Option<&'a JointValues>,
    /// Effort limit [N m; N].
    pub effort_limit: Option<&'a JointValues>,
    /// Speed limit [rad/s; m/s].
    pub velocity_limit: Option<&'a JointValues>,
    /// Coulomb friction [N m; N].
    pub joint_friction: Option<&'a JointValues>,
    /// Inertia of the rotors at the joints [kg m^2; kg].
    pub armature: Option<&'a JointValues>,
    /// A foot in place of whatever shapes the tip link has.
    pub foot: Option<&'a Foot>,
}

impl Chain {
    /// The chain from `base_link` to `tip_link` of a URDF; `name_of_source`, such as a path, is for messages.
    ///
    /// Links that fixed joints connect to a body, on the path or off it, are lumped into that body: their inertia and
    /// their collision shapes. Links off the path behind a movable joint are left out, and so is everything above the
    /// base. Links without `<inertial>` have no mass. The base link does not move, so only its shapes count. It is at
    /// the world's origin; [`Chain::with_base`] moves it. What does not concern the dynamics of the chain is not read.
    /// What is odd but usable is in [`Chain::warnings`].
    ///
    /// # Errors
    /// Every [`RobotError`]. Names, parents and loops are checked in the whole file, all the rest only in the chain. A joint
    /// without a parent or a child in the file is left out, unless the tip is not below the base without it.
    pub fn from_urdf(text: &str, name_of_source: &str, base_link: &str, tip_link: &str) -> Result<Self, RobotError> {
        Self::from_urdf_with(text, name_of_source, base_link, tip_link, &Replacements::default())
    }

    /// As [`Chain::from_urdf`], with values that replace those of the description.
    ///
    /// # Errors
    /// As [`Chain::from_urdf`], and [`RobotError::PerJoint`] if a list has another length than the chain has joints.
    pub fn from_urdf_with(
        text: &str,
        name_of_source: &str,
        base_link: &str,
        tip_link: &str,
        replacements: &Replacements<'_>,
    ) -> Result<Self, RobotError> {
        let document = urdf::parse(text, name_of_source)?;
        let tree = UrdfTree::read(&document, name_of_source)?;
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

        for (key, values) in [
            ("robot.joint_damping_n_m_s_per_rad", replacements.joint_damping),
            ("robot.effort_limit_n_m", replacements.effort_limit),
            ("robot.velocity_limit_rad_per_s", replacements.velocity_limit),
            ("robot.joint_friction_n_m", replacements.joint_friction),
            ("robot.armature_kg_m2", replacements.armature),
        ] {
            match values {
                Some(JointValues::InOrder(list)) => check_length(key, Some(list), movable, base_link, tip_link)?,
                Some(JointValues::ByName(list)) => {
                    let names: Vec<&str> = path
                        .iter()
                        .zip(&kinds)
                        .filter(|(_, kind)| kind.is_some())
                        .map(|(&index, _)| tree.joint(index).name)
                        .collect();
                    if let Some((found, _)) = list.iter().find(|(name, _)| !names.contains(&name.as_str())) {
                        return Err(RobotError::UnknownJoint { key, found: found.clone(), known: names.join(", ") });
                    }
                }
                None => {}
            }
        }
        let mut builder = ChainBuilder {
            tree: &tree,
            path: &path,
            replacements,
            joints: ArrayVec::new(),
            collisions: Vec::new(),
            warnings: tree.warnings(),
            unread: Vec::new(),
        };
        let mut bodies: ArrayVec<ChainBody, MAX_JOINTS> = ArrayVec::new();
        // Pose of the current link in the frame of its body.
        let mut pose = IsometryMatrix3::identity();
        builder.lump(None, base, pose)?;
        for (&index, kind) in path.iter().zip(kinds) {
            let joint = tree.joint(index);
            let link = tree.child(index);
            pose *= parts::pose(joint.element, || format!("joint '{}' <origin>", joint.name))?;
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
        builder.warn_of_meshes();
        if let Some(foot) = replacements.foot {
            builder.replace_foot(foot, tip_link, bodies.len().checked_sub(1), &pose);
        }

        let chain = Self {
            base_link: base_link.to_owned(),
            tip_link: tip_link.to_owned(),
            joints: builder.joints,
            bodies,
            collisions: builder.collisions,
            warnings: builder.warnings,
            base_position: Vector3::zeros(),
            base_rotation: Matrix3::identity(),
            tip_position: pose.translation.vector,
            tip_rotation: pose.rotation.into_inner(),
        };
        chain.check_mass_matrix(name_of_source)?;
        Ok(chain)
    }
}

/// Checks the length of a list with a value for each joint.
pub(crate) fn check_length(
    key: &'static str,
    list: Option<&[f64]>,
    joints: usize,
    base: &str,
    tip: &str,
) -> Result<(), RobotError> {
    match list {
        Some(list) if list.len() != joints => {
            Err(RobotError::PerJoint { key, found: list.len(), joints, base: base.to_owned(), tip: tip.to_owned() })
        }
        _ => Ok(()),
    }
}

/// Kind of a joint on the path; `None` if it is fixed.
fn kind(tree: &UrdfTree<'_>, index: usize) -> Result<Option<JointKind>, RobotError> {
    let joint = tree.joint(index);
    let kind = match joint.kind {
        "fixed" => return Ok(None),
        "revolute" => JointKind::Revolute,
        "continuous" => JointKind::Continuous,
        "prismatic" => JointKind::Prismatic,
        found => {
            return Err(RobotError::UnsupportedJoint {
                file: joint.element.place(),
                joint: joint.name.to_owned(),
                found: found.to_owned(),
            });
        }
    };
    if let Some(mimic) = joint.element.child("mimic") {
        let mimicked = mimic.attribute("joint").unwrap_or_default().to_owned();
        return Err(RobotError::Mimic { file: mimic.place(), joint: joint.name.to_owned(), mimicked });
    }
    Ok(Some(kind))
}

/// Joints and collision shapes collected along the path.
pub(crate) struct ChainBuilder<'t> {
    tree: &'t UrdfTree<'t>,
    path: &'t [usize],
    pub(crate) replacements: &'t Replacements<'t>,
    pub(crate) joints: ArrayVec<Joint, MAX_JOINTS>,
    collisions: Vec<Collision>,
    warnings: Vec<String>,
    /// Collision meshes that were not read: link, and why.
    unread: Vec<(String, RobotError)>,
}

impl ChainBuilder<'_> {
    fn file(&self) -> String {
        self.tree.file().to_owned()
    }

    /// Adds a movable joint whose frame is at `pose` in the previous body; returns its body, still without mass.
    fn joint(&mut self, index: usize, kind: JointKind, pose: &IsometryMatrix3<f64>) -> Result<ChainBody, RobotError> {
        let joint = self.tree.joint(index);
        let (name, element) = (joint.name, joint.element);
        let axis_place = || format!("joint '{name}' <axis xyz>");
        let written = match element.child("axis") {
            Some(axis) => axis.triple("xyz", axis_place)?.unwrap_or([1.0, 0.0, 0.0]),
            None => [1.0, 0.0, 0.0],
        };
        let length = Vector3::from(written).norm();
        if !length.is_finite() || length < SHORTEST_AXIS {
            return Err(RobotError::Axis { file: element.place(), joint: name.to_owned(), found: written });
        }
        let axis = Vector3::from(written) / length;

        let limit = element.child("limit");
        let (lower, upper) = if kind == JointKind::Continuous {
            (f64::NEG_INFINITY, f64::INFINITY)
        } else {
            let Some(limit) = limit.filter(|limit| limit.attribute("lower").is_some() || limit.attribute("upper").is_some())
            else {
                let expected = "<limit lower=.. upper=.. effort=.. velocity=../>";
                let (file, kind) = (element.place(), joint.kind.to_owned());
                return Err(RobotError::MissingLimit { file, joint: name.to_owned(), kind, expected });
            };
            let bound = |attribute: &'static str| {
                let place = || format!("joint '{name}' <limit {attribute}>");
                let value = limit.number(attribute, place)?.unwrap_or(0.0);
                limit.finite(value, place).map(|()| value)
            };
            let (lower, upper) = (bound("lower")?, bound("upper")?);
            if lower > upper {
                return Err(RobotError::LimitsReversed { file: limit.place(), joint: name.to_owned(), lower, upper });
            }
            (lower, upper)
        };
        let effort = self.effort(name, element, limit)?;
        let velocity_limit = self.velocity(name, limit)?;
        let damping = self.dynamics(name, element, "damping", self.replacements.joint_damping)?;
        let friction = self.dynamics(name, element, "friction", self.replacements.joint_friction)?;
        let armature = self.replaced(self.replacements.armature, name).unwrap_or(0.0);

        let child_link = joint.child.to_owned();
        let name = name.to_owned();
        self.joints.push(Joint { name, child_link, kind, lower, upper, effort, velocity_limit, damping, friction, armature });
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

    pub(crate) fn warn(&mut self, at: Element<'_>, text: String) {
        self.warnings.push(format!("{}: {text}", at.place()));
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
            let own = parts::inertia(link);
            if let Some((principal, expected)) = own.as_ref().ok().and_then(|own| parts::impossible(&own.inertia_kg_m2)) {
                let found = format!("link '{}' <inertia>: found the principal moments {principal:?} kg m^2", link.name);
                let use_of = if body.is_some() { "what is fixed to each other counts" } else { "the base does not move" };
                self.warn(link.element, format!("{found}, expected {expected} ({use_of})"));
            }
            match (own, body) {
                (Ok(own), Some(_)) => inertia = inertia.plus(&own.placed(&pose)),
                (Err(error), Some(_)) => return Err(error),
                (Err(error), None) => self.warnings.push(format!("{error} (ignored: the base does not move)")),
                (Ok(_), None) => {}
            }
            for collision in link.element.children("collision") {
                match parts::collision(link.name, collision, body, &pose, tree.file()) {
                    Ok(collision) => self.collisions.push(collision),
                    Err(error @ RobotError::Mesh { .. }) => self.unread.push((link.name.to_owned(), error)),
                    // A shape stops no load: dynamics needs none.
                    Err(error) => self.warnings.push(format!("{error} (left out)")),
                }
            }
            // Reversed, so that the stack returns them in the order of the file.
            for &below in tree.below(index).iter().rev() {
                let joint = tree.joint(below);
                if joint.kind == "fixed" && !self.path.contains(&below) {
                    match parts::pose(joint.element, || format!("joint '{}' <origin>", joint.name)) {
                        Ok(own) => open.push((tree.child(below), pose * own)),
                        Err(error) if body.is_none() => {
                            self.warnings
                                .push(format!("{error} (left out with all that is fixed to it: the base does not move)"));
                        }
                        Err(error) => return Err(error),
                    }
                }
            }
        }
        Ok(inertia)
    }

    /// One warning for all meshes that were not read: robots have one for each link.
    fn warn_of_meshes(&mut self) {
        let Some((first, error)) = self.unread.first() else { return };
        let mut others: Vec<&str> = self.unread.iter().map(|(link, _)| link.as_str()).filter(|link| link != first).collect();
        others.dedup();
        let left_out = match others.len() {
            0 => "left out".to_owned(),
            1 => format!("left out, as that of link {}", others[0]),
            _ => format!("left out, as those of the links {}", others.join(", ")),
        };
        self.warnings.push(format!("{error} ({left_out})"));
    }

    /// Puts a foot in place of the shapes of the tip link, which is at `pose` on `body`.
    fn replace_foot(&mut self, foot: &Foot, tip_link: &str, body: Option<usize>, pose: &IsometryMatrix3<f64>) {
        self.collisions.retain(|collision| collision.link != tip_link);
        let rotation = UnitQuaternion::from_rotation_matrix(&pose.rotation);
        let mut add = |center: [f64; 3], rotation, shape| {
            let center = pose * Point3::from(center);
            let origin = Isometry3::from_parts(center.coords.into(), rotation);
            self.collisions.push(Collision { link: tip_link.to_owned(), body, origin, shape });
        };
        match foot {
            Foot::Spheres { radius_m, centers_m } => {
                for center in centers_m {
                    add(*center, UnitQuaternion::identity(), Shape::Sphere { radius: *radius_m });
                }
            }
            Foot::Box { size_m, offset_m } => add(*offset_m, rotation, Shape::Box { size: *size_m }),
        }
    }

    /// File and line of a link.
    fn place_of(&self, link: &str) -> String {
        self.tree.find("child", link).map_or_else(|_| self.file(), |index| self.tree.link(index).element.place())
    }

    /// Checks the inertia of each body, and that the last joints move some.
    fn check_masses(&mut self, bodies: &[ChainBody]) -> Result<(), RobotError> {
        let mut odd = Vec::new();
        for (body, joint) in bodies.iter().zip(&self.joints) {
            let Some((principal, expected)) = parts::impossible(&body.inertia.inertia_kg_m2) else { continue };
            let (file, link) = (self.place_of(&joint.child_link), joint.child_link.clone());
            if expected != parts::TRIANGLE {
                return Err(RobotError::Inertia { file, link, principal, expected });
            }
            // A link's own warning says the same.
            if self.warnings.iter().any(|warning| warning.contains(&format!("link '{link}' <inertia>"))) {
                continue;
            }
            // No body has it, but the equations of motion are sound as long as the mass matrix is positive definite.
            odd.push(format!(
                "{file}: link '{link}' <inertia>: found the principal moments {principal:?} kg m^2, expected {expected}; taken as it is"
            ));
        }
        self.warnings.append(&mut odd);
        for (i, joint) in self.joints.iter().enumerate() {
            if joint.armature <= 0.0 && bodies[i..].iter().all(|body| body.inertia.mass_kg <= 0.0) {
                return Err(RobotError::Massless {
                    file: self.place_of(&joint.child_link),
                    joint: joint.name.clone(),
                    link: joint.child_link.clone(),
                });
            }
        }
        if let (Some(body), Some(joint)) = (bodies.last(), self.joints.last()) {
            // In the frame of the body; rotation about the axis does not change it.
            let axis = body.joint_rotation.tr_mul(&body.axis);
            let found = body.inertia.about_axis(&axis);
            if body.rotational && joint.armature <= 0.0 && found <= ZERO_INERTIA {
                return Err(RobotError::NoInertia {
                    file: self.place_of(&joint.child_link),
                    joint: joint.name.clone(),
                    link: joint.child_link.clone(),
                    found,
                });
            }
        }
        Ok(())
    }
}
