//! What snapshots show of a moment, and from where: the robot, and what is near it.

use crate::canvas::Spot;
use crate::figure::Color;
use crate::frames::{Frame, Frames};
use crate::geometry::{Pose, Vector, cross, dot, unit};
use crate::scene::{Body, Form, Solid};

/// Width of one snapshot, and its least and largest height, px.
pub(crate) const WIDTH: f32 = 400.0;
const LEAST_HEIGHT: f32 = 160.0;
const LARGEST_HEIGHT: f32 = 640.0;
const MARGIN: f32 = 24.0;
/// From the scene to the eye: to the right of the x axis's back, and from above.
const EYE: Vector = [0.5, -1.0, 0.38];
/// From the scene to the light.
const LIGHT: Vector = [-0.35, -0.7, 0.9];
/// Share of the light that is everywhere.
pub(crate) const AMBIENT: f64 = 0.55;
/// An object is shown as long as it is no further than this from the robot, measured along the ground, m.
const NEAR_M: f64 = 0.6;
/// How far the floor is drawn around what stands on it, m.
const FLOOR_AROUND_M: f64 = 0.08;
/// Radius of the marks at reference and target, m, for which there must be room.
const MARK_M: f64 = 0.02;

/// What is shown of a moment.
#[derive(Debug)]
pub(crate) struct Sight {
    /// Robot and objects, in the world; no floor.
    pub(crate) solids: Vec<Solid>,
    /// Height of the floor, m.
    pub(crate) ground: Option<f64>,
    /// Contact forces: from and to, m.
    pub(crate) arrows: Vec<(Vector, Vector)>,
    pub(crate) reference: Option<Vector>,
    pub(crate) target: Option<Vector>,
}

impl Sight {
    /// The robot, and whatever else is near its bodies or its foot.
    pub(crate) fn new(frames: &Frames, frame: &Frame) -> Self {
        let placed = |body: &Body| {
            // What has no pose of its own stands still.
            let pose = frame.poses.get(&body.frame).copied().unwrap_or(Pose::WORLD);
            body.solids.iter().map(|solid| Solid { pose: pose.pose(&solid.pose), ..*solid }).collect::<Vec<_>>()
        };
        let (objects, others): (Vec<_>, Vec<_>) = frames.bodies.iter().partition(|(name, _)| frames.objects.contains(*name));
        let (floors, mut solids): (Vec<_>, Vec<_>) =
            others.into_iter().flat_map(|(_, body)| placed(body)).partition(|solid| solid.form == Form::Floor);
        let anchors: Vec<_> = solids.iter().map(|solid| solid.pose.position).chain(frame.foot).collect();
        let near = |place: &Vector| {
            anchors.is_empty() || anchors.iter().any(|anchor| (place[0] - anchor[0]).hypot(place[1] - anchor[1]) <= NEAR_M)
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

/// From the world to the picture, without perspective.
#[derive(Debug)]
pub(crate) struct View {
    pub(crate) right: Vector,
    pub(crate) up: Vector,
    pub(crate) eye: Vector,
    pub(crate) light: Vector,
    /// What is in the middle, in the picture's plane, m.
    middle: (f64, f64),
    /// px per m.
    scale: f64,
    /// Height of a snapshot, px.
    pub(crate) height: f32,
    /// Left edge of the snapshot, px.
    pub(crate) left: f32,
    /// Where the floor is drawn: least and largest x and y, m.
    pub(crate) floor: [(f64, f64); 2],
}

impl View {
    /// The same view for all snapshots, in which all of them have room and none to spare; `None` if there is nothing to see.
    pub(crate) fn around(sights: &[Sight]) -> Option<Self> {
        let eye = unit(EYE);
        let right = unit(cross([0.0, 0.0, 1.0], eye));
        let up = cross(eye, right);
        let (mut across, mut along) = ((f64::MAX, f64::MIN), (f64::MAX, f64::MIN));
        let mut floor = [across, across];
        let mut room = |centre: Vector, radius: f64| {
            widen(&mut across, dot(centre, right), radius);
            widen(&mut along, dot(centre, up), radius);
            widen(&mut floor[0], centre[0], radius);
            widen(&mut floor[1], centre[1], radius);
        };
        for solid in sights.iter().flat_map(|sight| &sight.solids) {
            match solid.form {
                Form::Ball { radius } => room(solid.pose.position, radius),
                Form::Rod { radius, length } => {
                    let reach = (0.5 * length - radius).max(0.0);
                    for end in [-reach, reach] {
                        room(solid.pose.point([0.0, 0.0, end]), radius);
                    }
                }
                Form::Block { size } => {
                    for corner in 0..8_usize {
                        let sign = |bit: usize| if (corner >> bit) & 1 == 0 { -0.5 } else { 0.5 };
                        room(solid.pose.point([sign(0) * size[0], sign(1) * size[1], sign(2) * size[2]]), 0.0);
                    }
                }
                Form::Floor => {}
            }
        }
        for sight in sights {
            for mark in [sight.reference, sight.target].into_iter().flatten() {
                room(mark, MARK_M);
            }
            for (from, to) in &sight.arrows {
                room(*from, 0.0);
                room(*to, 0.0);
            }
        }
        if !(across.1 > across.0 && along.1 > along.0) {
            return None;
        }
        if let Some(height) = sights.iter().find_map(|sight| sight.ground) {
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

    /// Nearer is larger.
    pub(crate) fn depth(&self, point: Vector) -> f64 {
        dot(point, self.eye)
    }

    /// A colour in the light, on a surface with this outward normal.
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

    /// Height of the floor, m.
    const GROUND: f64 = -0.1;

    /// What is seen of a robot at the origin and a ball so far away from it.
    fn sight(distance: f64) -> Sight {
        let body = |frame: &str, height: f64, form: Form| {
            let pose = Pose { position: [0.0, 0.0, height], ..Pose::WORLD };
            Body { frame: frame.to_owned(), solids: vec![Solid { pose, form, color: [0.5; 3] }] }
        };
        let bodies = vec![
            ("shank".to_owned(), body("world", 0.1, Form::Rod { radius: 0.02, length: 0.3 })),
            ("ball".to_owned(), body("ball", 0.1, Form::Ball { radius: 0.1 })),
            ("floor".to_owned(), body("world", GROUND, Form::Floor)),
        ];
        let far = [distance, 0.0, 0.1];
        let arrows = vec![(far, [distance, 0.0, 0.2]), ([0.0; 3], [0.0, 0.0, 0.05])];
        let mut frames = Frames::default();
        frames.moved(vec![("ball".to_owned(), Pose { position: [distance, 0.0, 0.0], ..Pose::WORLD })]);
        let update = Update { bodies, arrows, reference: Some([0.0; 3]), target: Some(far) };
        frames.shown(0, update, ["ball"].into_iter(), Some(([0.05, 0.0, 0.0], 0.0)), Vec::new());
        Sight::new(&frames, frames.choose(1)[0])
    }

    #[test]
    fn what_is_far_from_the_robot_is_not_shown_and_takes_no_room() {
        let (near, far, further) = (sight(0.3), sight(3.0), sight(300.0));
        assert_eq!([&near, &far, &further].map(|sight| sight.solids.len()), [2, 1, 1]);
        assert_eq!([&near, &far, &further].map(|sight| sight.arrows.len()), [2, 1, 1]);
        assert_eq!((near.target.is_some(), far.target, far.reference), (true, None, Some([0.0; 3])));
        assert_eq!(far.ground, Some(GROUND));
        let [near, far, further] = [near, far, further].map(|sight| View::around(&[sight]).unwrap());
        assert!(near.scale < far.scale, "{} px/m with the ball, {} without", near.scale, far.scale);
        assert_eq!((far.scale, far.height, far.floor), (further.scale, further.height, further.floor));
    }

    #[test]
    fn everything_shown_is_inside_and_no_height_is_left_over() {
        let sights = [sight(0.3), sight(-0.5)];
        let view = View::around(&sights).unwrap();
        assert!((LEAST_HEIGHT..=LARGEST_HEIGHT).contains(&view.height));
        let mut edges = (f32::MAX, f32::MIN);
        for solid in sights.iter().flat_map(|sight| &sight.solids) {
            let (x, y) = view.spot(solid.pose.position);
            assert!((0.0..WIDTH).contains(&x) && (0.0..view.height).contains(&y), "{x}, {y}");
        }
        let [(x0, x1), (y0, y1)] = view.floor;
        for corner in [[x0, y0], [x1, y0], [x0, y1], [x1, y1]] {
            let (_, y) = view.spot([corner[0], corner[1], GROUND]);
            edges = (edges.0.min(y), edges.1.max(y));
        }
        // The floor is the lowest of all.
        assert!((view.height - MARGIN - edges.1).abs() < 1.5, "{} of {}", edges.1, view.height);
    }
}
