//! Scene of a scenario for viewers: the robot's links, the objects and the floor.

use crate::viewer::{SceneBody, SceneShape, ViewerScene, ViewerShape};
use hapfic_config::{ObjectShape, Settings};
use hapfic_messages::State;
use hapfic_robot::{Chain, Shape as RobotShape};

const LINK_COLOR: [f64; 4] = [0.55, 0.6, 0.68, 1.0];
const TIP_COLOR: [f64; 4] = [0.95, 0.6, 0.15, 1.0];
const BASE_COLOR: [f64; 4] = [0.35, 0.35, 0.4, 1.0];
const OBJECT_COLOR: [f64; 4] = [0.3, 0.55, 0.8, 0.9];
const FLOOR_COLOR: [f64; 4] = [0.82, 0.82, 0.78, 0.8];
const FLOOR_SIZE_M: f64 = 2.0;
const WORLD: &str = "world";

/// Makes the scene of a scenario. Each moving body of the chain is a frame with the name of its link.
#[must_use]
pub fn scene(settings: &Settings, chain: &Chain) -> ViewerScene {
    let mut bodies: Vec<_> = chain
        .joints()
        .iter()
        .map(|joint| SceneBody { name: joint.child_link.clone(), frame: joint.child_link.clone(), shapes: Vec::new() })
        .collect();
    let base = chain.base_pose();
    let mut fixed = SceneBody { name: chain.base_link().to_owned(), frame: WORLD.to_owned(), shapes: Vec::new() };
    for collision in chain.collisions() {
        let color = if collision.link == chain.tip_link() { TIP_COLOR } else { LINK_COLOR };
        match collision.body.and_then(|i| bodies.get_mut(i)) {
            Some(body) => body.shapes.push(shape(&collision.shape, &collision.origin, color)),
            None => fixed.shapes.push(shape(&collision.shape, &(base * collision.origin), BASE_COLOR)),
        }
    }
    if fixed.shapes.is_empty() {
        // A visible base for the robot.
        fixed.shapes.push(shape(&RobotShape::Sphere { radius: 0.03 }, &base, BASE_COLOR));
    }
    bodies.push(fixed);
    for object in &settings.world.objects {
        let object_shape = match object.shape {
            ObjectShape::Box { size_m } => ViewerShape::Box { size: size_m },
            ObjectShape::Ball { radius_m } => ViewerShape::Sphere { radius: radius_m },
        };
        let part = SceneShape { position: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0], shape: object_shape, color: OBJECT_COLOR };
        bodies.push(SceneBody { name: object.name.clone(), frame: object.name.clone(), shapes: vec![part] });
    }
    if let Some(floor) = &settings.world.floor {
        bodies.push(SceneBody {
            name: "floor".to_owned(),
            frame: WORLD.to_owned(),
            shapes: vec![SceneShape {
                position: [0.0, 0.0, floor.height_m],
                orientation: [0.0, 0.0, 0.0, 1.0],
                shape: ViewerShape::Plane { size: FLOOR_SIZE_M },
                color: FLOOR_COLOR,
            }],
        });
    }
    ViewerScene { bodies }
}

fn shape(shape: &RobotShape, origin: &nalgebra::Isometry3<f64>, color: [f64; 4]) -> SceneShape {
    let shape = match *shape {
        RobotShape::Sphere { radius } => ViewerShape::Sphere { radius },
        RobotShape::Cylinder { radius, length } => ViewerShape::Cylinder { radius, length },
        // Viewers have no capsules: the enclosing cylinder replaces them.
        RobotShape::Capsule { radius, length } => ViewerShape::Cylinder { radius, length: length + 2.0 * radius },
        RobotShape::Box { size } => ViewerShape::Box { size },
        // Its bounding box, about whose middle the corners are.
        RobotShape::Hull { ref corners } => ViewerShape::Box {
            size: core::array::from_fn(|axis| 2.0 * corners.iter().fold(0.0, |most: f64, corner| most.max(corner[axis].abs()))),
        },
    };
    let (position, orientation) = pose(origin);
    SceneShape { position, orientation, shape, color }
}

/// Position [m] and unit quaternion x y z w.
pub type BodyPose = ([f64; 3], [f64; 4]);

fn pose(p: &nalgebra::Isometry3<f64>) -> BodyPose {
    let q = p.rotation;
    (p.translation.vector.into(), [q.i, q.j, q.k, q.w])
}

/// Returns the poses of the moving bodies, in the order of [`scene`].
#[must_use]
pub fn poses(chain: &Chain, state: &State) -> Vec<BodyPose> {
    let n = chain.dof();
    let kin = chain.kinematics(&state.joint_position[..n]);
    let links = (0..n).map(|i| pose(&kin.body_pose(i)));
    let objects = state.objects.iter().take(state.object_count as usize).map(|o| (o.position, o.orientation));
    links.chain(objects).collect()
}
