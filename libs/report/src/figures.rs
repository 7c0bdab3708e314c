//! The paper's figures, from any log.

use crate::collect::{Collected, JointSeries, ObjectSeries};
use crate::color::Color;
use crate::figure::{Area, Curve, Figure, Panel, PanelContent, Scale, Style, TimelineRow};
use crate::run::RunInfo;
use crate::series::Series;
use crate::timelines::Spans;
use hapfic_log::Names;

const AXES: [&str; 3] = ["x", "y", "z"];
const MM_PER_M: f64 = 1e3;
/// Fraction of a limit from which a figure shows its lines.
const NEAR_LIMIT: f64 = 0.25;
/// Value of an empty bin on a logarithmic axis.
const NO_COUNT: f64 = 0.7;
/// Modes without a fault.
const NOMINAL_MODES: [&str; 4] = ["torque", "active", "nominal", "controller"];
/// Modes with a redundant part lost.
const DEGRADED_MODES: [&str; 2] = ["degraded", "standby"];
/// Modes before the first torque.
const WAITING_MODES: [&str; 2] = ["held", "hold"];

/// Makes the figures of the page, in its order.
pub(crate) fn all(collected: &Collected, run: &RunInfo, names: &Names) -> Vec<Figure> {
    let mut figures = vec![
        figure("position", "Foot position and reference", panels(position, collected)),
        figure("force", "Contact force on the foot", panels(force, collected)),
        figure("command", "Force of the controller and its limit", panels(command, collected)),
        figure("torque", "Joint torques", torque(collected, names)),
        figure(
            "contacts",
            "Contacts and modes",
            [contacts(collected), modes(collected)].into_iter().chain(tasks(collected)).collect(),
        ),
    ];
    if !collected.axes[0].turned.is_empty() {
        let panels = panels(orientation, collected).into_iter().chain(panels(moment, collected)).collect();
        figures.push(figure("orientation", "Orientation of the tip", panels));
    }
    if !collected.objects.is_empty() {
        figures.push(figure("objects", "Free objects", objects(collected)));
    }
    let marks = collected.events.marks();
    for panel in figures.iter_mut().flat_map(|figure| &mut figure.panels) {
        panel.marks.clone_from(&marks);
    }
    figures.push(timing(collected, run));
    figures
}

/// Makes the overview: height and force of the foot and contact pairs, in one figure.
pub(crate) fn overview(collected: &Collected, run: &RunInfo) -> Figure {
    let name = if run.scenario.is_empty() { "run" } else { &run.scenario };
    let mut panels = vec![position(collected, 2), force(collected, 2), contacts(collected)];
    panels.extend(severity(collected));
    panels.extend(tasks(collected));
    let marks = collected.events.marks();
    for panel in &mut panels {
        panel.marks.clone_from(&marks);
    }
    figure("overview", &format!("{name}: height of the foot, contact force and contacts"), panels)
}

fn figure(name: &'static str, title: &str, panels: Vec<Panel>) -> Figure {
    Figure { name, title: title.to_owned(), panels, note: None }
}

fn panels(make: fn(&Collected, usize) -> Panel, collected: &Collected) -> Vec<Panel> {
    (0..AXES.len()).map(|axis| make(collected, axis)).collect()
}

fn curve(name: &str, color: Color, style: Style, series: &Series, factor: f64) -> Curve {
    Curve { name: name.to_owned(), color, style, points: series.points(factor) }
}

fn position(collected: &Collected, axis: usize) -> Panel {
    let series = &collected.axes[axis];
    let (low, high) = (series.low.points(MM_PER_M), series.high.points(MM_PER_M));
    let bound = Area { name: "x_{d} ± x_{b}".to_owned(), color: Color::SKY, low, high };
    let areas = if series.low.is_empty() { Vec::new() } else { vec![bound] };
    let curves = vec![
        curve("reference x_{d}", Color::ORANGE, Style::Line, &series.reference, MM_PER_M),
        curve("foot x", Color::BLUE, Style::Line, &series.position, MM_PER_M),
    ];
    let y_label = format!("{} in mm", AXES[axis]);
    Panel::over_time(format!("position, {} axis", AXES[axis]), y_label, PanelContent::Curves { areas, curves })
}

fn force(collected: &Collected, axis: usize) -> Panel {
    let series = &collected.axes[axis];
    let curves = vec![
        curve("contact force F", Color::BLUE, Style::Line, &series.force, 1.0),
        curve("desired force F_{d}", Color::VERMILLION, Style::DashedSteps, &series.desired, 1.0),
    ];
    let content = PanelContent::Curves { areas: Vec::new(), curves };
    Panel::over_time(format!("contact force, {} axis", AXES[axis]), format!("F_{{{}}} in N", AXES[axis]), content)
}

fn command(collected: &Collected, axis: usize) -> Panel {
    let series = &collected.axes[axis];
    let curves = vec![
        curve("F_{c}", Color::BLUE, Style::Line, &series.command, 1.0),
        curve("± F_{max}", Color::VERMILLION, Style::DashedSteps, &series.limit, 1.0),
        curve("", Color::VERMILLION, Style::DashedSteps, &series.limit, -1.0),
    ];
    let content = PanelContent::Curves { areas: Vec::new(), curves };
    Panel::over_time(format!("force of the controller, {} axis", AXES[axis]), "F_{c} in N", content)
}

fn orientation(collected: &Collected, axis: usize) -> Panel {
    let series = &collected.axes[axis];
    let mut curves = vec![curve("error e_{R}", Color::BLUE, Style::Line, &series.turned, 1.0)];
    let title = format!("turn from tip to reference about {}", AXES[axis]);
    let title = with_limit(title, &mut curves, "x_{b,R}", &series.rotation_bound, "°");
    let content = PanelContent::Curves { areas: Vec::new(), curves };
    Panel::over_time(title, "e_{R} in degrees", content)
}

/// Draws the limit of curves that come near it; of others it is in the title, since its lines would flatten them.
fn with_limit(title: String, curves: &mut Vec<Curve>, name: &str, limit: &Series, unit: &str) -> String {
    let largest = |curve: &Curve| curve.points.iter().map(|point| point.1.abs()).fold(0.0, f64::max);
    let lines = [curve(&format!("± {name}"), Color::VERMILLION, Style::DashedSteps, limit, 1.0)];
    let value = lines.iter().map(largest).fold(0.0, f64::max);
    if value == 0.0 {
        return title;
    }
    if curves.iter().map(largest).fold(0.0, f64::max) < NEAR_LIMIT * value {
        return format!("{title}, {name} = {}{unit}", (value * 1e3).round() / 1e3);
    }
    curves.extend(lines);
    curves.push(curve("", Color::VERMILLION, Style::DashedSteps, limit, -1.0));
    title
}

fn moment(collected: &Collected, axis: usize) -> Panel {
    let series = &collected.axes[axis];
    let mut curves = vec![
        curve("of the controller", Color::SAND, Style::Wide, &series.moment, 1.0),
        curve("measured", Color::BLUE, Style::Line, &series.measured_moment, 1.0),
    ];
    let title = with_limit(format!("moment about {}", AXES[axis]), &mut curves, "T_{max}", &series.max_moment, " N m");
    let content = PanelContent::Curves { areas: Vec::new(), curves };
    Panel::over_time(title, "moment in N m", content)
}

fn torque(collected: &Collected, names: &Names) -> Vec<Panel> {
    let panel = |(i, series): (usize, &JointSeries)| {
        let name = names.joints.get(i).cloned().unwrap_or_else(|| format!("joint {i}"));
        let curves = vec![
            curve("raw", Color::SAND, Style::Wide, &series.raw, 1.0),
            curve("conditioned", Color::BLUE, Style::Line, &series.conditioned, 1.0),
        ];
        Panel::over_time(name, "torque in N m", PanelContent::Curves { areas: Vec::new(), curves })
    };
    collected.joints.iter().enumerate().map(panel).collect()
}

fn contacts(collected: &Collected) -> Panel {
    let rows = collected.contacts.iter().enumerate().map(|(i, (body, against, spans))| TimelineRow {
        name: format!("{body}-{against}"),
        color: Color::cycle(i),
        spans: spans.seconds(),
    });
    Panel::over_time("contact pairs", "", PanelContent::Timelines(rows.collect()))
}

fn mode_color(mode: &str) -> Color {
    if NOMINAL_MODES.contains(&mode) {
        Color::GREEN
    } else if DEGRADED_MODES.contains(&mode) {
        Color::ORANGE
    } else if WAITING_MODES.contains(&mode) {
        Color::GREY
    } else {
        Color::VERMILLION
    }
}

/// Makes the timelines of the severities above nominal; `None` if there are none.
fn severity(collected: &Collected) -> Option<Panel> {
    let row = |name: &str| {
        let (_, mode, spans) = collected.modes.iter().find(|(kind, mode, _)| *kind == "severity" && *mode == name)?;
        Some(TimelineRow { name: mode.to_owned(), color: mode_color(mode), spans: spans.seconds() })
    };
    let rows: Vec<_> = ["degraded", "brake", "stopped"].into_iter().filter_map(row).collect();
    (!rows.is_empty()).then(|| Panel::over_time("severity", "", PanelContent::Timelines(rows)))
}

/// Makes the timelines of the conditions of the task; `None` if none was met.
fn tasks(collected: &Collected) -> Option<Panel> {
    let row = |(name, spans): (&str, &Spans)| TimelineRow {
        name: name.replace('_', " "),
        color: Color::ORANGE,
        spans: spans.seconds(),
    };
    let rows: Vec<_> = collected.tasks.iter().map(row).collect();
    (!rows.is_empty()).then(|| Panel::over_time("conditions of the task", "", PanelContent::Timelines(rows)))
}

fn modes(collected: &Collected) -> Panel {
    let rows = collected.modes.iter().map(|(kind, mode, spans)| TimelineRow {
        name: format!("{kind}: {mode}"),
        color: mode_color(mode),
        spans: spans.seconds(),
    });
    let mut rows: Vec<_> = rows.collect();
    rows.sort_by(|a, b| a.name.cmp(&b.name));
    Panel::over_time("modes", "", PanelContent::Timelines(rows))
}

fn objects(collected: &Collected) -> Vec<Panel> {
    let height = PanelContent::Curves { areas: Vec::new(), curves: object_curves(collected, MM_PER_M, |object| &object.height) };
    let tilt = PanelContent::Curves { areas: Vec::new(), curves: object_curves(collected, 1.0, |object| &object.tilt) };
    vec![
        Panel::over_time("height of the centre of mass", "z in mm", height),
        Panel::over_time("rotation from the start orientation", "angle in degrees", tilt),
    ]
}

fn object_curves(collected: &Collected, factor: f64, series: fn(&ObjectSeries) -> &Series) -> Vec<Curve> {
    let objects = collected.objects.iter().enumerate();
    objects.map(|(i, object)| curve(&object.name, Color::cycle(i), Style::Line, series(object), factor)).collect()
}

fn timing(collected: &Collected, run: &RunInfo) -> Figure {
    let mut figure = figure("timing", "Timing", Vec::new());
    let mut curves = Vec::new();
    if run.lockstep() {
        figure.note = Some("lockstep: no timing".to_owned());
    } else {
        let kinds =
            [("state to command", Color::BLUE, &collected.latency), ("timer lateness", Color::ORANGE, &collected.lateness)];
        for (name, color, histogram) in kinds {
            if histogram.count() > 0 {
                let name = format!("{name} (largest {:.0} µs)", histogram.largest_us());
                curves.push(Curve { name, color, style: Style::Line, points: histogram.outline(NO_COUNT) });
            }
        }
        if curves.is_empty() {
            figure.note = Some("the log has no timing".to_owned());
        }
    }
    figure.panels.push(Panel {
        title: "latency histogram".to_owned(),
        x_label: "duration in µs".to_owned(),
        y_label: "ticks".to_owned(),
        scale: Scale::Logarithmic,
        content: PanelContent::Curves { areas: Vec::new(), curves },
        marks: Vec::new(),
    });
    figure
}
