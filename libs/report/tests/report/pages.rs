//! Figures, page and JSON.

use crate::logs::{HTML_TEXT, PEAK, log, log_of_incidents, report, state};
use hapfic_log::{Names, Writer, WriterOptions};
use hapfic_report::figure::{Curve, Figure, MarkKind, Panel, PanelContent};
use hapfic_report::series::CAPACITY;
use hapfic_report::{Report, ReportError, SNAPSHOTS};
use std::path::Path;

fn figure<'a>(figures: &'a [Figure], name: &str) -> &'a Figure {
    figures.iter().find(|figure| figure.name == name).expect(name)
}

fn curves(panel: &Panel) -> &[Curve] {
    let PanelContent::Curves { curves, .. } = &panel.content else { panic!("{} has no curves", panel.title) };
    curves
}

fn rows(panel: &Panel) -> Vec<(&str, &[(f64, f64)])> {
    let PanelContent::Timelines(rows) = &panel.content else { panic!("{} has no rows", panel.title) };
    rows.iter().map(|row| (row.name.as_str(), row.spans.as_slice())).collect()
}

#[test]
fn figures_match_log() {
    let report = report(&log(1000, "realtime")).unwrap();
    let figures = report.figures();
    let names: Vec<_> = figures.iter().map(|figure| figure.name).collect();
    assert_eq!(names, ["position", "force", "command", "torque", "contacts", "objects", "timing"]);

    let z = &figure(&figures, "position").panels[2];
    assert!(curves(z)[0].points.iter().all(|point| point.1 == 200.0));
    let PanelContent::Curves { areas, .. } = &z.content else { panic!("no area") };
    assert_eq!((areas[0].low[0].1, areas[0].high[0].1), ((0.2 - 0.025) * 1e3, (0.2 + 0.025) * 1e3));

    let force = curves(&figure(&figures, "force").panels[2]);
    assert!(force[0].points.contains(&(0.777, PEAK.1)));
    assert_eq!(force[1].points, [(0.0, 50.0), (0.304, 50.0), (0.305, 60.0), (0.999, 60.0)]);

    let command = curves(&figure(&figures, "command").panels[2]);
    assert_eq!(command[0].points, [(0.0, 30.0), (0.999, 30.0)]);
    assert_eq!((command[1].points[0].1, command[2].points[0].1), (100.0, -100.0));

    let torque = &figure(&figures, "torque").panels;
    assert_eq!((torque.len(), torque[0].title.as_str(), torque[1].title.as_str()), (2, "hip", HTML_TEXT));
    assert_eq!((curves(&torque[0])[0].points[0].1, curves(&torque[0])[1].points[0].1), (5.0, 4.0));

    let contacts = &figure(&figures, "contacts").panels;
    assert_eq!(rows(&contacts[0]), [("foot-box", [(0.5, 1.0)].as_slice())]);
    assert!(rows(&contacts[1]).contains(&("drive: torque", [(0.0, 1.0)].as_slice())));
    assert_eq!(contacts[0].marks.iter().filter(|mark| mark.kind == MarkKind::Fault).count(), 1);

    let tilt = curves(&figure(&figures, "objects").panels[1])[0].points.last().unwrap().1;
    assert!((tilt - 89.91).abs() < 1e-6, "{tilt}");
    assert_eq!(curves(&figure(&figures, "timing").panels[0]).len(), 2);
}

#[test]
fn page_is_self_contained_and_escapes_names() {
    let report = report(&log(1000, "realtime")).unwrap();
    let page = report.html().unwrap();
    let (before, rest) = page.split_once("<script type=\"text/javascript\">").unwrap();
    let (library, after) = rest.split_once("</script>").unwrap();
    assert!(library.len() > 1_000_000 && library.contains("window.Plotly"));
    for part in [before, after] {
        for link in ["src=\"http", "href=\"http", "src='http", "@import", "url(http"] {
            assert!(!part.contains(link), "{link}");
        }
        assert!(!part.contains("<img src=x"), "a name became a tag");
    }
    assert!(before.contains("default-src 'none'") && before.contains("data:image/png;base64,"));
    assert!(before.contains("&lt;/script&gt;"));
    let (_, data) = before.split_once("id=\"figures\">").unwrap();
    let figures: serde_json::Value = serde_json::from_str(data.split_once("</script>").unwrap().0).unwrap();
    assert_eq!(figures.as_array().map(Vec::len), Some(report.figures().len()));
    assert!(figures[1]["data"].as_array().is_some_and(|traces| traces.len() >= 6));
}

#[test]
fn report_lockstep_has_no_timing() {
    let report = report(&log(100, "lockstep")).unwrap();
    let figures = report.figures();
    let timing = figure(&figures, "timing");
    assert_eq!(timing.note.as_deref(), Some("lockstep: no timing"));
    assert!(timing.panels[0].is_empty());
    assert!(report.html().unwrap().contains("lockstep: no timing"));
}

#[test]
fn json_matches_log() {
    let report = report(&log(1000, "realtime")).unwrap();
    let json = report.json();
    assert_eq!(json["run"]["completed"], true);
    assert_eq!(json["run"]["duration_s"], 1.0);
    assert_eq!(json["metrics"]["ticks"]["last"], 999);
    assert_eq!(json["events"]["total"], 3);
    let kinds: Vec<_> = report.events().iter().map(|event| event.kind.as_str()).collect();
    assert_eq!(kinds, ["parameters", "lost", "parameters"]);
    assert_eq!(json["snapshots"].as_array().map(Vec::len), Some(SNAPSHOTS));
    let text = report.text();
    assert!(text.contains("completed") && text.contains("1.000 s"), "{text}");
}

#[test]
fn report_incidents_are_on_time_axes_and_in_json() {
    let report = report(&log_of_incidents()).unwrap();
    let overview = report.overview();
    let severity = overview.panels.last().unwrap();
    let (degraded, brake, stopped) = ([(0.2, 0.202)], [(0.202, 0.22), (0.402, 0.405)], [(0.405, 0.5)]);
    let expected = [("degraded", degraded.as_slice()), ("brake", brake.as_slice()), ("stopped", stopped.as_slice())];
    assert_eq!(rows(severity), expected);
    let contacts = figure(&report.figures(), "contacts").clone();
    let modes = rows(&contacts.panels[1]);
    for row in [
        ("severity: brake", brake.as_slice()),
        ("torque from: controller", [(0.0, 0.202)].as_slice()),
        ("torque from: standby", [(0.22, 0.402)].as_slice()),
    ] {
        assert!(modes.contains(&row), "{row:?} is not in {modes:?}");
    }
    let count = |kind: MarkKind| severity.marks.iter().filter(|mark| mark.kind == kind).count();
    // Lost, and three transitions to worse; promoted.
    assert_eq!(MarkKind::ALL.map(count), [0, 1, 4]);

    let json = report.json();
    assert_eq!(json["incidents"]["total"], 2);
    let first = serde_json::json!({
        "from_tick": 202, "to_tick": 219, "from_s": 0.202, "to_s": 0.22, "worst": "brake", "recovered": true,
        "cause": "planner lost: killed",
    });
    let second = serde_json::json!({
        "from_tick": 402, "to_tick": 499, "from_s": 0.402, "to_s": 0.5, "worst": "stopped", "recovered": false,
        "cause": "supervisor transition: severity nominal -> brake",
    });
    assert_eq!(json["incidents"]["listed"], serde_json::json!([first, second]));
    assert_eq!(json["events"]["by_kind"]["promoted"], 1);
}

#[test]
fn overview_without_incidents_has_no_severity_panel() {
    let report = report(&log(100, "lockstep")).unwrap();
    assert!(report.incidents().is_empty());
    assert_eq!(report.overview().panels.len(), 3);
}

#[test]
fn report_truncated_log_is_marked_cut_off() {
    let bytes = log(1000, "realtime");
    let report = report(&bytes[..bytes.len() * 2 / 3]).unwrap();
    let run = report.run();
    assert!(run.cut_off.as_deref().is_some_and(|cause| cause.contains("truncated")), "{:?}", run.cut_off);
    assert!(run.duration_s > 0.1 && run.duration_s < 1.0, "{} s", run.duration_s);
    assert_eq!(run.completed, Some(false));
    assert!(report.html().unwrap().contains("The log is cut off."));
    assert!(report.text().contains("CUT OFF"));
}

#[test]
fn report_log_without_states_is_rejected() {
    let message = report(&log(0, "realtime")).unwrap_err().to_string();
    assert!(message.contains("memory.mcap") && message.contains("expected messages of /state"), "{message}");
    let missing = Report::read(Path::new("/does/not/exist.mcap")).unwrap_err();
    assert!(matches!(missing, ReportError::Log(_)), "{missing}");
    assert!(matches!(report(b"not a log at all"), Err(ReportError::Log(_))));
}

#[test]
fn report_long_run_is_bounded_and_keeps_peak() {
    const TICKS: i64 = 200_000;
    let mut bytes = Vec::new();
    let options = WriterOptions::default();
    let mut writer = Writer::new(&mut bytes, Path::new("memory"), &Names::default(), &[], &[], &options).unwrap();
    for tick in 0..TICKS {
        let mut state = state(tick, TICKS);
        state.foot_force[0] = (tick % 13) as f64;
        writer.state(&state).unwrap();
    }
    writer.finish().unwrap();
    let report = report(&bytes).unwrap();
    let figures = report.figures();
    let force = &figure(&figures, "force").panels;
    assert!(curves(&force[2])[0].points.contains(&(PEAK.0 as f64 / 1e3, PEAK.1)));
    for curve in force.iter().chain(&figure(&figures, "position").panels).flat_map(curves) {
        assert!(curve.points.len() <= 2 * CAPACITY + 2, "{}: {} points", curve.name, curve.points.len());
    }
    assert_eq!(report.run().completed, None);
}
