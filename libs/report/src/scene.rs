//! Checked content of the messages for 3-D viewers.

use crate::{is_plausible, vector};
use foxglove::messages::{self, SceneEntity};
use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion, Vector3};

/// Entities other than bodies.
const CONTACTS: &str = "contacts";
const REFERENCE: &str = "reference";
const TARGET: &str = "target";
/// Most shapes of a body in a snapshot.
const MAX_SHAPES: usize = 32;
/// Largest thickness and smallest width of a box that is a floor [m].
const FLOOR_THICKNESS_M: f64 = 1e-3;
const FLOOR_WIDTH_M: f64 = 0.5;

/// Shape in the frame of its body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlacedSolid {
    pub(crate) pose: Isometry3<f64>,
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
        size: Vector3<f64>,
    },
    Floor,
}

/// Solids of a body.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct BodySolids {
    /// Frame of the body.
    pub(crate) frame: String,
    pub(crate) solids: Vec<PlacedSolid>,
}

/// Content of a scene update.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SceneContent {
    /// Bodies by name.
    pub(crate) bodies: Vec<(String, BodySolids)>,
    /// Contact forces: from and to [m].
    pub(crate) arrows: Vec<(Point3<f64>, Point3<f64>)>,
    pub(crate) reference: Option<Point3<f64>>,
    pub(crate) target: Option<Point3<f64>>,
}

impl SceneContent {
    pub(crate) fn new(message: &messages::SceneUpdate) -> Self {
        let mut update = Self::default();
        let position = |entity: &SceneEntity| Some(pose(entity.spheres.first()?.pose.as_ref())?.translation.vector.into());
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
pub(crate) fn poses(message: &messages::FrameTransforms) -> Vec<(String, Isometry3<f64>)> {
    let pose = |transform: &messages::FrameTransform| {
        let pose = isometry(transform.translation.as_ref(), transform.rotation.as_ref())?;
        Some((transform.child_frame_id.clone(), pose))
    };
    message.transforms.iter().filter_map(pose).collect()
}

fn body(entity: &SceneEntity) -> BodySolids {
    let balls = entity.spheres.iter().filter_map(|s| {
        let radius = 0.5 * size(s.size.as_ref())?.x;
        Some(PlacedSolid { pose: pose(s.pose.as_ref())?, shape: SolidShape::Ball { radius }, color: color(s.color.as_ref()) })
    });
    let rods = entity.cylinders.iter().filter_map(|c| {
        let size = size(c.size.as_ref())?;
        let shape = SolidShape::Rod { radius: 0.5 * size.x, length: size.z };
        Some(PlacedSolid { pose: pose(c.pose.as_ref())?, shape, color: color(c.color.as_ref()) })
    });
    let blocks = entity.cubes.iter().filter_map(|c| {
        let size = size(c.size.as_ref())?;
        let flat = size.z < FLOOR_THICKNESS_M && size.xy().min() > FLOOR_WIDTH_M;
        let shape = if flat { SolidShape::Floor } else { SolidShape::Block { size } };
        Some(PlacedSolid { pose: pose(c.pose.as_ref())?, shape, color: color(c.color.as_ref()) })
    });
    BodySolids { frame: entity.frame_id.clone(), solids: balls.chain(rods).chain(blocks).take(MAX_SHAPES).collect() }
}

fn arrow(arrow: &messages::ArrowPrimitive) -> Option<(Point3<f64>, Point3<f64>)> {
    let pose = pose(arrow.pose.as_ref())?;
    let length = arrow.shaft_length + arrow.head_length;
    is_plausible(length).then(|| (pose.translation.vector.into(), pose * Point3::new(length, 0.0, 0.0)))
}

fn pose(pose: Option<&messages::Pose>) -> Option<Isometry3<f64>> {
    pose.and_then(|pose| isometry(pose.position.as_ref(), pose.orientation.as_ref()))
}

/// Reads a pose, whose quaternion must have a direction.
fn isometry(position: Option<&messages::Vector3>, orientation: Option<&messages::Quaternion>) -> Option<Isometry3<f64>> {
    let q = orientation.map(|q| Quaternion::new(q.w, q.x, q.y, q.z)).filter(|q| q.norm().is_finite())?;
    Some(Isometry3::from_parts(vector3(position)?.into(), UnitQuaternion::try_new(q, 1e-6)?))
}

fn vector3(v: Option<&messages::Vector3>) -> Option<Vector3<f64>> {
    v.and_then(|v| vector(&[v.x, v.y, v.z])).map(Vector3::from)
}

/// Reads a size, which must not be negative.
fn size(v: Option<&messages::Vector3>) -> Option<Vector3<f64>> {
    vector3(v).filter(|size| size.iter().all(|edge| *edge >= 0.0))
}

fn color(color: Option<&messages::Color>) -> [f64; 3] {
    color.map_or([0.6; 3], |c| [c.r, c.g, c.b].map(|v| if v.is_finite() { v.clamp(0.0, 1.0) } else { 0.6 }))
}
