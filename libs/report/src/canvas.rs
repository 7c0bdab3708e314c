//! Canvas for shapes and text on white, in pixels, y down.

use crate::color::Color;
use crate::error::ReportError;
use crate::label;
use ab_glyph::{Font, FontRef, GlyphId, OutlineCurve};
use tiny_skia::{FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Rect, Shader, Stroke, StrokeDash, Transform};

/// Point [px].
pub(crate) type PixelPoint = (f32, f32);

/// Size of a subscript and its distance below the line, relative to the size of the text.
const SUBSCRIPT: (f32, f32) = (0.72, 0.2);
/// Widening of the strokes, relative to the size of the text: the font is light.
const WEIGHT: f32 = 0.025;

/// Position of the given point in a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

/// Style of a line.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pen {
    pub(crate) color: Color,
    pub(crate) width: f32,
    pub(crate) dashed: bool,
}

impl Pen {
    pub(crate) const fn solid(color: Color, width: f32) -> Self {
        Self { color, width, dashed: false }
    }
}

/// Canvas of a picture.
pub(crate) struct Canvas {
    pixmap: Pixmap,
    /// Fonts by priority: the first with the glyph is used.
    fonts: [FontRef<'static>; 2],
}

impl Canvas {
    /// Creates a white canvas; errors name it `name`.
    pub(crate) fn new(name: &str, width: u32, height: u32) -> Result<Self, ReportError> {
        let failed = |cause: String| ReportError::Draw { figure: name.to_owned(), cause };
        let font = |bytes: &'static [u8]| FontRef::try_from_slice(bytes).map_err(|error| failed(error.to_string()));
        let fonts = [font(epaint_default_fonts::UBUNTU_LIGHT)?, font(epaint_default_fonts::HACK_REGULAR)?];
        let mut pixmap = Pixmap::new(width, height)
            .ok_or_else(|| failed(format!("found {width} x {height} pixels, expected a valid size")))?;
        pixmap.fill(tiny_skia::Color::WHITE);
        Ok(Self { pixmap, fonts })
    }

    pub(crate) fn width(&self) -> f32 {
        self.pixmap.width() as f32
    }

    /// Encodes the picture as PNG.
    pub(crate) fn png(&self, name: &str) -> Result<Vec<u8>, ReportError> {
        let failed = |cause: String| ReportError::Draw { figure: name.to_owned(), cause };
        self.pixmap.encode_png().map_err(|error| failed(error.to_string()))
    }

    /// Draws a line through points.
    pub(crate) fn line(&mut self, points: &[PixelPoint], pen: Pen) {
        let Some(path) = polyline(points, false) else { return };
        let dash = if pen.dashed { StrokeDash::new(vec![4.0 * pen.width, 3.0 * pen.width], 0.0) } else { None };
        let cap = if pen.dashed { LineCap::Butt } else { LineCap::Round };
        let stroke = Stroke { width: pen.width, line_cap: cap, line_join: LineJoin::Round, dash, ..Stroke::default() };
        self.pixmap.stroke_path(&path, &paint(pen.color, 255), &stroke, Transform::identity(), None);
    }

    /// Draws a filled polygon.
    pub(crate) fn polygon(&mut self, points: &[PixelPoint], color: Color, opacity: u8) {
        if let Some(path) = polyline(points, true) {
            self.pixmap.fill_path(&path, &paint(color, opacity), FillRule::Winding, Transform::identity(), None);
        }
    }

    /// Draws a filled rectangle.
    pub(crate) fn rectangle(&mut self, at: PixelPoint, size: PixelPoint, color: Color, opacity: u8) {
        if let Some(rect) = Rect::from_xywh(at.0, at.1, size.0, size.1) {
            self.pixmap.fill_rect(rect, &paint(color, opacity), Transform::identity(), None);
        }
    }

    /// Draws a filled circle.
    pub(crate) fn disc(&mut self, centre: PixelPoint, radius: f32, color: Color) {
        if let Some(path) = PathBuilder::from_circle(centre.0, centre.1, radius) {
            self.pixmap.fill_path(&path, &paint(color, 255), FillRule::Winding, Transform::identity(), None);
        }
    }

    /// Draws the outline of a circle.
    pub(crate) fn circle(&mut self, centre: PixelPoint, radius: f32, pen: Pen) {
        if let Some(path) = PathBuilder::from_circle(centre.0, centre.1, radius) {
            let stroke = Stroke { width: pen.width, ..Stroke::default() };
            self.pixmap.stroke_path(&path, &paint(pen.color, 255), &stroke, Transform::identity(), None);
        }
    }

    /// Width of a label with the font size `size` [px].
    pub(crate) fn text_width(&self, text: &str, size: f32) -> f32 {
        self.outlines(text, size).1
    }

    /// Draws a label with its base line through `at`.
    pub(crate) fn text(&mut self, at: PixelPoint, anchor: Anchor, size: f32, color: Color, text: &str) {
        let (path, width) = self.outlines(text, size);
        let transform = Transform::from_translate(at.0 - shift(anchor, width), at.1);
        self.fill_text(path, size, color, transform);
    }

    /// Draws an upward label with its middle at `at`.
    pub(crate) fn text_upwards(&mut self, at: PixelPoint, size: f32, color: Color, text: &str) {
        let (path, width) = self.outlines(text, size);
        // Right becomes up, and down becomes right.
        let transform = Transform::from_row(0.0, -1.0, 1.0, 0.0, at.0, at.1 + shift(Anchor::Middle, width));
        self.fill_text(path, size, color, transform);
    }

    fn fill_text(&mut self, path: Option<Path>, size: f32, color: Color, transform: Transform) {
        let Some(path) = path.and_then(|path| path.transform(transform)) else { return };
        let paint = paint(color, 255);
        self.pixmap.fill_path(&path, &paint, FillRule::Winding, Transform::identity(), None);
        let stroke = Stroke { width: WEIGHT * size, ..Stroke::default() };
        self.pixmap.stroke_path(&path, &paint, &stroke, Transform::identity(), None);
    }

    /// Outlines of a label from the origin, and its width.
    fn outlines(&self, text: &str, size: f32) -> (Option<Path>, f32) {
        let mut builder = PathBuilder::new();
        let mut x = 0.0;
        for part in label::parts(text) {
            let (size, y) = if part.subscript { (size * SUBSCRIPT.0, size * SUBSCRIPT.1) } else { (size, 0.0) };
            for c in part.text.chars() {
                let (font, id) = self.glyph(c);
                let scale = size / font.units_per_em().unwrap_or(1000.0);
                if let Some(outline) = font.outline(id) {
                    trace(&mut builder, &outline.curves, (x, y), scale);
                }
                x += font.h_advance_unscaled(id) * scale;
            }
        }
        (builder.finish(), x)
    }

    fn glyph(&self, c: char) -> (&FontRef<'static>, GlyphId) {
        let found = self.fonts.iter().map(|font| (font, font.glyph_id(c))).find(|(_, id)| id.0 != 0);
        found.unwrap_or_else(|| (&self.fonts[0], self.fonts[0].glyph_id('?')))
    }
}

/// Adds a glyph's curves, which are in units of the font, y up.
fn trace(builder: &mut PathBuilder, curves: &[OutlineCurve], at: PixelPoint, scale: f32) {
    let to_pixel = |p: &ab_glyph::Point| (at.0 + p.x * scale, at.1 - p.y * scale);
    let mut end = None;
    for curve in curves {
        let (OutlineCurve::Line(start, _) | OutlineCurve::Quad(start, ..) | OutlineCurve::Cubic(start, ..)) = curve;
        let start = to_pixel(start);
        if end != Some(start) {
            builder.move_to(start.0, start.1);
        }
        let stop = match curve {
            OutlineCurve::Line(_, p) => {
                let p = to_pixel(p);
                builder.line_to(p.0, p.1);
                p
            }
            OutlineCurve::Quad(_, a, p) => {
                let (a, p) = (to_pixel(a), to_pixel(p));
                builder.quad_to(a.0, a.1, p.0, p.1);
                p
            }
            OutlineCurve::Cubic(_, a, b, p) => {
                let (a, b, p) = (to_pixel(a), to_pixel(b), to_pixel(p));
                builder.cubic_to(a.0, a.1, b.0, b.1, p.0, p.1);
                p
            }
        };
        end = Some(stop);
    }
}

fn polyline(points: &[PixelPoint], closed: bool) -> Option<Path> {
    let mut builder = PathBuilder::with_capacity(points.len() + 1, points.len());
    let (first, rest) = points.split_first()?;
    builder.move_to(first.0, first.1);
    for point in rest {
        builder.line_to(point.0, point.1);
    }
    if closed {
        builder.close();
    }
    builder.finish()
}

fn paint(color: Color, opacity: u8) -> Paint<'static> {
    let color = tiny_skia::Color::from_rgba8(color.0, color.1, color.2, opacity);
    Paint { shader: Shader::SolidColor(color), ..Paint::default() }
}

fn shift(anchor: Anchor, width: f32) -> f32 {
    match anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => 0.5 * width,
        Anchor::End => width,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn canvas_has_glyph_for_every_character_of_figures() {
        let canvas = Canvas::new("test", 10, 10).unwrap();
        for c in "±°µ-–()0123456789.:xyzäé".chars() {
            assert_ne!(canvas.glyph(c).1, canvas.fonts[0].glyph_id('?'), "{c}");
        }
        assert!(canvas.text_width("F_{max}", 20.0) < canvas.text_width("Fmax", 20.0));
    }

    #[test]
    fn canvas_text_leaves_ink_at_its_position() {
        let mut canvas = Canvas::new("test", 100, 40).unwrap();
        canvas.text((50.0, 30.0), Anchor::Middle, 24.0, Color::INK, "HH");
        let dark = |x: u32| (0..40).any(|y| canvas.pixmap.pixel(x, y).is_some_and(|p| p.red() < 128));
        assert!((35..65).any(dark));
        assert!(!(0..25).any(dark) && !(75..100).any(dark));
    }
}
