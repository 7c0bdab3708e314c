//! Checked content of the messages for 3-D viewers.

use crate::geometry::{Pose, Vector, rotate};
use crate::{is_plausible, vector};
use foxglove::messages::{self, SceneEntity};

/// Entities other than bodies.
const CONTACTS: &str = "contacts";
const REFERENCE: &str = "reference";
const TARGET: &str = "target";
/// Most shapes of a body in a snapshot.
const MOST_SHAPES: usize = 32;
/// Largest thickness and smallest width of a box that is a floor [m].
const FLOOR_THICKNESS_M: f64 = 1e-3;
const FLOOR_WIDTH_M: f64 = 0.5;

/// Shape in the frame of its body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Solid {
    pub(crate) pose: Pose,
    pub(crate) shape: SolidShape,
    /// Red, green, blue, from 0 to 1.
    pub(crate) color: [f64; 3],
}

/// Geometry of a solid [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SolidShape {
    Ball {
        radius: f64,
    },
    /// Rod along z; its length includes both rounded ends.
    Rod {
        radius: f64,
        length: f64,
    },
    Block {
        size: Vector,
    },
    Floor,
}

/// Body.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Body {
    /// Frame of the body.
    pub(crate) frame: String,
    pub(crate) solids: Vec<Solid>,
}

/// Content of a scene update.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Update {
    /// Bodies by name.
    pub(crate) bodies: Vec<(String, Body)>,
    /// Contact forces: from and to [m].
    pub(crate) arrows: Vec<(Vector, Vector)>,
    pub(crate) reference: Option<Vector>,
    pub(crate) target: Option<Vector>,
}

impl Update {
    pub(crate) fn new(message: &messages::SceneUpdate) -> Self {
        let mut update = Self::default();
        let position =
            |entity: &SceneEntity| entity.spheres.first().and_then(|s| pose(s.pose.as_ref())).map(|pose| pose.position);
        for entity in &message.entities {
            match entity.id.as_str() {
                CONTACTS => update.arrows = entity.arrows.iter().filter_map(arrow).collect(),
                REFERENCE => update.reference = position(entity),
                TARGET => update.target = position(entity),
                name => update.bodies.push((name.to_owned(), body(entity))),
            }
        }
        update
    }
}

/// Reads the poses of the moving frames, by name.
pub(crate) fn poses(message: &messages::FrameTransforms) -> Vec<(String, Pose)> {
    let list = message.transforms.iter().filter_map(|transform| {
        let position = vector3(transform.translation.as_ref())?;
        let orientation = quaternion(transform.rotation.as_ref())?;
        Some((transform.child_frame_id.clone(), Pose { position, orientation }))
    });
    list.collect()
}

fn body(entity: &SceneEntity) -> Body {
    let balls = entity.spheres.iter().filter_map(|s| {
        let radius = 0.5 * size(s.size.as_ref())?[0];
        Some(Solid { pose: pose(s.pose.as_ref())?, shape: SolidShape::Ball { radius }, color: color(s.color.as_ref()) })
    });
    let rods = entity.cylinders.iter().filter_map(|c| {
        let [width, _, length] = size(c.size.as_ref())?;
        let shape = SolidShape::Rod { radius: 0.5 * width, length };
        Some(Solid { pose: pose(c.pose.as_ref())?, shape, color: color(c.color.as_ref()) })
    });
    let blocks = entity.cubes.iter().filter_map(|c| {
        let size = size(c.size.as_ref())?;
        let flat = size[2] < FLOOR_THICKNESS_M && size[0] > FLOOR_WIDTH_M && size[1] > FLOOR_WIDTH_M;
        let shape = if flat { SolidShape::Floor } else { SolidShape::Block { size } };
        Some(Solid { pose: pose(c.pose.as_ref())?, shape, color: color(c.color.as_ref()) })
    });
    Body { frame: entity.frame_id.clone(), solids: balls.chain(rods).chain(blocks).take(MOST_SHAPES).collect() }
}

fn arrow(arrow: &messages::ArrowPrimitive) -> Option<(Vector, Vector)> {
    let pose = pose(arrow.pose.as_ref())?;
    let length = arrow.shaft_length + arrow.head_length;
    let end = rotate(pose.orientation, [length, 0.0, 0.0]);
    is_plausible(length).then(|| (pose.position, crate::geometry::add(pose.position, end)))
}

fn pose(pose: Option<&messages::Pose>) -> Option<Pose> {
    let pose = pose?;
    Some(Pose { position: vector3(pose.position.as_ref())?, orientation: quaternion(pose.orientation.as_ref())? })
}

fn vector3(v: Option<&messages::Vector3>) -> Option<Vector> {
    v.and_then(|v| vector(&[v.x, v.y, v.z]))
}

/// Reads a size, which must not be negative.
fn size(v: Option<&messages::Vector3>) -> Option<Vector> {
    vector3(v).filter(|size| size.iter().all(|edge| *edge >= 0.0))
}

fn quaternion(q: Option<&messages::Quaternion>) -> Option<[f64; 4]> {
    let q = q?;
    let norm = (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
    (norm.is_finite() && norm > 1e-6).then(|| [q.x, q.y, q.z, q.w].map(|v| v / norm))
}

fn color(color: Option<&messages::Color>) -> [f64; 3] {
    color.map_or([0.6; 3], |c| [c.r, c.g, c.b].map(|v| if v.is_finite() { v.clamp(0.0, 1.0) } else { 0.6 }))
}
