//! Figures in the format of the page's plotting library: traces and layout.

use crate::color::Color;
use crate::figure::{Area, Curve, Figure, MarkKind, Panel, PanelContent, Scale, Style, TimelineRow};
use crate::label;
use serde_json::{Value, json};
use std::collections::BTreeSet;

/// Heights of a panel of curves, of a histogram, of a timeline row, and of the area around all panels [px].
const CURVES: f64 = 210.0;
const HISTOGRAM: f64 = 360.0;
const ROW: f64 = 26.0;
const AROUND: f64 = 110.0;
/// Distance between panels, with the panels' titles [px].
const BETWEEN: f64 = 44.0;

/// Converts a figure to `name`, `timed`, `data` and `layout`. All time axes start with the range `time` [s].
pub(crate) fn figure(figure: &Figure, time: (f64, f64)) -> Value {
    let heights: Vec<_> = figure.panels.iter().map(height).collect();
    let inner = heights.iter().sum::<f64>() + BETWEEN * heights.len() as f64;
    let timed = figure.panels.iter().all(|panel| panel.scale == Scale::Time);
    let count = figure.panels.len();
    let mut plot = PlotTraces { traces: Vec::new(), named: BTreeSet::new() };
    let mut layout = json!({
        "height": inner + AROUND,
        "margin": { "l": 90, "r": 30, "t": 10, "b": 60 },
        "hovermode": "closest",
        "legend": { "orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "xanchor": "left" },
        "font": { "size": 14 },
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
    });
    layout["xaxis"] = json!({
        "anchor": axis("y", count.saturating_sub(1)),
        "title": { "text": label::html(figure.panels.last().map_or("", |panel| panel.x_label.as_str())) },
        "gridcolor": css(Color::LIGHT, 1.0),
        "zeroline": false,
        "showspikes": true,
        "spikemode": "across",
        "spikethickness": 1,
        "spikedash": "dot",
    });
    if timed {
        layout["xaxis"]["range"] = json!([time.0, time.1]);
    } else {
        layout["xaxis"]["type"] = json!("log");
    }
    let mut titles = Vec::new();
    let mut top = 1.0;
    for (i, (panel, height)) in figure.panels.iter().zip(&heights).enumerate() {
        top -= BETWEEN / inner;
        let bottom = (top - height / inner).max(0.0);
        let (x, y) = ("x".to_owned(), axis("y", i));
        titles.push(json!({
            "text": format!("<b>{}</b>", label::html(&panel.title)),
            "xref": "paper", "yref": "paper", "x": 0, "y": top,
            "xanchor": "left", "yanchor": "bottom", "showarrow": false,
        }));
        layout[layout_key(i)] = vertical(panel, [bottom, top]);
        match &panel.content {
            PanelContent::Curves { areas, curves } => {
                for area in areas {
                    plot.area(area, &x, &y);
                }
                for curve in curves {
                    plot.curve(curve, &x, &y);
                }
            }
            PanelContent::Timelines(rows) => {
                for row in rows {
                    plot.traces.push(row_trace(row, &x, &y));
                }
            }
        }
        if !panel.marks.is_empty() {
            // Separate axes from 0 to 1, over those of the panel.
            let over = count + i;
            layout[layout_key(over)] =
                json!({ "overlaying": y, "anchor": "x", "range": [0, 1], "visible": false, "fixedrange": true });
            plot.marks(panel, &x, &axis("y", over));
        }
        top = bottom;
    }
    if let Some(note) = figure.note.as_deref().filter(|_| figure.panels.iter().all(Panel::is_empty)) {
        titles.push(json!({
            "text": label::html(note), "xref": "paper", "yref": "paper", "x": 0.5, "y": 0.5,
            "showarrow": false, "font": { "size": 18 },
        }));
    }
    layout["annotations"] = Value::Array(titles);
    json!({ "name": figure.name, "timed": timed, "data": plot.traces, "layout": layout })
}

struct PlotTraces {
    traces: Vec<Value>,
    /// Names in the legend so far: the legend switches equal names in all panels together.
    named: BTreeSet<String>,
}

impl PlotTraces {
    fn push(&mut self, mut trace: Value, name: &str, x: &str, y: &str) {
        let first = !name.is_empty() && self.named.insert(name.to_owned());
        trace["type"] = json!("scatter");
        trace["name"] = json!(label::html(name));
        trace["legendgroup"] = json!(name);
        trace["showlegend"] = json!(first);
        trace["xaxis"] = json!(x);
        trace["yaxis"] = json!(y);
        self.traces.push(trace);
    }

    fn area(&mut self, area: &Area, x: &str, y: &str) {
        let (mut x_values, mut y_values) = (Vec::new(), Vec::new());
        for outline in area.outlines() {
            // A gap separates the pieces.
            if let Some(first) = outline.first().filter(|_| !x_values.is_empty()) {
                x_values.push(digits(first.0, 9.0));
                y_values.push(f64::NAN);
            }
            let (xs, ys) = columns(&outline);
            x_values.extend(xs);
            y_values.extend(ys);
        }
        let trace = json!({
            "x": x_values, "y": y_values, "mode": "lines", "line": { "width": 0 }, "fill": "toself",
            "fillcolor": css(area.color, 0.28), "hoverinfo": "skip",
        });
        self.push(trace, &area.name, x, y);
    }

    fn curve(&mut self, curve: &Curve, x: &str, y: &str) {
        let (x_values, y_values) = columns(&curve.path());
        let (width, dash) = match curve.style {
            Style::Line => (1.6, "solid"),
            Style::Wide => (5.0, "solid"),
            Style::DashedSteps => (1.6, "dash"),
        };
        let line = json!({ "color": css(curve.color, 1.0), "width": width, "dash": dash });
        let trace = json!({ "x": x_values, "y": y_values, "mode": "lines", "line": line });
        // A curve without a name belongs to the previous curve.
        let before = self.traces.last().and_then(|trace| trace["legendgroup"].as_str()).unwrap_or_default().to_owned();
        self.push(trace, if curve.name.is_empty() { &before } else { &curve.name }, x, y);
    }

    fn marks(&mut self, panel: &Panel, x: &str, y: &str) {
        for kind in MarkKind::ALL {
            let (mut x_values, mut y_values, mut texts) = (Vec::new(), Vec::new(), Vec::new());
            let mut color = Color::GREY;
            for mark in panel.marks.iter().filter(|mark| mark.kind == kind) {
                let text = label::escape(&mark.text);
                x_values.extend([json!(mark.time_s), json!(mark.time_s), Value::Null]);
                y_values.extend([json!(0), json!(1), Value::Null]);
                texts.extend([text.clone(), text, String::new()]);
                color = mark.color();
            }
            if x_values.is_empty() {
                continue;
            }
            let dash = match kind {
                MarkKind::Operator => "dot",
                MarkKind::Action => "dash",
                MarkKind::Fault => "solid",
            };
            let trace = json!({
                "x": x_values, "y": y_values, "text": texts, "hoverinfo": "x+text", "mode": "lines+markers",
                "line": { "color": css(color, 0.8), "width": 1, "dash": dash },
                "marker": { "color": css(color, 1.0), "size": 6 },
            });
            self.push(trace, kind.name(), x, y);
        }
    }
}

fn height(panel: &Panel) -> f64 {
    match (&panel.content, panel.scale) {
        (PanelContent::Timelines(rows), _) => ROW * rows.len().max(2) as f64,
        (_, Scale::Logarithmic) => HISTOGRAM,
        _ => CURVES,
    }
}

/// `y`, `y2`, `y3`, ...
fn axis(letter: &str, index: usize) -> String {
    if index == 0 { letter.to_owned() } else { format!("{letter}{}", index + 1) }
}

/// `yaxis`, `yaxis2`, `yaxis3`, ...
fn layout_key(index: usize) -> String {
    axis("yaxis", index)
}

fn vertical(panel: &Panel, domain: [f64; 2]) -> Value {
    let mut vertical = json!({
        "domain": domain,
        "anchor": "x",
        "title": { "text": label::html(&panel.y_label) },
        "gridcolor": css(Color::LIGHT, 1.0),
        "zeroline": false,
        "automargin": true,
    });
    if let PanelContent::Timelines(rows) = &panel.content {
        let names: Vec<_> = rows.iter().map(|row| label::escape(&row.name)).collect();
        vertical["type"] = json!("category");
        vertical["categoryorder"] = json!("array");
        vertical["categoryarray"] = json!(names);
        vertical["range"] = json!([names.len() as f64 - 0.5, -0.5]);
        vertical["fixedrange"] = json!(true);
    } else if panel.scale == Scale::Logarithmic {
        vertical["type"] = json!("log");
    }
    vertical
}

fn row_trace(row: &TimelineRow, x: &str, y: &str) -> Value {
    let name = label::escape(&row.name);
    let x_values: Vec<_> = row.spans.iter().flat_map(|(from, to)| [json!(from), json!(to), Value::Null]).collect();
    let y_values: Vec<_> = row.spans.iter().flat_map(|_| [json!(name), json!(name), Value::Null]).collect();
    json!({
        "type": "scatter", "x": x_values, "y": y_values, "mode": "lines+markers", "name": name, "showlegend": false,
        "line": { "color": css(row.color, 1.0), "width": 12 },
        "marker": { "color": css(row.color, 1.0), "size": 4, "symbol": "square" },
        "xaxis": x, "yaxis": y, "hoverinfo": "x+y",
    })
}

/// Rounds coordinates. A gap, NaN, becomes null, where the library interrupts a line.
fn columns(points: &[(f64, f64)]) -> (Vec<f64>, Vec<f64>) {
    points.iter().map(|(x, y)| (digits(*x, 9.0), digits(*y, 7.0))).unzip()
}

/// Rounds to `count` digits, which makes the page three times smaller without a visible change.
fn digits(value: f64, count: f64) -> f64 {
    if value == 0.0 {
        return 0.0;
    }
    let scale = 10_f64.powf((count - 1.0 - value.abs().log10().floor()).clamp(-12.0, 15.0));
    (value * scale).round() / scale
}

fn css(color: Color, opacity: f64) -> String {
    format!("rgba({}, {}, {}, {opacity})", color.0, color.1, color.2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_gap_is_null() {
        let (_, y_values) = columns(&[(0.0, 1.0), (0.001, f64::NAN), (0.5, 2.0)]);
        assert_eq!(json!(y_values), json!([1.0, null, 2.0]));
    }

    #[test]
    fn digits_round_to_visible_precision() {
        for (value, rounded) in [(123.456_789_12, 123.4568), (-0.001_234_567_89, -0.001_234_568), (0.0, 0.0), (5e11, 5e11)] {
            assert!((digits(value, 7.0) - rounded).abs() <= 1e-12 * rounded.abs(), "{value}");
        }
    }
}
