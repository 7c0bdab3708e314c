//! Surfaces of the world as the foot meets them.

use super::{Advisor, Case};
use hapfic_config::{Object, ObjectShape};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Place of the foot relative to a surface.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NearSurface {
    /// Name for messages.
    pub(super) name: String,
    /// Outward normal, a unit vector.
    pub(super) normal: Vector3<f64>,
    /// Depth of the foot's sphere in the body [m]; negative: distance.
    pub(super) depth_m: f64,
    /// Contact stiffness k [N/m].
    pub(super) stiffness: f64,
}

/// Pose of an object at the start.
pub(super) fn start_pose(object: &Object) -> Isometry3<f64> {
    let [roll, pitch, yaw] = object.orientation_rpy_rad;
    Isometry3::from_parts(Translation3::from(object.position_m), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

impl Advisor {
    /// Floor and objects around a foot at the target of a case.
    pub(super) fn surfaces(&self, case: &Case<'_>) -> Vec<NearSurface> {
        let world = &self.settings.world;
        let spheres = self.foot(case);
        let mut found = Vec::new();
        if let Some(floor) = &world.floor
            && let Some((normal, depth_m)) = deepest(&spheres, |center| (Vector3::z(), center.z - floor.height_m))
        {
            found.push(NearSurface { name: "the floor".to_owned(), normal, depth_m, stiffness: floor.surface.stiffness_n_per_m });
        }
        for (object, pose) in world.objects.iter().zip(&case.scene.objects) {
            if let Some((normal, depth_m)) = deepest(&spheres, |center| distance(&object.shape, pose, center)) {
                let name = if *pose == start_pose(object) {
                    format!("'{}' where it starts", object.name)
                } else {
                    format!("'{}'", object.name)
                };
                found.push(NearSurface { name, normal, depth_m, stiffness: object.surface.stiffness_n_per_m });
            }
        }
        found
    }

    /// The surface nearest to the foot, or the one that it is deepest in.
    pub(super) fn nearest_surface(&self, case: &Case<'_>) -> Option<NearSurface> {
        self.surfaces(case).into_iter().max_by(|a, b| a.depth_m.total_cmp(&b.depth_m))
    }

    /// Spheres of the foot with its frame at the target: centres and radii [m]; corners have radius zero. Without a shape it is a point.
    fn foot(&self, case: &Case<'_>) -> Vec<(Vector3<f64>, f64)> {
        let kin = self.chain.kinematics(&case.reach.q);
        let shapes = self.chain.collisions().iter().filter(|shape| shape.body.is_some() && shape.link == self.chain.tip_link());
        let spheres = shapes.flat_map(|shape| shape.spheres(&self.chain.collision_pose(&kin, shape)));
        let mut spheres: Vec<_> =
            spheres.map(|(center, radius)| (case.target + center.coords - kin.tip_position(), radius)).collect();
        if spheres.is_empty() {
            spheres.push((case.target, 0.0));
        }
        spheres
    }
}

/// Normal and depth of the sphere that is deepest in a body, whose surface gives normal and distance at a point.
fn deepest(
    spheres: &[(Vector3<f64>, f64)],
    surface: impl Fn(&Vector3<f64>) -> (Vector3<f64>, f64),
) -> Option<(Vector3<f64>, f64)> {
    let depths = spheres.iter().map(|(center, radius)| {
        let (normal, distance) = surface(center);
        (normal, radius - distance)
    });
    depths.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Outward normal of a body's surface nearest to a point, and the point's distance from it [m], negative inside.
fn distance(shape: &ObjectShape, pose: &Isometry3<f64>, point: &Vector3<f64>) -> (Vector3<f64>, f64) {
    let local: Vector3<f64> = pose.inverse_transform_point(&(*point).into()).coords;
    let (normal, distance) = match shape {
        ObjectShape::Ball { radius_m } => {
            (local.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::z), local.norm() - radius_m)
        }
        ObjectShape::Box { size_m } => {
            let outside = local.zip_map(&Vector3::from(*size_m), |at, size| at.abs() - 0.5 * size);
            let sides = local.map(f64::signum);
            let gap = outside.map(|d| d.max(0.0));
            if gap.norm() > 0.0 {
                (gap.component_mul(&sides).normalize(), gap.norm())
            } else {
                let axis = outside.imax();
                (Vector3::ith(axis, sides[axis]), outside[axis])
            }
        }
    };
    (pose.rotation * normal, distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_to_box_and_ball_has_outward_normal() {
        let pose = Isometry3::translation(1.0, 0.0, 0.0);
        let cube = ObjectShape::Box { size_m: [0.2, 0.4, 0.6] };
        let close = |found: (Vector3<f64>, f64), normal: [f64; 3], distance: f64| {
            assert!((found.0 - Vector3::from(normal)).norm() < 1e-12 && (found.1 - distance).abs() < 1e-12, "{found:?}");
        };
        close(super::distance(&cube, &pose, &Vector3::new(1.0, 0.0, 0.5)), [0.0, 0.0, 1.0], 0.2);
        close(super::distance(&cube, &pose, &Vector3::new(0.85, 0.0, 0.0)), [-1.0, 0.0, 0.0], 0.05);
        close(super::distance(&cube, &pose, &Vector3::new(1.0, 0.19, 0.0)), [0.0, 1.0, 0.0], -0.01);
        close(super::distance(&cube, &pose, &Vector3::new(1.4, 0.6, 0.0)), [0.6, 0.8, 0.0], 0.5);
        let ball = ObjectShape::Ball { radius_m: 0.1 };
        close(super::distance(&ball, &pose, &Vector3::new(1.0, 0.0, 0.15)), [0.0, 0.0, 1.0], 0.05);
        close(super::distance(&ball, &pose, &Vector3::new(1.0, -0.04, 0.0)), [0.0, -1.0, 0.0], -0.06);
    }
}
