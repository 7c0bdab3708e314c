//! Scene and projection of the snapshots: the robot and the objects near it.

use crate::canvas::Spot;
use crate::figure::Color;
use crate::frames::{Frame, Frames};
use crate::geometry::{Pose, Vector, cross, dot, unit};
use crate::scene::{Body, Solid, SolidShape};

/// Width of one snapshot, and its smallest and largest height [px].
pub(crate) const WIDTH: f32 = 400.0;
const LEAST_HEIGHT: f32 = 160.0;
const LARGEST_HEIGHT: f32 = 640.0;
const MARGIN: f32 = 24.0;
/// Direction from the scene to the eye, world frame.
const EYE: Vector = [0.5, -1.0, 0.38];
/// Direction from the scene to the light, world frame.
const LIGHT: Vector = [-0.35, -0.7, 0.9];
/// Share of ambient light.
pub(crate) const AMBIENT: f64 = 0.55;
/// Largest horizontal distance of a visible object from the robot [m].
const NEAR_M: f64 = 0.6;
/// Margin of the floor around the scene [m].
const FLOOR_AROUND_M: f64 = 0.08;
/// Radius of the marks at reference and target [m].
const MARK_M: f64 = 0.02;

/// Scene of a snapshot.
#[derive(Debug)]
pub(crate) struct SnapshotScene {
    /// Robot and objects without the floor, world frame.
    pub(crate) solids: Vec<Solid>,
    /// Height of the floor [m].
    pub(crate) ground: Option<f64>,
    /// Contact forces: from and to [m].
    pub(crate) arrows: Vec<(Vector, Vector)>,
    pub(crate) reference: Option<Vector>,
    pub(crate) target: Option<Vector>,
}

impl SnapshotScene {
    /// Selects the robot and the objects near its bodies or its foot.
    pub(crate) fn new(frames: &Frames, frame: &Frame) -> Self {
        let placed = |body: &Body| {
            // A body without a pose is fixed.
            let pose = frame.poses.get(&body.frame).copied().unwrap_or(Pose::WORLD);
            body.solids.iter().map(|solid| Solid { pose: pose.pose(&solid.pose), ..*solid }).collect::<Vec<_>>()
        };
        let (objects, others): (Vec<_>, Vec<_>) = frames.bodies.iter().partition(|(name, _)| frames.objects.contains(*name));
        let (floors, mut solids): (Vec<_>, Vec<_>) =
            others.into_iter().flat_map(|(_, body)| placed(body)).partition(|solid| solid.shape == SolidShape::Floor);
        let anchors: Vec<_> = solids.iter().map(|solid| solid.pose.position).chain(frame.foot).collect();
        let near = |point: &Vector| {
            anchors.is_empty() || anchors.iter().any(|anchor| (point[0] - anchor[0]).hypot(point[1] - anchor[1]) <= NEAR_M)
        };
        for object in objects.into_iter().map(|(_, body)| placed(body)) {
            if object.iter().any(|solid| near(&solid.pose.position)) {
                solids.extend(object);
            }
        }
        Self {
            solids,
            ground: floors.last().map(|floor| floor.pose.position[2]),
            arrows: frame.arrows.iter().filter(|(from, _)| near(from)).copied().collect(),
            reference: frame.reference.filter(near),
            target: frame.target.filter(near),
        }
    }
}

/// Projection from the world to the picture, without perspective.
#[derive(Debug)]
pub(crate) struct View {
    pub(crate) right: Vector,
    pub(crate) up: Vector,
    pub(crate) eye: Vector,
    pub(crate) light: Vector,
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
        let eye = unit(EYE);
        let right = unit(cross([0.0, 0.0, 1.0], eye));
        let up = cross(eye, right);
        let (mut across, mut along) = ((f64::MAX, f64::MIN), (f64::MAX, f64::MIN));
        let mut floor = [across, across];
        let mut include = |centre: Vector, radius: f64| {
            widen(&mut across, dot(centre, right), radius);
            widen(&mut along, dot(centre, up), radius);
            widen(&mut floor[0], centre[0], radius);
            widen(&mut floor[1], centre[1], radius);
        };
        for solid in scenes.iter().flat_map(|scene| &scene.solids) {
            match solid.shape {
                SolidShape::Ball { radius } => include(solid.pose.position, radius),
                SolidShape::Rod { radius, length } => {
                    let reach = (0.5 * length - radius).max(0.0);
                    for end in [-reach, reach] {
                        include(solid.pose.point([0.0, 0.0, end]), radius);
                    }
                }
                SolidShape::Block { size } => {
                    for corner in 0..8_usize {
                        let sign = |bit: usize| if (corner >> bit) & 1 == 0 { -0.5 } else { 0.5 };
                        include(solid.pose.point([sign(0) * size[0], sign(1) * size[1], sign(2) * size[2]]), 0.0);
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
            for corner in [[x0, y0, height], [x1, y0, height], [x0, y1, height], [x1, y1, height]] {
                widen(&mut across, dot(corner, right), 0.0);
                widen(&mut along, dot(corner, up), 0.0);
            }
        }
        let (wide, high) = (f64::from(WIDTH - 2.0 * MARGIN), f64::from(LARGEST_HEIGHT - 2.0 * MARGIN));
        let scale = (wide / (across.1 - across.0)).min(high / (along.1 - along.0));
        let height = ((along.1 - along.0) * scale) as f32 + 2.0 * MARGIN;
        let middle = (0.5 * (across.0 + across.1), 0.5 * (along.0 + along.1));
        let height = height.ceil().clamp(LEAST_HEIGHT, LARGEST_HEIGHT);
        Some(Self { right, up, eye, light: unit(LIGHT), middle, scale, height, left: 0.0, floor })
    }

    pub(crate) fn spot(&self, point: Vector) -> Spot {
        let x = (dot(point, self.right) - self.middle.0) * self.scale;
        let y = (dot(point, self.up) - self.middle.1) * self.scale;
        (self.left + 0.5 * WIDTH + x as f32, 0.5 * self.height - y as f32)
    }

    pub(crate) fn pixels(&self, length: f64) -> f32 {
        (length * self.scale) as f32
    }

    /// Depth of a point along the view; larger is nearer [m].
    pub(crate) fn depth(&self, point: Vector) -> f64 {
        dot(point, self.eye)
    }

    /// Lights a colour on a surface with this outward normal.
    pub(crate) fn lit(&self, color: [f64; 3], normal: Vector) -> Color {
        let light = AMBIENT + (1.0 - AMBIENT) * dot(normal, self.light).max(0.0);
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
    use crate::scene::Update;

    /// Height of the floor [m].
    const GROUND: f64 = -0.1;

    /// Scene of a robot at the origin and a ball at a distance.
    fn scene(distance: f64) -> SnapshotScene {
        let body = |frame: &str, height: f64, shape: SolidShape| {
            let pose = Pose { position: [0.0, 0.0, height], ..Pose::WORLD };
            Body { frame: frame.to_owned(), solids: vec![Solid { pose, shape, color: [0.5; 3] }] }
        };
        let bodies = vec![
            ("shank".to_owned(), body("world", 0.1, SolidShape::Rod { radius: 0.02, length: 0.3 })),
            ("ball".to_owned(), body("ball", 0.1, SolidShape::Ball { radius: 0.1 })),
            ("floor".to_owned(), body("world", GROUND, SolidShape::Floor)),
        ];
        let far = [distance, 0.0, 0.1];
        let arrows = vec![(far, [distance, 0.0, 0.2]), ([0.0; 3], [0.0, 0.0, 0.05])];
        let mut frames = Frames::default();
        frames.set_poses(vec![("ball".to_owned(), Pose { position: [distance, 0.0, 0.0], ..Pose::WORLD })]);
        let update = Update { bodies, arrows, reference: Some([0.0; 3]), target: Some(far) };
        frames.add(0, update, ["ball"].into_iter(), Some(([0.05, 0.0, 0.0], 0.0)), Vec::new());
        SnapshotScene::new(&frames, frames.choose(1)[0])
    }

    #[test]
    fn snapshot_scene_far_objects_are_left_out() {
        let (near, far, further) = (scene(0.3), scene(3.0), scene(300.0));
        assert_eq!([&near, &far, &further].map(|scene| scene.solids.len()), [2, 1, 1]);
        assert_eq!([&near, &far, &further].map(|scene| scene.arrows.len()), [2, 1, 1]);
        assert_eq!((near.target.is_some(), far.target, far.reference), (true, None, Some([0.0; 3])));
        assert_eq!(far.ground, Some(GROUND));
        let [near, far, further] = [near, far, further].map(|scene| View::around(&[scene]).unwrap());
        assert!(near.scale < far.scale, "{} px/m with the ball, {} without", near.scale, far.scale);
        assert_eq!((far.scale, far.height, far.floor), (further.scale, further.height, further.floor));
    }

    #[test]
    fn view_fits_scene_tightly() {
        let scenes = [scene(0.3), scene(-0.5)];
        let view = View::around(&scenes).unwrap();
        assert!((LEAST_HEIGHT..=LARGEST_HEIGHT).contains(&view.height));
        let mut edges = (f32::MAX, f32::MIN);
        for solid in scenes.iter().flat_map(|scene| &scene.solids) {
            let (x, y) = view.spot(solid.pose.position);
            assert!((0.0..WIDTH).contains(&x) && (0.0..view.height).contains(&y), "{x}, {y}");
        }
        let [(x0, x1), (y0, y1)] = view.floor;
        for corner in [[x0, y0], [x1, y0], [x0, y1], [x1, y1]] {
            let (_, y) = view.spot([corner[0], corner[1], GROUND]);
            edges = (edges.0.min(y), edges.1.max(y));
        }
        // The floor is lowest.
        assert!((view.height - MARGIN - edges.1).abs() < 1.5, "{} of {}", edges.1, view.height);
    }
}
