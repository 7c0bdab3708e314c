//! Interactive page: a self-contained file that works without a network.

use crate::events::{Events, LoggedEvent};
use crate::figure::{Figure, Scale};
use crate::label::escape;
use crate::run::RunInfo;
use crate::{plot, table};
use base64::prelude::{BASE64_STANDARD, Engine as _};
use serde_json::Value;
use std::fmt::{self, Write};

const STYLE: &str = include_str!("../assets/page.css");
const SCRIPT: &str = include_str!("../assets/page.js");
/// Content security policy with which the browser blocks every download.
const POLICY: &str =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:";

/// Content of a page.
pub(crate) struct PageContent<'a> {
    pub(crate) run: &'a RunInfo,
    pub(crate) metrics: &'a Value,
    pub(crate) events: &'a Events,
    pub(crate) figures: &'a [Figure],
    pub(crate) snapshots: Option<&'a [u8]>,
    pub(crate) snapshot_times: &'a [(f64, String)],
}

/// Makes the page.
pub(crate) fn page(parts: &PageContent<'_>) -> String {
    let mut out = String::with_capacity(8 << 20);
    // Writing to a string cannot fail.
    let _ = write(&mut out, parts);
    out
}

fn write(out: &mut String, parts: &PageContent<'_>) -> fmt::Result {
    let run = parts.run;
    let name = if run.scenario.is_empty() { "run" } else { run.scenario.as_str() };
    writeln!(out, "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">")?;
    writeln!(out, "<meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">")?;
    writeln!(out, "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">")?;
    writeln!(out, "<title>{} - hapfic report</title>\n<style>\n{STYLE}</style>\n</head>\n<body>", escape(name))?;
    header(out, run, name)?;
    contents(out, parts)?;
    snapshots(out, parts)?;
    for figure in parts.figures {
        writeln!(
            out,
            "<section id=\"{0}\"><h2>{1}</h2><div id=\"figure-{0}\"></div></section>",
            figure.name,
            escape(&figure.title)
        )?;
    }
    metrics(out, parts.metrics)?;
    events(out, parts.events)?;
    writeln!(out, "<script type=\"application/json\" id=\"figures\">{}</script>", data(parts.figures))?;
    writeln!(out, "{}\n<script>\n{SCRIPT}</script>\n</body>\n</html>", library())
}

fn header(out: &mut String, run: &RunInfo, name: &str) -> fmt::Result {
    writeln!(out, "<header><h1>{}</h1>", escape(name))?;
    if !run.title.is_empty() {
        writeln!(out, "<p>{}</p>", escape(&run.title))?;
    }
    if let Some(cause) = &run.cut_off {
        writeln!(
            out,
            "<p class=\"warning\"><b>The log is cut off.</b> This report covers its readable part. {}</p>",
            escape(cause)
        )?;
    }
    let planned = run.planned_s.map_or(String::new(), |planned| format!(" of {planned:.3} s"));
    let facts = [
        ("clock", run.clock.clone()),
        ("duration", format!("{:.3} s{planned}", run.duration_s)),
        ("end", run.ending().to_owned()),
        ("seed", run.seed.clone()),
        ("recorded by", if run.version.is_empty() { String::new() } else { format!("hapfic {}", run.version) }),
        ("report by", format!("hapfic {}", run.report_version)),
        ("messages", run.messages.to_string()),
        ("log", run.log.display().to_string()),
    ];
    write!(out, "<dl>")?;
    for (what, value) in facts.iter().filter(|(_, value)| !value.is_empty()) {
        write!(out, "<div><dt>{what}</dt><dd>{}</dd></div>", escape(value))?;
    }
    writeln!(out, "</dl></header>")
}

fn contents(out: &mut String, parts: &PageContent<'_>) -> fmt::Result {
    write!(out, "<nav>")?;
    if parts.snapshots.is_some() {
        write!(out, "<a href=\"#snapshots\">Snapshots</a> ")?;
    }
    for figure in parts.figures {
        write!(out, "<a href=\"#{}\">{}</a> ", figure.name, escape(&figure.title))?;
    }
    writeln!(out, "<a href=\"#metrics\">Metrics</a> <a href=\"#events\">Events</a></nav>")
}

fn snapshots(out: &mut String, parts: &PageContent<'_>) -> fmt::Result {
    let Some(png) = parts.snapshots else { return Ok(()) };
    let times: Vec<_> = parts.snapshot_times.iter().map(|(time, reason)| format!("{time:.2} s ({reason})")).collect();
    let times = escape(&times.join(", "));
    writeln!(out, "<section id=\"snapshots\"><h2>Snapshots</h2>")?;
    writeln!(out, "<img alt=\"The scene at {times}\" src=\"data:image/png;base64,{}\">", BASE64_STANDARD.encode(png))?;
    writeln!(
        out,
        "<p class=\"note\">Dot: reference x<sub>d</sub>. Ring: target. Arrow: contact force, 1 cm for 10 N.</p></section>"
    )
}

fn metrics(out: &mut String, metrics: &Value) -> fmt::Result {
    writeln!(out, "<section id=\"metrics\"><h2>Metrics</h2><p class=\"note\">Three columns are the axes x, y and z.</p><table>")?;
    for (section, rows) in table::sections(metrics) {
        let cells = rows.iter().map(|row| row.cells.len()).max().unwrap_or(1);
        writeln!(out, "<tr><th colspan=\"{}\">{}</th></tr>", cells + 1, escape(&section))?;
        for row in rows {
            write!(out, "<tr><td>{}</td>", escape(&row.name))?;
            for cell in &row.cells {
                write!(out, "<td class=\"value\">{}</td>", escape(cell))?;
            }
            writeln!(out, "</tr>")?;
        }
    }
    writeln!(out, "</table></section>")
}

fn events(out: &mut String, events: &Events) -> fmt::Result {
    let listed = events.kept();
    write!(out, "<section id=\"events\"><h2>Events</h2><p class=\"note\">{} in the log", events.total())?;
    if (listed.len() as u64) < events.total() {
        write!(out, ", {} of them listed", listed.len())?;
    }
    for (kind, count) in events.counts() {
        write!(out, "; {} {count}", escape(kind))?;
    }
    writeln!(
        out,
        "</p><table>\n<tr><th>time in s</th><th>process</th><th>kind</th><th>severity</th><th>detector</th><th>description</th></tr>"
    )?;
    for event in listed {
        let LoggedEvent { time_s, process, kind, severity, detector, text, fault, .. } = event;
        let class = if *fault { " class=\"fault\"" } else { "" };
        write!(out, "<tr{class}><td class=\"value\">{time_s:.3}</td>")?;
        for cell in [process, kind, severity, detector, text] {
            write!(out, "<td>{}</td>", escape(cell))?;
        }
        writeln!(out, "</tr>")?;
    }
    writeln!(out, "</table></section>")
}

/// Figures as JSON that is valid between tags.
fn data(figures: &[Figure]) -> String {
    let panels = figures.iter().flat_map(|figure| &figure.panels).filter(|panel| panel.scale == Scale::Time);
    let time = panels.filter_map(|panel| panel.x_range()).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or((0.0, 1.0));
    let figures = Value::Array(figures.iter().map(|figure| plot::figure(figure, time)).collect());
    figures.to_string().replace('<', "\\u003c")
}

/// Plotting library, in tags.
fn library() -> String {
    const END: &str = "</script>";
    let sources = plotly::Plot::offline_js_sources();
    // The first script is the library; the second, a typesetter for formulas, is not needed.
    match sources.find(END) {
        Some(end) => sources[..end + END.len()].to_owned(),
        None => sources,
    }
}
