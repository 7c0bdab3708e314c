//! Synthetic logs: a foot that presses, a box that tips over.

use hapfic_log::viewer::{SceneBody, SceneShape, ViewerScene, ViewerShape};
use hapfic_log::{Names, Reader, Viewer, Writer, WriterOptions};
use hapfic_messages::{
    Command, ContactState, Detector, Drive, EVENT_TEXT, Event, EventKind, Mode, ObjectState, Parameters, Process, Reference,
    Request, Severity, Source, State, Timing,
};
use hapfic_report::{Report, ReportError};
use std::collections::BTreeMap;
use std::path::Path;

/// Tick of a force peak of one tick, and its force [N].
pub(crate) const PEAK: (i64, f64) = (777, 99.0);
/// Text with a meaning in HTML.
pub(crate) const HTML_TEXT: &str = "</script><img src=x onerror=alert(1)>";

pub(crate) fn state(tick: i64, ticks: i64) -> State {
    let time = tick as f64 * 1e-3;
    let half = std::f64::consts::FRAC_PI_4 * tick as f64 / ticks as f64;
    let mut state = State {
        tick,
        time_ns: tick as u64 * 1_000_000,
        command_tick: tick - 1,
        wake_lateness_ns: 40_000,
        joints: 2,
        drive: Drive::Torque.code(),
        object_count: 1,
        contact_count: u32::from(tick >= 500),
        foot_position: [0.1, 0.0, 0.2 + 0.01 * time.sin()],
        foot_force: [0.0, 0.0, if tick == PEAK.0 { PEAK.1 } else { 50.0 }],
        ..State::default()
    };
    state.objects[0] =
        ObjectState { position: [0.3, 0.0, 0.1], orientation: [0.0, half.sin(), 0.0, half.cos()], ..ObjectState::default() };
    state.contacts[0] =
        ContactState { body: 0, against: 1, point: [0.1, 0.0, 0.0], force: state.foot_force, ..ContactState::default() };
    state
}

fn command(tick: i64) -> Command {
    let mut request = Request {
        tick,
        state_tick: tick,
        controller: Process::Controller.code(),
        joints: 2,
        force: [1.0, 2.0, 30.0],
        ..Request::default()
    };
    request.torque[0] = 5.0;
    let mut command = Command {
        tick,
        mode: Mode::Active.code(),
        source: Source::Fresh.code(),
        severity: Severity::Nominal.code(),
        joints: 2,
        request,
        ..Command::default()
    };
    command.torque[0] = 4.0;
    command
}

/// Log of two incidents: the planner is lost and restarted, and the standby takes over; later a latched stop without an
/// event for its cause.
pub(crate) fn log_of_incidents() -> Vec<u8> {
    let names = Names::default();
    let mut bytes = Vec::new();
    let mut writer = Writer::new(&mut bytes, Path::new("memory"), &names, &[], &[], &WriterOptions::default()).unwrap();
    for tick in 0..500 {
        writer.state(&state(tick, 500)).unwrap();
        let severity = match tick {
            200..202 => Severity::Degraded,
            202..220 | 402..405 => Severity::Brake,
            405.. => Severity::Stopped,
            _ => Severity::Nominal,
        };
        let mode = match severity {
            Severity::Brake => Mode::Brake,
            Severity::Stopped => Mode::Stopped,
            _ => Mode::Active,
        };
        let mut command = Command { mode: mode.code(), severity: severity.code(), ..command(tick) };
        if tick >= 202 {
            command.request.controller = Process::Standby.code();
        }
        writer.command(&command).unwrap();
        let reported = match tick {
            200 => Some((Process::Planner, EventKind::Lost, Detector::Exit, "killed")),
            202 => Some((Process::Supervisor, EventKind::Transition, Detector::Deadline, "severity degraded -> brake")),
            203 => Some((Process::Standby, EventKind::Promoted, Detector::None, "its requests count")),
            220 => Some((Process::Supervisor, EventKind::Transition, Detector::Deadline, "severity brake -> nominal")),
            402 => Some((Process::Supervisor, EventKind::Transition, Detector::Deadline, "severity nominal -> brake")),
            405 => Some((Process::Supervisor, EventKind::Transition, Detector::Budget, "severity brake -> stopped")),
            _ => None,
        };
        if let Some((process, kind, detector, text)) = reported {
            writer.event(&Event::new(tick, process, kind, severity, detector, text)).unwrap();
        }
    }
    writer.finish().unwrap();
    bytes
}

fn parameters(version: u64, effective_tick: i64, force: f64) -> Parameters {
    Parameters {
        version,
        effective_tick,
        target_position: [0.1, 0.0, 0.1],
        desired_force: [0.0, 0.0, force],
        stiffness: [1000.0; 3],
        max_force: [100.0; 3],
        position_bound: [0.025; 3],
        ..Parameters::default()
    }
}

fn event(tick: i64, description: &str) -> Event {
    let mut text = [0; EVENT_TEXT];
    text[..description.len()].copy_from_slice(description.as_bytes());
    Event {
        tick,
        process: Process::Planner.code(),
        kind: EventKind::Lost.code(),
        severity: Severity::Brake.code(),
        detector: Detector::Heartbeat.code(),
        text_len: description.len() as u32,
        text,
        reserved: 0,
        stamp_ns: 0,
    }
}

fn viewer() -> Viewer {
    let part = |shape, color| SceneShape { position: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0], shape, color };
    let body = |name: &str, frame: &str, shape, color| SceneBody {
        name: name.to_owned(),
        frame: frame.to_owned(),
        shapes: vec![part(shape, color)],
    };
    let grey = [0.5, 0.5, 0.6, 1.0];
    let bodies = vec![
        body("floor", "world", ViewerShape::Plane { size: 2.0 }, grey),
        body("shank", "shank", ViewerShape::Cylinder { radius: 0.02, length: 0.3 }, grey),
        body("foot", "foot", ViewerShape::Sphere { radius: 0.03 }, grey),
        body("box", "box", ViewerShape::Box { size: [0.2, 0.2, 0.2] }, [0.9, 0.6, 0.1, 1.0]),
    ];
    Viewer::new(ViewerScene { bodies }, 60, 0)
}

/// Log of some ticks, with `clock` in its header.
pub(crate) fn log(ticks: i64, clock: &str) -> Vec<u8> {
    let list = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    let names = Names { joints: list(&["hip", HTML_TEXT]), bodies: list(&["foot", "box"]), objects: list(&["box"]) };
    let pairs = [("version", "1"), ("scenario", HTML_TEXT), ("clock", clock), ("duration_ticks", "1000")];
    let pairs: BTreeMap<_, _> = pairs.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
    let header = vec![("hapfic".to_owned(), pairs)];
    let viewer = viewer();
    let mut bytes = Vec::new();
    let options = WriterOptions { chunk_bytes: 16 * 1024, ..WriterOptions::default() };
    let mut writer = Writer::new(&mut bytes, Path::new("memory"), &names, &header, &[], &options).unwrap();
    writer.operator(&parameters(1, 0, 50.0)).unwrap();
    for tick in 0..ticks {
        if tick == 300 {
            writer.operator(&parameters(2, 305, 60.0)).unwrap();
            writer.event(&event(tick, HTML_TEXT)).unwrap();
        }
        let logged = writer.state(&state(tick, ticks)).unwrap();
        writer.reference(&Reference { tick, position: [0.1, 0.0, 0.2], ..Reference::default() }).unwrap();
        writer.command(&command(tick)).unwrap();
        let timing = Timing { process: Process::Supervisor.code(), tick, publish_ns: 9, latency_ns: 60_000, ..Timing::default() };
        let at = writer.time_of(tick);
        writer.timing(&timing, at).unwrap();
        if viewer.due(tick) {
            let upright = [0.0, 0.0, 0.0, 1.0];
            let box_pose = (state(tick, ticks).objects[0].position, state(tick, ticks).objects[0].orientation);
            let poses = [([0.1, 0.0, 0.35], upright), ([0.1, 0.0, 0.2], upright), box_pose];
            writer.transforms(tick, &viewer.transforms(tick, &poses)).unwrap();
            let update = viewer.scene_update(tick, &logged.contacts, Some([0.1, 0.0, 0.2]), Some([0.1, 0.0, 0.1]));
            writer.scene(tick, &update).unwrap();
        }
    }
    writer.finish().unwrap();
    bytes
}

pub(crate) fn report(bytes: &[u8]) -> Result<Report, ReportError> {
    let path = Path::new("memory.mcap");
    Report::from_reader(Reader::new(bytes, path)?, path)
}
