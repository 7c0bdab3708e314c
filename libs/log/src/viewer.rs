//! Messages for 3-D views of a run: moving bodies, contact forces, reference and target.
//!
//! The messages are those of Foxglove, which other viewers read too. Integer arithmetic on the tick alone thins them
//! out to about 60 Hz. So the log of a lockstep run remains a function of scenario and seed.

use crate::{proto, time_of};
use foxglove::messages::log::Level;
use foxglove::messages::{
    ArrowPrimitive, Color, CubePrimitive, CylinderPrimitive, FrameTransform, FrameTransforms, Log, Pose, Quaternion, SceneEntity,
    SceneUpdate, SpherePrimitive, Timestamp, Vector3,
};
use hapfic_messages::Severity;

/// Fixed frame.
pub const WORLD: &str = "world";

/// Ticks per second.
const TICKS_PER_SECOND: i64 = 1000;
/// Scale of an arrow [m/N]: 10 N are 1 cm.
const ARROW_M_PER_N: f64 = 1e-3;
/// Smallest force with an arrow [N].
const MIN_FORCE_N: f64 = 0.01;
/// Longest head of an arrow [m].
const HEAD_M: f64 = 0.02;
/// Diameter of an arrow's shaft [m].
const SHAFT_M: f64 = 0.006;
/// Diameter of the spheres at reference and target [m].
const MARK_M: f64 = 0.012;
/// Thickness of a plane [m].
const PLANE_M: f64 = 1e-4;
const UPRIGHT: [f64; 4] = [0.0, 0.0, 0.0, 1.0];
const FORCE_COLOR: [f64; 4] = [0.9, 0.2, 0.1, 1.0];
const REFERENCE_COLOR: [f64; 4] = [0.1, 0.6, 0.2, 1.0];
const TARGET_COLOR: [f64; 4] = [0.1, 0.3, 0.9, 0.7];

/// Static description of the scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewerScene {
    /// Bodies, each with the frame of its shapes.
    pub bodies: Vec<SceneBody>,
}

/// Body and its shapes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneBody {
    /// Name, unique in the scene.
    pub name: String,
    /// Frame of its shapes; [`WORLD`] if it does not move.
    pub frame: String,
    /// Shapes.
    pub shapes: Vec<SceneShape>,
}

/// Shape in the frame of its body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneShape {
    /// Centre of the shape [m].
    pub position: [f64; 3],
    /// Unit quaternion x y z w.
    pub orientation: [f64; 4],
    /// Geometry.
    pub shape: ViewerShape,
    /// Red, green, blue and opacity, 0 to 1.
    pub color: [f64; 4],
}

/// Geometry of a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewerShape {
    /// Sphere.
    Sphere {
        /// Radius [m].
        radius: f64,
    },
    /// Cylinder along z.
    Cylinder {
        /// Radius [m].
        radius: f64,
        /// Length [m].
        length: f64,
    },
    /// Box.
    Box {
        /// Edges along x, y and z [m].
        size: [f64; 3],
    },
    /// Infinite plane z = 0, displayed as a square.
    Plane {
        /// Edge of the square [m].
        size: f64,
    },
}

/// Generator of the messages for viewers.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewer {
    scene: ViewerScene,
    rate_hz: u32,
    start_unix_ns: u64,
}

impl Viewer {
    /// Creates a generator with `rate_hz` from 0 (never due) to 1000 [Hz]; more counts as 1000.
    ///
    /// `start_unix_ns` is the time of tick 0, as in the log [ns].
    #[must_use]
    pub fn new(scene: ViewerScene, rate_hz: u32, start_unix_ns: u64) -> Self {
        Self { scene, rate_hz, start_unix_ns }
    }

    /// Whether this tick is one of the `rate_hz` viewer frames of a second. With any rate, every whole second is.
    #[must_use]
    pub fn due(&self, tick: i64) -> bool {
        let frame = |tick: i64| (i128::from(tick) * i128::from(self.rate_hz)).div_euclid(i128::from(TICKS_PER_SECOND));
        tick >= 0 && frame(tick) > frame(tick - 1)
    }

    /// Moving frames, in the order of the scene: [`Viewer::transforms`] needs a pose for each.
    pub fn moving_frames(&self) -> impl Iterator<Item = &str> {
        self.scene.bodies.iter().map(|body| body.frame.as_str()).filter(|frame| *frame != WORLD)
    }

    /// Makes the poses of the moving frames in the world, from positions [m] and unit quaternions x y z w.
    ///
    /// Frames without a pose are left out.
    #[must_use]
    pub fn transforms(&self, tick: i64, poses: &[([f64; 3], [f64; 4])]) -> FrameTransforms {
        let timestamp = self.timestamp(tick);
        let transforms = self.moving_frames().zip(poses).map(|(frame, (position, orientation))| FrameTransform {
            timestamp: Some(timestamp),
            parent_frame_id: WORLD.to_owned(),
            child_frame_id: frame.to_owned(),
            translation: Some(vector(*position)),
            rotation: Some(quaternion(*orientation)),
        });
        FrameTransforms { transforms: transforms.collect() }
    }

    /// Makes contact forces, reference and target, in the world.
    ///
    /// Once a second it adds the bodies, for viewers that connect late.
    #[must_use]
    pub fn scene_update(
        &self,
        tick: i64,
        contacts: &[proto::Contact],
        reference: Option<[f64; 3]>,
        target: Option<[f64; 3]>,
    ) -> SceneUpdate {
        let mut entities = Vec::new();
        if tick.rem_euclid(TICKS_PER_SECOND) == 0 {
            entities.extend(self.scene.bodies.iter().map(|body| self.body(tick, body)));
        }
        // Always sent: an entity without a shape removes the previous shapes.
        let mut forces = self.entity(tick, WORLD, "contacts");
        forces.arrows = contacts.iter().filter_map(arrow).collect();
        entities.push(forces);
        for (id, position, color) in [("reference", reference, REFERENCE_COLOR), ("target", target, TARGET_COLOR)] {
            let mut mark = self.entity(tick, WORLD, id);
            mark.spheres = position.map(|position| sphere(pose(position, UPRIGHT), MARK_M, color)).into_iter().collect();
            entities.push(mark);
        }
        SceneUpdate { deletions: Vec::new(), entities }
    }

    fn body(&self, tick: i64, body: &SceneBody) -> SceneEntity {
        let mut entity = self.entity(tick, &body.frame, &body.name);
        for part in &body.shapes {
            let pose = pose(part.position, part.orientation);
            let color = Some(rgba(part.color));
            match part.shape {
                ViewerShape::Sphere { radius } => entity.spheres.push(sphere(pose, 2.0 * radius, part.color)),
                ViewerShape::Cylinder { radius, length } => entity.cylinders.push(CylinderPrimitive {
                    pose: Some(pose),
                    size: Some(vector([2.0 * radius, 2.0 * radius, length])),
                    bottom_scale: 1.0,
                    top_scale: 1.0,
                    color,
                }),
                ViewerShape::Box { size } => {
                    entity.cubes.push(CubePrimitive { pose: Some(pose), size: Some(vector(size)), color });
                }
                ViewerShape::Plane { size } => {
                    let size = Some(vector([size, size, PLANE_M]));
                    entity.cubes.push(CubePrimitive { pose: Some(pose), size, color });
                }
            }
        }
        entity
    }

    fn entity(&self, tick: i64, frame: &str, id: &str) -> SceneEntity {
        SceneEntity {
            timestamp: Some(self.timestamp(tick)),
            frame_id: frame.to_owned(),
            id: id.to_owned(),
            frame_locked: true,
            ..SceneEntity::default()
        }
    }

    /// Formats an event as a line of text; its level follows from the severity.
    #[must_use]
    pub fn log_line(&self, event: &proto::Event) -> Log {
        let level = match Severity::from_name(&event.severity) {
            Some(Severity::Nominal) => Level::Info,
            Some(Severity::Degraded) => Level::Warning,
            Some(Severity::Brake) => Level::Error,
            Some(Severity::Stopped) => Level::Fatal,
            None => Level::Unknown,
        };
        Log {
            timestamp: Some(self.timestamp(event.tick)),
            level: level as i32,
            message: format!("{}: {}", event.kind, event.text),
            name: event.process.clone(),
            ..Log::default()
        }
    }

    fn timestamp(&self, tick: i64) -> Timestamp {
        const NS_PER_SECOND: u64 = 1_000_000_000;
        let ns = time_of(self.start_unix_ns, tick);
        let seconds = u32::try_from(ns / NS_PER_SECOND);
        seconds.map_or(Timestamp::MAX, |seconds| Timestamp::new(seconds, (ns % NS_PER_SECOND) as u32))
    }
}

/// Makes the arrow of a contact force from its point; `None` if it is too small or invalid.
fn arrow(contact: &proto::Contact) -> Option<ArrowPrimitive> {
    let point: [f64; 3] = contact.point.as_slice().try_into().ok()?;
    let force: [f64; 3] = contact.force.as_slice().try_into().ok()?;
    let size = force.iter().map(|f| f * f).sum::<f64>().sqrt();
    if !size.is_finite() || size < MIN_FORCE_N {
        return None;
    }
    let length = size * ARROW_M_PER_N;
    let head = HEAD_M.min(0.3 * length);
    Some(ArrowPrimitive {
        pose: Some(pose(point, from_x_axis(force.map(|f| f / size)))),
        shaft_length: length - head,
        shaft_diameter: SHAFT_M,
        head_length: head,
        head_diameter: 2.0 * SHAFT_M,
        color: Some(rgba(FORCE_COLOR)),
    })
}

/// Returns the shortest rotation from the x axis to a unit vector, as a unit quaternion x y z w.
fn from_x_axis(direction: [f64; 3]) -> [f64; 4] {
    let [x, y, z] = direction;
    // Opposite to x, every half rotation about a perpendicular axis is shortest.
    if x < -1.0 + 1e-9 {
        return [0.0, 0.0, 1.0, 0.0];
    }
    let norm = ((1.0 + x).powi(2) + y * y + z * z).sqrt();
    [0.0, -z / norm, y / norm, (1.0 + x) / norm]
}

fn sphere(pose: Pose, diameter: f64, color: [f64; 4]) -> SpherePrimitive {
    SpherePrimitive { pose: Some(pose), size: Some(vector([diameter; 3])), color: Some(rgba(color)) }
}

fn pose(position: [f64; 3], orientation: [f64; 4]) -> Pose {
    Pose { position: Some(vector(position)), orientation: Some(quaternion(orientation)) }
}

fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

fn quaternion([x, y, z, w]: [f64; 4]) -> Quaternion {
    Quaternion { x, y, z, w }
}

fn rgba([r, g, b, a]: [f64; 4]) -> Color {
    Color { r, g, b, a }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rotated_x_axis([x, y, z, w]: [f64; 4]) -> [f64; 3] {
        // First column of the rotation matrix: the image of the x axis.
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)]
    }

    #[test]
    fn arrow_direction_is_that_of_force() {
        let third = 1.0 / 3.0_f64.sqrt();
        let directions = [
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
            [third, -third, third],
            [-0.6, 0.0, 0.8],
        ];
        for direction in directions {
            let rotated = rotated_x_axis(from_x_axis(direction));
            let same = rotated.iter().zip(&direction).all(|(a, b)| (a - b).abs() < 1e-12);
            assert!(same, "found {rotated:?}, expected {direction:?}");
        }
    }

    #[test]
    fn viewer_rate_gives_due_frames_and_every_whole_second() {
        let viewer = |rate_hz| Viewer::new(ViewerScene::default(), rate_hz, 0);
        for (rate_hz, expected) in [(0, 0), (1, 3), (60, 180), (999, 2997), (1000, 3000), (5000, 3000)] {
            assert_eq!((0..3000).filter(|&tick| viewer(rate_hz).due(tick)).count(), expected, "{rate_hz} Hz");
        }
        assert!([0, 1000, 2000].into_iter().all(|tick| viewer(60).due(tick)));
        assert!(!viewer(60).due(-1));
    }

    #[test]
    fn arrow_ten_newtons_is_one_centimetre() {
        let contact =
            |force: f64| proto::Contact { point: vec![0.1, 0.2, 0.0], force: vec![0.0, 0.0, force], ..proto::Contact::default() };
        let drawn = arrow(&contact(10.0)).map(|a| a.shaft_length + a.head_length);
        assert!(drawn.is_some_and(|length| (length - 0.01).abs() < 1e-15));
        assert_eq!(arrow(&contact(0.001)), None);
        assert_eq!(arrow(&contact(f64::NAN)), None);
    }
}
