//! Drawing of a figure as a picture.

use crate::canvas::{Anchor, Canvas, Pen};
use crate::color::Color;
use crate::error::ReportError;
use crate::figure::{Curve, Figure, MarkKind, Panel, PanelContent, Scale, Style, TimelineRow, pieces};
use crate::ticks::{TickMark, decades, linear};

/// Width of every picture [px].
pub(crate) const WIDTH: u32 = 1600;
/// Sizes of text [px].
const FONT: f32 = 22.0;
const HEADING: f32 = 30.0;
/// Heights of the heading, a panel's title, the numbers below a panel, and the label below the last panel [px].
const TOP: f32 = 64.0;
const ABOVE: f32 = 44.0;
const BELOW: f32 = 40.0;
const LABEL: f32 = 36.0;
/// Heights of curves over time, of a histogram, and of a timeline row [px].
const CURVES: f32 = 330.0;
const HISTOGRAM: f32 = 600.0;
const ROW: f32 = 34.0;
/// Smallest height of curves, relative to their natural height.
const MIN_STRETCH: f32 = 0.3;
/// Free space to the right, and between elements [px].
const MARGIN: f32 = 40.0;
const GAP: f32 = 12.0;
/// Longest name [characters].
const MAX_NAME_CHARS: usize = 36;

impl Figure {
    /// Draws the figure as PNG.
    ///
    /// # Errors
    /// [`ReportError::Draw`] if it cannot be drawn.
    pub fn png(&self) -> Result<Vec<u8>, ReportError> {
        draw(self, None)
    }
}

/// Draws a figure as PNG. A given `height` [px] is shared among its curves; otherwise, or if it is too small, the
/// natural or smallest height applies.
pub(crate) fn draw(figure: &Figure, height: Option<u32>) -> Result<Vec<u8>, ReportError> {
    let around = TOP + LABEL + figure.panels.len() as f32 * (ABOVE + BELOW);
    let natural: Vec<_> = figure.panels.iter().map(natural_height).collect();
    let rows: f32 = figure.panels.iter().zip(&natural).filter(|(panel, _)| is_timeline(panel)).map(|(_, height)| height).sum();
    let curves: f32 = natural.iter().sum::<f32>() - rows;
    // A lower bound for any requested height: flat curves are illegible, and rows have a fixed height.
    let minimum = around + rows + MIN_STRETCH * curves;
    let total = height.map_or(around + rows + curves, |height| (height as f32).max(minimum));
    let stretch = if height.is_some() && curves > 0.0 { (total - around - rows) / curves } else { 1.0 };
    let mut canvas = Canvas::new(figure.name, WIDTH, total.round() as u32)?;
    canvas.text((MARGIN, 44.0), Anchor::Start, HEADING, Color::INK, &figure.title);

    let times = figure.panels.iter().filter(|panel| panel.scale == Scale::Time).filter_map(Panel::x_range);
    let time = times.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or((0.0, 1.0));
    let axes: Vec<_> =
        figure.panels.iter().zip(&natural).map(|(panel, height)| Axes::new(panel, time, height * stretch)).collect();
    let left = figure.panels.iter().zip(&axes).map(|(panel, axes)| margin(&canvas, panel, axes)).fold(90.0, f32::max);
    let mut top = TOP;
    for (i, (panel, mut axes)) in figure.panels.iter().zip(axes).enumerate() {
        if is_timeline(panel) {
            axes.height = natural[i];
        }
        (axes.left, axes.right, axes.top) = (left, canvas.width() - MARGIN, top + ABOVE);
        heading(&mut canvas, panel, &axes, i == 0);
        grid(&mut canvas, panel, &axes);
        match &panel.content {
            _ if panel.is_empty() => {
                let note = figure.note.as_deref().unwrap_or("no data");
                let middle = (0.5 * (axes.left + axes.right), axes.top + 0.5 * axes.height);
                canvas.text(middle, Anchor::Middle, FONT, Color::GREY, note);
            }
            PanelContent::Curves { areas, curves } => {
                for area in areas {
                    for outline in area.outlines() {
                        let points: Vec<_> = outline.iter().map(|point| axes.to_pixel(*point)).collect();
                        canvas.polygon(&points, area.color, 70);
                    }
                }
                marks(&mut canvas, panel, &axes);
                for curve in curves {
                    draw_curve(&mut canvas, curve, &axes);
                }
            }
            PanelContent::Timelines(rows) => {
                marks(&mut canvas, panel, &axes);
                draw_rows(&mut canvas, rows, &axes);
            }
        }
        top = axes.bottom() + BELOW;
        if i + 1 == figure.panels.len() {
            let middle = (0.5 * (axes.left + axes.right), top + 22.0);
            canvas.text(middle, Anchor::Middle, FONT, Color::INK, &panel.x_label);
        }
    }
    canvas.png(figure.name)
}

/// Position and range of the axes of a panel.
struct Axes {
    left: f32,
    right: f32,
    top: f32,
    height: f32,
    x: (f64, f64),
    y: (f64, f64),
    scale: Scale,
}

impl Axes {
    fn new(panel: &Panel, time: (f64, f64), height: f32) -> Self {
        let nothing = if panel.scale == Scale::Time { (0.0, 1.0) } else { (0.7, 1000.0) };
        let (low, high) = panel.y_range().unwrap_or(nothing);
        let (x, y) = match panel.scale {
            Scale::Time => {
                let x = if time.1 > time.0 { time } else { (time.0, time.0 + 1e-3) };
                // A constant also needs an axis.
                let pad = if high > low { 0.06 * (high - low) } else { (0.1 * high.abs()).max(1e-3) };
                (x, (low - pad, high + pad))
            }
            Scale::Logarithmic => {
                let (from, to) = panel.x_range().unwrap_or((1.0, 1000.0));
                let power = |value: f64| 10_f64.powf(value);
                let x = (power(from.log10().floor()), power((to.log10() + 1e-9).ceil().max(from.log10().floor() + 1.0)));
                (x, (low.clamp(1e-3, 0.8), power(high.max(10.0).log10().ceil())))
            }
        };
        Self { left: 0.0, right: 1.0, top: 0.0, height, x, y, scale: panel.scale }
    }

    fn bottom(&self) -> f32 {
        self.top + self.height
    }

    fn share(&self, value: f64, (low, high): (f64, f64)) -> f32 {
        let share = match self.scale {
            Scale::Time => (value - low) / (high - low),
            Scale::Logarithmic => (value / low).log10() / (high / low).log10(),
        };
        share.clamp(0.0, 1.0) as f32
    }

    fn x_pixel(&self, x: f64) -> f32 {
        self.left + self.share(x, self.x) * (self.right - self.left)
    }

    fn y_pixel(&self, y: f64) -> f32 {
        self.bottom() - self.share(y, self.y) * self.height
    }

    fn to_pixel(&self, (x, y): (f64, f64)) -> (f32, f32) {
        (self.x_pixel(x), self.y_pixel(y))
    }

    fn x_ticks(&self) -> Vec<TickMark> {
        match self.scale {
            Scale::Time => linear(self.x.0, self.x.1, 12),
            Scale::Logarithmic => decades(self.x.0, self.x.1),
        }
    }

    fn y_ticks(&self) -> Vec<TickMark> {
        match self.scale {
            Scale::Time => linear(self.y.0, self.y.1, ((self.height / 60.0) as usize).clamp(2, 8)),
            Scale::Logarithmic => decades(self.y.0, self.y.1),
        }
    }
}

fn is_timeline(panel: &Panel) -> bool {
    matches!(panel.content, PanelContent::Timelines(_))
}

fn natural_height(panel: &Panel) -> f32 {
    match (&panel.content, panel.scale) {
        (PanelContent::Timelines(rows), _) => ROW * rows.len().max(2) as f32,
        (_, Scale::Logarithmic) => HISTOGRAM,
        _ => CURVES,
    }
}

/// Width of numbers, names and label to the left of the axes [px].
fn margin(canvas: &Canvas, panel: &Panel, axes: &Axes) -> f32 {
    match &panel.content {
        PanelContent::Timelines(rows) => {
            rows.iter().map(|row| canvas.text_width(&short(&row.name), FONT)).fold(0.0, f32::max) + MARGIN
        }
        PanelContent::Curves { .. } => {
            let numbers = axes.y_ticks().iter().map(|tick| canvas.text_width(&tick.text, FONT)).fold(0.0, f32::max);
            numbers + 2.0 * GAP + MARGIN + FONT
        }
    }
}

/// Draws the title to the left and the legend to the right.
fn heading(canvas: &mut Canvas, panel: &Panel, axes: &Axes, first: bool) {
    let line = axes.top - GAP;
    canvas.text((axes.left, line), Anchor::Start, FONT + 2.0, Color::INK, &panel.title);
    let mut entries = Vec::new();
    if let PanelContent::Curves { areas, curves } = &panel.content {
        entries.extend(areas.iter().map(|area| (area.name.as_str(), area.color, LegendKey::Area)));
        let named = curves.iter().filter(|curve| !curve.name.is_empty() && !curve.points.is_empty());
        entries.extend(named.map(|curve| (curve.name.as_str(), curve.color, LegendKey::Line(pen(curve)))));
    }
    if first {
        for kind in MarkKind::ALL {
            let mark = panel.marks.iter().find(|mark| mark.kind == kind);
            entries.extend(mark.map(|mark| (kind.name(), mark.color(), LegendKey::Mark)));
        }
    }
    let mut right = axes.right;
    let title = axes.left + canvas.text_width(&panel.title, FONT + 2.0) + MARGIN;
    for (name, color, key) in entries.into_iter().rev() {
        let name = short(name);
        let start = right - canvas.text_width(&name, FONT);
        if start - 60.0 < title {
            break;
        }
        canvas.text((start, line), Anchor::Start, FONT, Color::INK, &name);
        let (from, to, y) = (start - 52.0, start - GAP, line - 0.3 * FONT);
        match key {
            LegendKey::Area => canvas.rectangle((from, y - 9.0), (to - from, 18.0), color, 90),
            LegendKey::Line(pen) => canvas.line(&[(from, y), (to, y)], Pen { width: pen.width + 1.0, ..pen }),
            LegendKey::Mark => canvas.line(&[(to - 10.0, y - 12.0), (to - 10.0, y + 12.0)], Pen::solid(color, 2.0)),
        }
        right = from - 1.5 * GAP;
    }
}

#[derive(Clone, Copy)]
enum LegendKey {
    Area,
    Line(Pen),
    Mark,
}

fn grid(canvas: &mut Canvas, panel: &Panel, axes: &Axes) {
    let (left, right, top, bottom) = (axes.left, axes.right, axes.top, axes.bottom());
    let thin = Pen::solid(Color::LIGHT, 1.0);
    for tick in axes.x_ticks() {
        let x = axes.x_pixel(tick.value);
        canvas.line(&[(x, top), (x, bottom)], thin);
        canvas.text((x, bottom + FONT + 6.0), Anchor::Middle, FONT, Color::INK, &tick.text);
    }
    if !is_timeline(panel) {
        for tick in axes.y_ticks() {
            let y = axes.y_pixel(tick.value);
            canvas.line(&[(left, y), (right, y)], thin);
            canvas.text((left - GAP, y + 0.35 * FONT), Anchor::End, FONT, Color::INK, &tick.text);
        }
        canvas.text_upwards((MARGIN, 0.5 * (top + bottom)), FONT, Color::INK, &panel.y_label);
    }
    canvas.line(&[(left, top), (left, bottom), (right, bottom)], Pen::solid(Color::INK, 1.5));
}

fn marks(canvas: &mut Canvas, panel: &Panel, axes: &Axes) {
    for mark in panel.marks.iter().filter(|mark| (axes.x.0..=axes.x.1).contains(&mark.time_s)) {
        let x = axes.x_pixel(mark.time_s);
        let pen = Pen { color: mark.color(), width: 1.5, dashed: mark.kind != MarkKind::Fault };
        canvas.line(&[(x, axes.top), (x, axes.bottom())], pen);
    }
}

/// Draws a curve with its gaps.
fn draw_curve(canvas: &mut Canvas, curve: &Curve, axes: &Axes) {
    let (path, pen) = (curve.path(), pen(curve));
    for piece in pieces(&path) {
        let points: Vec<_> = piece.iter().map(|point| axes.to_pixel(*point)).collect();
        match points.as_slice() {
            // A line through a single point would be invisible.
            [point] => canvas.disc(*point, 0.5 * pen.width, pen.color),
            points => canvas.line(points, pen),
        }
    }
}

fn draw_rows(canvas: &mut Canvas, rows: &[TimelineRow], axes: &Axes) {
    for (i, row) in rows.iter().enumerate() {
        let top = axes.top + ROW * i as f32;
        let name = short(&row.name);
        canvas.text((axes.left - GAP, top + 0.5 * ROW + 0.35 * FONT), Anchor::End, FONT, Color::INK, &name);
        for (from, to) in &row.spans {
            let (from, to) = (axes.x_pixel(*from), axes.x_pixel(*to));
            // Wide enough to be visible.
            canvas.rectangle((from, top + 5.0), ((to - from).max(1.5), ROW - 10.0), row.color, 255);
        }
    }
}

fn pen(curve: &Curve) -> Pen {
    match curve.style {
        Style::Line => Pen::solid(curve.color, 2.5),
        Style::Wide => Pen::solid(curve.color, 7.0),
        Style::DashedSteps => Pen { color: curve.color, width: 2.5, dashed: true },
    }
}

/// Shortens a name to [`MAX_NAME_CHARS`] characters.
fn short(name: &str) -> String {
    if name.chars().count() <= MAX_NAME_CHARS {
        return name.to_owned();
    }
    name.chars().take(MAX_NAME_CHARS - 1).chain(['…']).collect()
}
