//! The bodies of the world and their shapes, and which of them may touch.
//!
//! rapier's sets hold bodies and colliders; where two of them touch is parry's answer; how they push each other is ours
//! ([`crate::ContactLaw`]).

use crate::contact_law::ContactLaw;
use crate::error::PlantError;
use hapfic_config::Settings;
use hapfic_robot::{Chain, Kinematics, Shape};
use nalgebra::{Isometry3, Vector3};
use rapier3d_f64::parry::query;
use rapier3d_f64::prelude::{
    Collider, ColliderBuilder, ColliderHandle, ColliderSet, Pose, RigidBodyBuilder, RigidBodyHandle, RigidBodySet, SharedShape,
    Vector,
};

/// What a collider is fixed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Carrier {
    /// The world.
    World,
    /// A moving body of the chain.
    Link(usize),
}

/// A collider with its carrier and its name's place in [`Scene::names`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Side {
    pub(crate) carrier: Carrier,
    pub(crate) collider: ColliderHandle,
    pub(crate) name: usize,
}

/// Two colliders that may touch. The force on `body` is the normal force along the normal; `against` feels the opposite.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub(crate) body: Side,
    pub(crate) against: Side,
    pub(crate) law: ContactLaw,
    /// Whether the force sensor at the tip feels it.
    pub(crate) sensed: bool,
}

/// Where two colliders touch, or nearly do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Touch {
    /// World point midway between the two surfaces, m.
    pub(crate) point: Vector3<f64>,
    /// Unit normal, from `against` to `body`.
    pub(crate) normal: Vector3<f64>,
    /// Penetration, m; negative: the gap.
    pub(crate) depth: f64,
}

/// The world's bodies.
pub(crate) struct Scene {
    pub(crate) chain: Chain,
    bodies: RigidBodySet,
    colliders: ColliderSet,
    links: Vec<RigidBodyHandle>,
    pub(crate) names: Vec<String>,
    pub(crate) pairs: Vec<Pair>,
}

fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn pose(p: &Isometry3<f64>) -> Pose {
    let q = p.rotation;
    Pose::from_parts(vector(&p.translation.vector), rapier3d_f64::math::Rotation::from_xyzw(q.i, q.j, q.k, q.w))
}

fn shape(shape: &Shape) -> SharedShape {
    match *shape {
        Shape::Sphere { radius } => SharedShape::ball(radius),
        // URDF's cylinders stand along z, parry's along y; `upright` turns them.
        Shape::Cylinder { radius, length } => SharedShape::cylinder(0.5 * length, radius),
        Shape::Capsule { radius, length } => SharedShape::capsule_z(0.5 * length, radius),
        Shape::Box { size } => SharedShape::cuboid(0.5 * size[0], 0.5 * size[1], 0.5 * size[2]),
    }
}

fn upright(shape: &Shape) -> Isometry3<f64> {
    match shape {
        Shape::Cylinder { .. } => Isometry3::rotation(Vector3::new(std::f64::consts::FRAC_PI_2, 0.0, 0.0)),
        _ => Isometry3::identity(),
    }
}

impl Scene {
    /// Builds the world of a scenario.
    pub(crate) fn new(settings: &Settings, chain: Chain) -> Result<Self, PlantError> {
        let (mut bodies, mut colliders) = (RigidBodySet::new(), ColliderSet::new());
        let mut names = Vec::new();
        let mut pairs = Vec::new();
        let links: Vec<_> = (0..chain.dof()).map(|_| bodies.insert(RigidBodyBuilder::kinematic_position_based())).collect();

        let mut feet = Vec::new();
        for collision in chain.collisions() {
            let Some(body) = collision.body else { continue };
            let local = collision.origin * upright(&collision.shape);
            let collider = colliders.insert_with_parent(
                ColliderBuilder::new(shape(&collision.shape)).position(pose(&local)),
                links[body],
                &mut bodies,
            );
            names.push(collision.link.clone());
            if collision.link == chain.tip_link() {
                // A flat foot stands on more points than one; that comes with the other bodies.
                if !matches!(collision.shape, Shape::Sphere { .. }) {
                    return Err(PlantError::FootShape { link: collision.link.clone(), shape: collision.shape });
                }
                feet.push(Side { carrier: Carrier::Link(body), collider, name: names.len() - 1 });
            }
        }
        if let Some(floor) = &settings.world.floor {
            if feet.is_empty() {
                return Err(PlantError::NoFoot { link: chain.tip_link().to_owned() });
            }
            let ground = bodies.insert(RigidBodyBuilder::fixed().translation(Vector::new(0.0, 0.0, floor.height_m)));
            let collider =
                colliders.insert_with_parent(ColliderBuilder::new(SharedShape::halfspace(Vector::Z)), ground, &mut bodies);
            names.push("floor".to_owned());
            let against = Side { carrier: Carrier::World, collider, name: names.len() - 1 };
            let law = ContactLaw {
                stiffness: floor.stiffness_n_per_m,
                damping: floor.damping_n_s_per_m,
                transition_width: floor.transition_width_m,
                friction_static: floor.friction_static,
                friction_dynamic: floor.friction_dynamic,
                critical_speed: floor.critical_speed_m_per_s,
            };
            pairs.extend(feet.into_iter().map(|body| Pair { body, against, law, sensed: true }));
        }
        Ok(Self { chain, bodies, colliders, links, names, pairs })
    }

    fn collider(&self, side: Side) -> &Collider {
        // Handles are made in `new` and nothing is ever removed.
        &self.colliders[side.collider]
    }

    fn pose_of(&self, side: Side, kin: &Kinematics) -> Pose {
        let collider = self.collider(side);
        match side.carrier {
            Carrier::World => *collider.position(),
            Carrier::Link(i) => {
                let local = collider.position_wrt_parent().copied().unwrap_or_else(Pose::identity);
                pose(&kin.body_pose(i)) * local
            }
        }
    }

    /// Where the two sides of a pair touch, if their gap is below `reach`, m.
    pub(crate) fn touch(&self, pair: &Pair, kin: &Kinematics, reach: f64) -> Option<Touch> {
        let (body, against) = (self.pose_of(pair.body, kin), self.pose_of(pair.against, kin));
        // The half-space has to come first: parry 0.31.1 returns a wrong depth the other way round.
        let contact =
            query::contact(&against, self.collider(pair.against).shape(), &body, self.collider(pair.body).shape(), reach)
                .ok()
                .flatten()?;
        let middle = 0.5 * (contact.point1 + contact.point2);
        Some(Touch {
            point: Vector3::new(middle.x, middle.y, middle.z),
            normal: Vector3::new(contact.normal1.x, contact.normal1.y, contact.normal1.z),
            depth: -contact.dist,
        })
    }

    /// An upper bound of how fast the two sides can come closer, m/s, at joint velocities `qd`.
    pub(crate) fn closing_speed(&self, pair: &Pair, kin: &Kinematics, qd: &[f64]) -> f64 {
        [pair.body, pair.against]
            .into_iter()
            .map(|side| match side.carrier {
                Carrier::World => 0.0,
                Carrier::Link(i) => {
                    let center = self.pose_of(side, kin).translation;
                    let radius = self.collider(side).shape().compute_local_bounding_sphere().radius();
                    let jacobian = kin.point_jacobian(i, &Vector3::new(center.x, center.y, center.z));
                    jacobian.linear_mul(qd).norm() + jacobian.angular_mul(qd).norm() * radius
                }
            })
            .sum()
    }

    /// How deep the tip stands in something, m, and in what.
    pub(crate) fn deepest(&self, kin: &Kinematics) -> Option<(f64, &str)> {
        let depths =
            self.pairs.iter().filter_map(|p| Some((self.touch(p, kin, 0.0)?.depth, self.names[p.against.name].as_str())));
        depths.max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Moves rapier's bodies to where the chain is.
    pub(crate) fn place(&mut self, kin: &Kinematics) {
        for (i, handle) in self.links.iter().enumerate() {
            self.bodies[*handle].set_position(pose(&kin.body_pose(i)), false);
        }
    }
}

impl core::fmt::Debug for Scene {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Scene").field("names", &self.names).field("pairs", &self.pairs.len()).finish_non_exhaustive()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn floor_scene() -> Scene {
        let settings = Settings::load("floor", &[]).unwrap();
        let chain = hapfic_robot::Chain::from_urdf(&settings.robot.urdf.text, "leg.urdf", "base", "foot")
            .unwrap()
            .with_base([0.0, 0.0, 0.5], [0.0; 3]);
        Scene::new(&settings, chain).unwrap()
    }

    #[test]
    fn the_foot_starts_twelve_centimetres_over_the_floor() {
        let scene = floor_scene();
        let kin = scene.chain.kinematics(&[0.0, 0.9, -1.8]);
        let touch = scene.touch(&scene.pairs[0], &kin, 1.0).unwrap();
        assert!((touch.depth + (kin.tip_position().z - 0.02)).abs() < 1e-12, "{touch:?}");
        assert!((-touch.depth - 0.12).abs() < 0.005, "{touch:?}");
        assert!((touch.normal - Vector3::z()).norm() < 1e-12);
        assert_eq!(scene.touch(&scene.pairs[0], &kin, 0.05), None);
    }

    #[test]
    fn depth_grows_as_the_foot_sinks() {
        let scene = floor_scene();
        let kin = scene.chain.kinematics(&[0.0, 0.0, 0.0]);
        let touch = scene.touch(&scene.pairs[0], &kin, 0.001).unwrap();
        assert!((touch.depth - (0.02 - kin.tip_position().z)).abs() < 1e-12, "{touch:?}");
        assert!((touch.normal - Vector3::z()).norm() < 1e-12);
    }
}
