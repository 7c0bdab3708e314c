//! Snapshots of robot and objects at selected times, side by side.

use crate::canvas::{Anchor, Canvas, Pen, PixelPoint};
use crate::color::Color;
use crate::error::ReportError;
use crate::frames::SnapshotCandidates;
use crate::scene::{PlacedSolid, SolidShape};
use crate::seconds;
use crate::view::{AMBIENT, SnapshotScene, View, WIDTH};
use nalgebra::{Point3, Vector3, center};

/// Number of snapshots.
pub const SNAPSHOTS: usize = 5;

/// Height of the caption below a snapshot, and size of its text [px].
const CAPTION: f32 = 84.0;
const FONT: f32 = 21.0;
/// Largest patch of a box face [m]: patches make the order in depth right for parts of a face.
const PATCH_M: f64 = 0.04;
const MAX_PATCHES: usize = 10;
/// Strips across a rod, and discs of a ball, for their shading.
const STRIPS: usize = 9;
/// Spacing of the floor's lines [m], and their largest number: on a larger floor the spacing is wider.
const GRID_M: f64 = 0.05;
const MAX_LINES: f64 = 60.0;

/// Times of the snapshots [s] and their reasons.
pub(crate) fn times(frames: &SnapshotCandidates) -> Vec<(f64, String)> {
    frames.choose(SNAPSHOTS).into_iter().map(|frame| (seconds(frame.tick), frame.reason.clone())).collect()
}

/// Draws the snapshots side by side, as PNG; `None` if the scene is empty.
pub(crate) fn draw(frames: &SnapshotCandidates) -> Result<Option<Vec<u8>>, ReportError> {
    let chosen = frames.choose(SNAPSHOTS);
    let scenes: Vec<_> = chosen.iter().map(|frame| SnapshotScene::new(frames, frame)).collect();
    let Some(mut view) = View::around(&scenes) else { return Ok(None) };
    let mut canvas = Canvas::new("snapshots", WIDTH as u32 * SNAPSHOTS as u32, (view.height + CAPTION) as u32)?;
    for (i, (frame, scene)) in chosen.iter().zip(&scenes).enumerate() {
        view.left = WIDTH * i as f32;
        snapshot(&mut canvas, &view, scene);
        let middle = view.left + 0.5 * WIDTH;
        let time = format!("t = {:.2} s", seconds(frame.tick));
        canvas.text((middle, view.height + 26.0), Anchor::Middle, FONT + 3.0, Color::INK, &time);
        let reason: String = frame.reason.chars().take(34).collect();
        canvas.text((middle, view.height + 58.0), Anchor::Middle, FONT, Color::GREY, &reason);
    }
    canvas.png("snapshots").map(Some)
}

/// Drawing primitive with a single depth.
enum Primitive {
    Patch { corners: Vec<Point3<f64>>, color: Color },
    Edge { ends: [Point3<f64>; 2], color: Color },
    Ball { centre: Point3<f64>, radius: f64, color: [f64; 3] },
}

fn snapshot(canvas: &mut Canvas, view: &View, scene: &SnapshotScene) {
    if let Some(height) = scene.ground {
        floor(canvas, view, height);
    }
    let mut primitives = Vec::new();
    for solid in &scene.solids {
        match solid.shape {
            SolidShape::Ball { radius } => ball(&mut primitives, view, solid.pose.translation.vector.into(), radius, solid.color),
            SolidShape::Rod { radius, length } => rod(&mut primitives, view, solid, radius, length),
            SolidShape::Block { size } => block(&mut primitives, view, solid, size),
            SolidShape::Floor => {}
        }
    }
    // From back to front; primitives of equal depth keep their order.
    primitives.sort_by(|a: &(f64, Primitive), b| a.0.total_cmp(&b.0));
    for (_, primitive) in &primitives {
        match primitive {
            Primitive::Patch { corners, color } => {
                let points: Vec<_> = corners.iter().map(|corner| view.project(*corner)).collect();
                canvas.polygon(&points, *color, 255);
                // Closes the seams between patches.
                let closed: Vec<_> = points.iter().chain(points.first()).copied().collect();
                canvas.line(&closed, Pen::solid(*color, 0.8));
            }
            Primitive::Edge { ends, color } => canvas.line(&ends.map(|end| view.project(end)), Pen::solid(*color, 1.5)),
            Primitive::Ball { centre, radius, color } => shaded(canvas, view, *centre, *radius, *color),
        }
    }
    if let Some(target) = scene.target {
        canvas.circle(view.project(target), 9.0, Pen::solid(Color::BLUE, 3.0));
    }
    if let Some(reference) = scene.reference {
        canvas.disc(view.project(reference), 5.0, Color::GREEN);
    }
    for (from, to) in &scene.arrows {
        arrow(canvas, view.project(*from), view.project(*to));
    }
}

/// Draws the floor with its lines, below the scene.
fn floor(canvas: &mut Canvas, view: &View, height: f64) {
    let width = view.floor.iter().map(|(low, high)| high - low).fold(0.0, f64::max);
    let mut spacing = GRID_M;
    while width > MAX_LINES * spacing {
        spacing *= 2.0;
    }
    let ends = view.floor.map(|(low, high)| ((low / spacing).ceil() as i64, (high / spacing).floor() as i64));
    let [(x0, x1), (y0, y1)] = ends;
    let point = |x: i64, y: i64| view.project(Point3::new(x as f64 * spacing, y as f64 * spacing, height));
    canvas.polygon(&[point(x0, y0), point(x1, y0), point(x1, y1), point(x0, y1)], Color(246, 245, 240), 255);
    let pen = Pen::solid(Color(214, 212, 204), 1.0);
    for x in x0..=x1 {
        canvas.line(&[point(x, y0), point(x, y1)], pen);
    }
    for y in y0..=y1 {
        canvas.line(&[point(x0, y), point(x1, y)], pen);
    }
}

fn ball(primitives: &mut Vec<(f64, Primitive)>, view: &View, centre: Point3<f64>, radius: f64, color: [f64; 3]) {
    primitives.push((view.depth(centre), Primitive::Ball { centre, radius, color }));
}

/// Makes a rod along z with rounded ends: strips across it, and a ball at each end.
fn rod(primitives: &mut Vec<(f64, Primitive)>, view: &View, solid: &PlacedSolid, radius: f64, length: f64) {
    let reach = 0.5 * length - radius;
    if reach <= 0.0 {
        ball(primitives, view, solid.pose.translation.vector.into(), radius, solid.color);
        return;
    }
    let [from, to] = [-reach, reach].map(|z| solid.pose * Point3::new(0.0, 0.0, z));
    ball(primitives, view, from, radius, solid.color);
    ball(primitives, view, to, radius, solid.color);
    let axis = solid.pose * Vector3::z();
    let Some(side) = axis.cross(&view.eye).try_normalize(1e-6) else { return };
    let towards = side.cross(&axis);
    let segments = ((2.0 * reach / PATCH_M).ceil() as usize).clamp(1, MAX_PATCHES);
    let along = |i: usize| from + axis * (2.0 * reach * i as f64 / segments as f64);
    let across = |j: usize| -1.0 + 2.0 * j as f64 / STRIPS as f64;
    for i in 0..segments {
        let (a, b) = (along(i), along(i + 1));
        let depth = 0.5 * (view.depth(a) + view.depth(b));
        for j in 0..STRIPS {
            let middle = 0.5 * (across(j) + across(j + 1));
            let normal = side * middle + towards * (1.0 - middle * middle).max(0.0).sqrt();
            let edge = |end: Point3<f64>, j: usize| end + side * (radius * across(j));
            let corners = vec![edge(a, j), edge(b, j), edge(b, j + 1), edge(a, j + 1)];
            primitives.push((depth, Primitive::Patch { corners, color: view.shade(solid.color, normal) }));
        }
    }
}

/// Makes the visible faces of a box, in patches, and their edges.
fn block(primitives: &mut Vec<(f64, Primitive)>, view: &View, solid: &PlacedSolid, size: Vector3<f64>) {
    for (axis, edge) in size.iter().enumerate() {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let patches = |width: f64| ((width / PATCH_M).ceil() as usize).clamp(1, MAX_PATCHES);
        let (columns, rows) = (patches(size[u]), patches(size[v]));
        for sign in [-1.0, 1.0] {
            let mut outward = Vector3::zeros();
            outward[axis] = sign;
            let normal = solid.pose * outward;
            if normal.dot(&view.eye) <= 0.0 {
                continue;
            }
            let color = view.shade(solid.color, normal);
            let dark = view.shade(solid.color.map(|c| 0.55 * c), normal);
            let corner = |i: usize, j: usize| {
                let mut point = Point3::origin();
                point[axis] = 0.5 * sign * edge;
                point[u] = size[u] * (i as f64 / columns as f64 - 0.5);
                point[v] = size[v] * (j as f64 / rows as f64 - 0.5);
                solid.pose * point
            };
            for i in 0..columns {
                for j in 0..rows {
                    let corners = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                    let depth = view.depth(center(&corners[0], &corners[2]));
                    let outer = [j == 0, i + 1 == columns, j + 1 == rows, i == 0];
                    primitives.push((depth, Primitive::Patch { corners: corners.to_vec(), color }));
                    for (k, _) in outer.into_iter().enumerate().filter(|(_, outer)| *outer) {
                        let ends = [corners[k], corners[(k + 1) % 4]];
                        // In front of the neighbouring patches, which would cover half of it.
                        primitives.push((depth + 1e-3, Primitive::Edge { ends, color: dark }));
                    }
                }
            }
        }
    }
}

/// Draws a ball as discs, each smaller, brighter and further towards the light.
fn shaded(canvas: &mut Canvas, view: &View, centre: Point3<f64>, radius: f64, color: [f64; 3]) {
    // Direction of the light in the picture's plane.
    let light = (view.light.dot(&view.right), view.light.dot(&view.up));
    let (x, y) = view.project(centre);
    let radius = view.pixels(radius);
    for i in 0..STRIPS {
        let share = i as f64 / STRIPS as f64;
        let shift = 0.55 * share as f32 * radius;
        let bright = AMBIENT + (1.0 - AMBIENT) * share;
        let [r, g, b] = color.map(|v| (255.0 * (v * bright).clamp(0.0, 1.0)).round() as u8);
        let at = (x + light.0 as f32 * shift, y - light.1 as f32 * shift);
        canvas.disc(at, radius * (1.0 - 0.9 * share as f32), Color(r, g, b));
    }
}

/// Draws a force, always in front.
fn arrow(canvas: &mut Canvas, from: PixelPoint, to: PixelPoint) {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let length = dx.hypot(dy);
    if !(length > 1.0 && length.is_finite()) {
        return;
    }
    let (dx, dy) = (dx / length, dy / length);
    let head = length.min(14.0);
    let neck = (to.0 - head * dx, to.1 - head * dy);
    let half = 0.45 * head;
    canvas.line(&[from, neck], Pen::solid(Color::VERMILLION, 4.0));
    let corners = [to, (neck.0 - half * dy, neck.1 + half * dx), (neck.0 + half * dy, neck.1 - half * dx)];
    canvas.polygon(&corners, Color::VERMILLION, 255);
}
