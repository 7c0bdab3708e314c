//! What a figure holds, apart from how it is drawn: the pictures and the page show the same.

/// A colour: red, green, blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Color(pub u8, pub u8, pub u8);

/// Okabe and Ito's palette, which colour-blind readers can tell apart, and greys.
impl Color {
    /// Almost black.
    pub const INK: Self = Self(34, 34, 34);
    /// For what is in the background.
    pub const GREY: Self = Self(130, 130, 130);
    /// For grids.
    pub const LIGHT: Self = Self(225, 225, 225);
    /// Blue.
    pub const BLUE: Self = Self(0, 114, 178);
    /// Vermillion.
    pub const VERMILLION: Self = Self(213, 94, 0);
    /// Bluish green.
    pub const GREEN: Self = Self(0, 158, 115);
    /// Orange.
    pub const ORANGE: Self = Self(230, 159, 0);
    /// Light orange, for what lies behind another curve.
    pub const SAND: Self = Self(250, 205, 120);
    /// Sky blue.
    pub const SKY: Self = Self(86, 180, 233);
    /// Reddish purple.
    pub const PURPLE: Self = Self(204, 121, 167);

    /// Colours for what has none of its own, one after the other.
    #[must_use]
    pub const fn cycle(index: usize) -> Self {
        const CYCLE: [Color; 7] =
            [Color::BLUE, Color::ORANGE, Color::GREEN, Color::VERMILLION, Color::PURPLE, Color::SKY, Color::GREY];
        CYCLE[index % CYCLE.len()]
    }
}

/// A figure: panels one below the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Name of its file, without the extension.
    pub name: &'static str,
    /// Its heading.
    pub title: String,
    /// From top to bottom.
    pub panels: Vec<Panel>,
    /// What a reader has to know about it.
    pub note: Option<String>,
}

/// A pair of axes and what stands in them. In labels `x_{d}` has a subscript.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// What it shows.
    pub title: String,
    /// Quantity and unit of the horizontal axis.
    pub x_label: String,
    /// Quantity and unit of the vertical axis.
    pub y_label: String,
    /// How the axes run.
    pub scale: Scale,
    /// What it shows.
    pub content: Content,
    /// Moments to be marked on the time axis.
    pub marks: Vec<Mark>,
}

/// How the axes of a panel run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Time in s to the right, both linear.
    Time,
    /// Both logarithmic.
    Logarithmic,
}

/// What a panel shows.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Quantities.
    Curves {
        /// Shaded, behind the curves.
        areas: Vec<Area>,
        /// In the order in which they are drawn.
        curves: Vec<Curve>,
    },
    /// What is so, or not, from top to bottom.
    Lanes(Vec<Lane>),
}

/// A quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Its label in the legend; empty for one that belongs to the curve before it.
    pub name: String,
    /// Its colour.
    pub color: Color,
    /// How it is drawn.
    pub style: Style,
    /// Horizontal and vertical coordinate, in the units of the axes. NaN as the vertical one is a gap: nothing is drawn across it.
    pub points: Vec<(f64, f64)>,
}

/// How a curve is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// From point to point.
    Line,
    /// From point to point, wide: to be seen behind another curve.
    Wide,
    /// Each value holds until the next; dashed.
    DashedSteps,
}

/// The area between two curves.
#[derive(Clone, Debug, PartialEq)]
pub struct Area {
    /// Its label in the legend.
    pub name: String,
    /// Its colour.
    pub color: Color,
    /// Lower bound; gaps are as those of a curve.
    pub low: Vec<(f64, f64)>,
    /// Upper bound.
    pub high: Vec<(f64, f64)>,
}

/// When something was so.
#[derive(Clone, Debug, PartialEq)]
pub struct Lane {
    /// What.
    pub name: String,
    /// Its colour.
    pub color: Color,
    /// From and to, s.
    pub spans: Vec<(f64, f64)>,
}

/// A moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// When, s.
    pub time_s: f64,
    /// What it is a moment of.
    pub kind: MarkKind,
    /// What happened.
    pub text: String,
}

/// What a mark stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MarkKind {
    /// The operator changed something.
    Operator,
    /// The stack helped itself, or the torque stepped.
    Reaction,
    /// Something went wrong.
    Fault,
}

impl MarkKind {
    /// Every kind, the most important one last: it is drawn over the others.
    pub const ALL: [Self; 3] = [Self::Operator, Self::Reaction, Self::Fault];

    /// Its name in legends.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Operator => "operator",
            Self::Reaction => "reaction",
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
            MarkKind::Reaction => Color::PURPLE,
            MarkKind::Fault => Color::VERMILLION,
        }
    }
}

impl Figure {
    /// As a picture, PNG.
    ///
    /// # Errors
    /// [`ReportError::Draw`](crate::ReportError::Draw) if it cannot be drawn.
    pub fn png(&self) -> Result<Vec<u8>, crate::ReportError> {
        crate::chart::draw(self, None)
    }
}

impl Panel {
    /// A panel over time.
    #[must_use]
    pub fn over_time(title: impl Into<String>, y_label: impl Into<String>, content: Content) -> Self {
        Self {
            title: title.into(),
            x_label: "time in s".to_owned(),
            y_label: y_label.into(),
            scale: Scale::Time,
            content,
            marks: Vec::new(),
        }
    }

    /// Whether there is nothing in it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        match &self.content {
            Content::Curves { curves, .. } => curves.iter().all(|curve| curve.points.is_empty()),
            Content::Lanes(lanes) => lanes.is_empty(),
        }
    }

    /// Least and largest horizontal coordinate; `None` if there is nothing in it.
    #[must_use]
    pub fn x_range(&self) -> Option<(f64, f64)> {
        match &self.content {
            Content::Curves { curves, .. } => range(curves.iter().flat_map(|curve| &curve.points).map(|point| point.0)),
            Content::Lanes(lanes) => range(lanes.iter().flat_map(|lane| &lane.spans).flat_map(|span| [span.0, span.1])),
        }
    }

    /// Least and largest vertical coordinate; `None` if it has none.
    #[must_use]
    pub fn y_range(&self) -> Option<(f64, f64)> {
        match &self.content {
            Content::Curves { areas, curves } => {
                let lines = curves.iter().map(|curve| &curve.points);
                let bounds = areas.iter().flat_map(|area| [&area.low, &area.high]);
                range(lines.chain(bounds).flatten().map(|point| point.1))
            }
            Content::Lanes(_) => None,
        }
    }
}

impl Area {
    /// Outlines of its pieces: along the upper bound and back along the lower one.
    #[must_use]
    pub fn outlines(&self) -> Vec<Vec<(f64, f64)>> {
        let pairs = pieces(&self.high).zip(pieces(&self.low));
        pairs.map(|(high, low)| high.iter().chain(low.iter().rev()).copied().collect::<Vec<_>>()).collect()
    }
}

impl Curve {
    /// Its points with those added that steps have.
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

/// The stretches of a curve between its gaps; none is empty.
pub fn pieces(points: &[(f64, f64)]) -> impl Iterator<Item = &[(f64, f64)]> {
    points.split(|point| point.1.is_nan()).filter(|piece| !piece.is_empty())
}

fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.filter(|value| !value.is_nan()).fold(None, |range, value| match range {
        None => Some((value, value)),
        Some((low, high)) => Some((value.min(low), value.max(high))),
    })
}
