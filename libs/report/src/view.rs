//! Scene and projection of the snapshots: the robot and the objects near it.

use crate::canvas::PixelPoint;
use crate::color::Color;
use crate::frames::{SnapshotCandidates, SnapshotFrame};
use crate::scene::{BodySolids, PlacedSolid, SolidShape};
use nalgebra::{Point3, Vector3};

/// Width of one snapshot, and its smallest and largest height [px].
pub(crate) const WIDTH: f32 = 400.0;
const MIN_HEIGHT: f32 = 160.0;
const MAX_HEIGHT: f32 = 640.0;
const MARGIN: f32 = 24.0;
/// Direction from the scene to the eye, world frame.
const EYE: Vector3<f64> = Vector3::new(0.5, -1.0, 0.38);
/// Direction from the scene to the light, world frame.
const LIGHT: Vector3<f64> = Vector3::new(-0.35, -0.7, 0.9);
/// Share of ambient light.
pub(crate) const AMBIENT: f64 = 0.55;
/// Largest horizontal distance of a visible object from the robot [m].
const MAX_OBJECT_DISTANCE_M: f64 = 0.6;
/// Margin of the floor around the scene [m].
const FLOOR_AROUND_M: f64 = 0.08;
/// Radius of the marks at reference and target [m].
const MARK_M: f64 = 0.02;

/// Scene of a snapshot.
#[derive(Debug)]
pub(crate) struct SnapshotScene {
    /// Robot and objects without the floor, world frame.
    pub(crate) solids: Vec<PlacedSolid>,
    /// Height of the floor [m].
    pub(crate) ground: Option<f64>,
    /// Contact forces: from and to [m].
    pub(crate) arrows: Vec<(Point3<f64>, Point3<f64>)>,
    pub(crate) reference: Option<Point3<f64>>,
    pub(crate) target: Option<Point3<f64>>,
}

impl SnapshotScene {
    /// Selects the robot and the objects near its bodies or its foot.
    pub(crate) fn new(frames: &SnapshotCandidates, frame: &SnapshotFrame) -> Self {
        let placed = |body: &BodySolids| {
            // A body without a pose is fixed.
            let pose = frame.poses.get(&body.frame).copied().unwrap_or_default();
            body.solids.iter().map(|solid| PlacedSolid { pose: pose * solid.pose, ..*solid }).collect::<Vec<_>>()
        };
        let (objects, others): (Vec<_>, Vec<_>) = frames.bodies.iter().partition(|(name, _)| frames.objects.contains(*name));
        let (floors, mut solids): (Vec<_>, Vec<_>) =
            others.into_iter().flat_map(|(_, body)| placed(body)).partition(|solid| solid.shape == SolidShape::Floor);
        let anchors: Vec<_> = solids.iter().map(|solid| solid.pose.translation.vector.into()).chain(frame.foot).collect();
        let near = |point: &Point3<f64>| {
            anchors.is_empty() || anchors.iter().any(|anchor| (point - anchor).xy().norm() <= MAX_OBJECT_DISTANCE_M)
        };
        for object in objects.into_iter().map(|(_, body)| placed(body)) {
            if object.iter().any(|solid| near(&solid.pose.translation.vector.into())) {
                solids.extend(object);
            }
        }
        Self {
            solids,
            ground: floors.last().map(|floor| floor.pose.translation.z),
            arrows: frame.arrows.iter().filter(|(from, _)| near(from)).copied().collect(),
            reference: frame.reference.filter(near),
            target: frame.target.filter(near),
        }
    }
}

/// Projection from the world to the picture, without perspective.
#[derive(Debug)]
pub(crate) struct View {
    pub(crate) right: Vector3<f64>,
    pub(crate) up: Vector3<f64>,
    pub(crate) eye: Vector3<f64>,
    pub(crate) light: Vector3<f64>,
    /// Centre of the scene, in the picture's plane [m].
    middle: (f64, f64),
    /// Scale [px/m].
    scale: f64,
    /// Height of a snapshot [px].
    pub(crate) height: f32,
    /// Left edge of the snapshot [px].
    pub(crate) left: f32,
    /// Extent of the floor: smallest and largest x and y [m].
    pub(crate) floor: [(f64, f64); 2],
}

impl View {
    /// Fits one view tightly around the scenes of all snapshots; `None` if they are empty.
    pub(crate) fn around(scenes: &[SnapshotScene]) -> Option<Self> {
        let eye = EYE.normalize();
        let right = Vector3::z().cross(&eye).normalize();
        let up = eye.cross(&right);
        let (mut across, mut along) = ((f64::MAX, f64::MIN), (f64::MAX, f64::MIN));
        let mut floor = [across, across];
        let mut include = |centre: Point3<f64>, radius: f64| {
            widen(&mut across, centre.coords.dot(&right), radius);
            widen(&mut along, centre.coords.dot(&up), radius);
            widen(&mut floor[0], centre.x, radius);
            widen(&mut floor[1], centre.y, radius);
        };
        for solid in scenes.iter().flat_map(|scene| &scene.solids) {
            match solid.shape {
                SolidShape::Ball { radius } => include(solid.pose.translation.vector.into(), radius),
                SolidShape::Rod { radius, length } => {
                    let reach = (0.5 * length - radius).max(0.0);
                    for end in [-reach, reach] {
                        include(solid.pose * Point3::new(0.0, 0.0, end), radius);
                    }
                }
                SolidShape::Block { size } => {
                    for corner in 0..8_usize {
                        let sign = |bit: usize, _| if (corner >> bit) & 1 == 0 { -0.5 } else { 0.5 };
                        include(solid.pose * Point3::from(Vector3::from_fn(sign).component_mul(&size)), 0.0);
                    }
                }
                SolidShape::Floor => {}
            }
        }
        for scene in scenes {
            for mark in [scene.reference, scene.target].into_iter().flatten() {
                include(mark, MARK_M);
            }
            for (from, to) in &scene.arrows {
                include(*from, 0.0);
                include(*to, 0.0);
            }
        }
        if !(across.1 > across.0 && along.1 > along.0) {
            return None;
        }
        if let Some(height) = scenes.iter().find_map(|scene| scene.ground) {
            floor = floor.map(|(low, high)| (low - FLOOR_AROUND_M, high + FLOOR_AROUND_M));
            let [(x0, x1), (y0, y1)] = floor;
            for corner in [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| Vector3::new(x, y, height)) {
                widen(&mut across, corner.dot(&right), 0.0);
                widen(&mut along, corner.dot(&up), 0.0);
            }
        }
        let (wide, high) = (f64::from(WIDTH - 2.0 * MARGIN), f64::from(MAX_HEIGHT - 2.0 * MARGIN));
        let scale = (wide / (across.1 - across.0)).min(high / (along.1 - along.0));
        let height = ((along.1 - along.0) * scale) as f32 + 2.0 * MARGIN;
        let middle = (0.5 * (across.0 + across.1), 0.5 * (along.0 + along.1));
        let height = height.ceil().clamp(MIN_HEIGHT, MAX_HEIGHT);
        Some(Self { right, up, eye, light: LIGHT.normalize(), middle, scale, height, left: 0.0, floor })
    }

    pub(crate) fn project(&self, point: Point3<f64>) -> PixelPoint {
        let x = (point.coords.dot(&self.right) - self.middle.0) * self.scale;
        let y = (point.coords.dot(&self.up) - self.middle.1) * self.scale;
        (self.left + 0.5 * WIDTH + x as f32, 0.5 * self.height - y as f32)
    }

    pub(crate) fn pixels(&self, length: f64) -> f32 {
        (length * self.scale) as f32
    }

    /// Depth of a point along the view; larger is nearer [m].
    pub(crate) fn depth(&self, point: Point3<f64>) -> f64 {
        point.coords.dot(&self.eye)
    }

    /// Lights a colour on a surface with this outward normal.
    pub(crate) fn shade(&self, color: [f64; 3], normal: Vector3<f64>) -> Color {
        let light = AMBIENT + (1.0 - AMBIENT) * normal.dot(&self.light).max(0.0);
        let [r, g, b] = color.map(|v| (255.0 * (v * light).clamp(0.0, 1.0)).round() as u8);
        Color(r, g, b)
    }
}

fn widen(range: &mut (f64, f64), value: f64, radius: f64) {
    *range = (range.0.min(value - radius), range.1.max(value + radius));
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::scene::SceneContent;
    use nalgebra::Isometry3;

    /// Height of the floor [m].
    const GROUND: f64 = -0.1;

    /// Scene of a robot at the origin and a ball at a distance.
    fn scene(distance: f64) -> SnapshotScene {
        let body = |frame: &str, height: f64, shape: SolidShape| {
            let pose = Isometry3::translation(0.0, 0.0, height);
            BodySolids { frame: frame.to_owned(), solids: vec![PlacedSolid { pose, shape, color: [0.5; 3] }] }
        };
        let bodies = vec![
            ("shank".to_owned(), body("world", 0.1, SolidShape::Rod { radius: 0.02, length: 0.3 })),
            ("ball".to_owned(), body("ball", 0.1, SolidShape::Ball { radius: 0.1 })),
            ("floor".to_owned(), body("world", GROUND, SolidShape::Floor)),
        ];
        let far = Point3::new(distance, 0.0, 0.1);
        let arrows = vec![(far, Point3::new(distance, 0.0, 0.2)), (Point3::origin(), Point3::new(0.0, 0.0, 0.05))];
        let mut frames = SnapshotCandidates::default();
        frames.set_poses(vec![("ball".to_owned(), Isometry3::translation(distance, 0.0, 0.0))]);
        let update = SceneContent { bodies, arrows, reference: Some(Point3::origin()), target: Some(far) };
        frames.add(0, update, ["ball"].into_iter(), Some((Point3::new(0.05, 0.0, 0.0), 0.0)), Vec::new());
        SnapshotScene::new(&frames, frames.choose(1)[0])
    }

    #[test]
    fn snapshot_scene_far_objects_are_left_out() {
        let (near, far, further) = (scene(0.3), scene(3.0), scene(300.0));
        assert_eq!([&near, &far, &further].map(|scene| scene.solids.len()), [2, 1, 1]);
        assert_eq!([&near, &far, &further].map(|scene| scene.arrows.len()), [2, 1, 1]);
        assert_eq!((near.target.is_some(), far.target, far.reference), (true, None, Some(Point3::origin())));
        assert_eq!(far.ground, Some(GROUND));
        let [near, far, further] = [near, far, further].map(|scene| View::around(&[scene]).unwrap());
        assert!(near.scale < far.scale, "{} px/m with the ball, {} without", near.scale, far.scale);
        assert_eq!((far.scale, far.height, far.floor), (further.scale, further.height, further.floor));
    }

    #[test]
    fn view_fits_scene_tightly() {
        let scenes = [scene(0.3), scene(-0.5)];
        let view = View::around(&scenes).unwrap();
        assert!((MIN_HEIGHT..=MAX_HEIGHT).contains(&view.height));
        let mut edges = (f32::MAX, f32::MIN);
        for solid in scenes.iter().flat_map(|scene| &scene.solids) {
            let (x, y) = view.project(solid.pose.translation.vector.into());
            assert!((0.0..WIDTH).contains(&x) && (0.0..view.height).contains(&y), "{x}, {y}");
        }
        let [(x0, x1), (y0, y1)] = view.floor;
        for (x, y) in [(x0, y0), (x1, y0), (x0, y1), (x1, y1)] {
            let (_, y) = view.project(Point3::new(x, y, GROUND));
            edges = (edges.0.min(y), edges.1.max(y));
        }
        // The floor is lowest.
        assert!((view.height - MARGIN - edges.1).abs() < 1.5, "{} of {}", edges.1, view.height);
    }
}
