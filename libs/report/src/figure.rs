//! Content of a figure, independent of its drawing: pictures and page show the same.

pub use crate::color::Color;

/// Figure: a column of panels.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Name of the file, without the extension.
    pub name: &'static str,
    /// Heading.
    pub title: String,
    /// Panels, from top to bottom.
    pub panels: Vec<Panel>,
    /// Note for the reader.
    pub note: Option<String>,
}

/// Pair of axes and their content. In labels `x_{d}` has a subscript.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Title.
    pub title: String,
    /// Quantity and unit of the horizontal axis.
    pub x_label: String,
    /// Quantity and unit of the vertical axis.
    pub y_label: String,
    /// Scale of the axes.
    pub scale: Scale,
    /// Content.
    pub content: PanelContent,
    /// Events marked on the time axis.
    pub marks: Vec<Mark>,
}

/// Scale of the axes of a panel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Time [s] to the right, both linear.
    Time,
    /// Both logarithmic.
    Logarithmic,
}

/// Content of a panel.
#[derive(Clone, Debug, PartialEq)]
pub enum PanelContent {
    /// Quantities.
    Curves {
        /// Shaded areas, behind the curves.
        areas: Vec<Area>,
        /// Curves, in the order of drawing.
        curves: Vec<Curve>,
    },
    /// Timelines, from top to bottom.
    Timelines(Vec<TimelineRow>),
}

/// Quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Label in the legend; empty for a curve that belongs to the previous curve.
    pub name: String,
    /// Colour.
    pub color: Color,
    /// Style of the line.
    pub style: Style,
    /// Horizontal and vertical coordinates, in the units of the axes. A vertical NaN is a gap in the line.
    pub points: Vec<(f64, f64)>,
}

/// Style of a curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// Line from point to point.
    Line,
    /// Wide line, visible behind another curve.
    Wide,
    /// Dashed steps: each value holds until the next.
    DashedSteps,
}

/// Area between two curves.
#[derive(Clone, Debug, PartialEq)]
pub struct Area {
    /// Label in the legend.
    pub name: String,
    /// Colour.
    pub color: Color,
    /// Lower bound; gaps as in a curve.
    pub low: Vec<(f64, f64)>,
    /// Upper bound.
    pub high: Vec<(f64, f64)>,
}

/// Row of a timeline: the periods of one state.
#[derive(Clone, Debug, PartialEq)]
pub struct TimelineRow {
    /// Name of the state.
    pub name: String,
    /// Colour.
    pub color: Color,
    /// From and to [s].
    pub spans: Vec<(f64, f64)>,
}

/// Marked event.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Time [s].
    pub time_s: f64,
    /// Kind.
    pub kind: MarkKind,
    /// Description.
    pub text: String,
}

/// Kind of a mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MarkKind {
    /// Change by the operator.
    Operator,
    /// Action of the supervisor, or torque discontinuity.
    Action,
    /// Fault.
    Fault,
}

impl MarkKind {
    /// All kinds, the most important last: it covers the others.
    pub const ALL: [Self; 3] = [Self::Operator, Self::Action, Self::Fault];

    /// Name in legends.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Operator => "operator",
            Self::Action => "supervisor action, discontinuity",
            Self::Fault => "fault",
        }
    }
}

impl Mark {
    /// Colour of marks of this kind.
    #[must_use]
    pub const fn color(&self) -> Color {
        match self.kind {
            MarkKind::Operator => Color::GREY,
            MarkKind::Action => Color::PURPLE,
            MarkKind::Fault => Color::VERMILLION,
        }
    }
}

impl Panel {
    /// Creates a panel over time.
    #[must_use]
    pub fn over_time(title: impl Into<String>, y_label: impl Into<String>, content: PanelContent) -> Self {
        Self {
            title: title.into(),
            x_label: "time in s".to_owned(),
            y_label: y_label.into(),
            scale: Scale::Time,
            content,
            marks: Vec::new(),
        }
    }

    /// Whether the panel has no content.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        match &self.content {
            PanelContent::Curves { curves, .. } => curves.iter().all(|curve| curve.points.is_empty()),
            PanelContent::Timelines(rows) => rows.is_empty(),
        }
    }

    /// Smallest and largest horizontal coordinate; `None` without content.
    #[must_use]
    pub fn x_range(&self) -> Option<(f64, f64)> {
        match &self.content {
            PanelContent::Curves { curves, .. } => range(curves.iter().flat_map(|curve| &curve.points).map(|point| point.0)),
            PanelContent::Timelines(rows) => range(rows.iter().flat_map(|row| &row.spans).flat_map(|span| [span.0, span.1])),
        }
    }

    /// Smallest and largest vertical coordinate; `None` without any.
    #[must_use]
    pub fn y_range(&self) -> Option<(f64, f64)> {
        match &self.content {
            PanelContent::Curves { areas, curves } => {
                let lines = curves.iter().map(|curve| &curve.points);
                let bounds = areas.iter().flat_map(|area| [&area.low, &area.high]);
                range(lines.chain(bounds).flatten().map(|point| point.1))
            }
            PanelContent::Timelines(_) => None,
        }
    }
}

impl Area {
    /// Outlines of the pieces between gaps: along the upper bound and back along the lower bound.
    #[must_use]
    pub fn outlines(&self) -> Vec<Vec<(f64, f64)>> {
        let pairs = pieces(&self.high).zip(pieces(&self.low));
        pairs.map(|(high, low)| high.iter().chain(low.iter().rev()).copied().collect::<Vec<_>>()).collect()
    }
}

impl Curve {
    /// Points of the curve, with the corners of its steps.
    #[must_use]
    pub fn path(&self) -> Vec<(f64, f64)> {
        if self.style != Style::DashedSteps {
            return self.points.clone();
        }
        let mut path: Vec<(f64, f64)> = Vec::with_capacity(2 * self.points.len());
        for point in &self.points {
            if let Some(last) = path.last().copied()
                && last.1 != point.1
            {
                path.push((point.0, last.1));
            }
            path.push(*point);
        }
        path
    }
}

/// Splits a curve at its gaps; no piece is empty.
pub fn pieces(points: &[(f64, f64)]) -> impl Iterator<Item = &[(f64, f64)]> {
    points.split(|point| point.1.is_nan()).filter(|piece| !piece.is_empty())
}

fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.filter(|value| !value.is_nan()).fold(None, |range, value| match range {
        None => Some((value, value)),
        Some((low, high)) => Some((value.min(low), value.max(high))),
    })
}
