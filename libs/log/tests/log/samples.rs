//! Sample messages with a distinct value in every field, and logs of them.

use foxglove::messages::{FrameTransforms, Log, SceneUpdate};
use hapfic_log::viewer::{SceneBody, SceneShape, ViewerScene, ViewerShape};
use hapfic_log::{Attachment, LogError, LogMessage, Names, Reader, Topic, Viewer, Writer, WriterOptions, convert};
use hapfic_messages::{
    AxisPlan, Command, ContactState, ControllerState, Detector, Drive, EVENT_TEXT, Event, EventKind, GateState,
    JointSpaceParameters, Mode, ObjectState, Parameters, Phase, Physics, PlannerState, Process, Reference, Request, ResetPolicy,
    RotationParameters, RotationPlan, RotationRequest, Saturation, Search, Severity, Source, State, Task, Timing,
};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

pub(crate) const JOINTS: u32 = 3;
pub(crate) const MESSAGES_PER_TICK: usize = Topic::COUNT;

pub(crate) fn names() -> Names {
    let list = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    Names { joints: list(&["roll", "hip", "knee"]), bodies: list(&["foot", "floor"]), objects: list(&["ball"]) }
}

pub(crate) fn header() -> Vec<(String, BTreeMap<String, String>)> {
    let record = [("version", "1"), ("scenario", "floor"), ("clock", "lockstep")];
    vec![("hapfic".to_owned(), record.map(|(key, value)| (key.to_owned(), value.to_owned())).into())]
}

pub(crate) fn attachments() -> Vec<Attachment> {
    let file = |name: &str, media_type: &str, bytes: &[u8]| Attachment {
        name: name.to_owned(),
        media_type: media_type.to_owned(),
        bytes: bytes.to_owned(),
    };
    vec![file("scenario.toml", "application/toml", b"title = 'floor'\n"), file("robot.urdf", "application/xml", b"<robot/>")]
}

/// Distinct numbers, different at every tick.
fn numbers<const N: usize>(tick: i64, from: f64) -> [f64; N] {
    std::array::from_fn(|i| from + i as f64 / 7.0 + tick as f64 / 1024.0)
}

pub(crate) fn state(tick: i64) -> State {
    let mut state = State {
        tick,
        time_ns: tick as u64 * 1_000_000,
        command_tick: tick - 1,
        wake_lateness_ns: 11,
        slipped: 2,
        joints: JOINTS,
        drive: Drive::Torque.code(),
        object_count: 1,
        contact_count: 2,
        joint_position: numbers(tick, 1.0),
        joint_velocity: numbers(tick, 2.0),
        joint_torque: numbers(tick, 3.0),
        foot_position: numbers(tick, 4.0),
        foot_velocity: numbers(tick, 5.0),
        foot_force: [0.0; 3],
        foot_orientation: numbers(tick, 36.0),
        foot_angular_velocity: numbers(tick, 37.0),
        foot_moment: numbers(tick, 38.0),
        limbs: 1,
        physics: Physics {
            substeps: 50,
            newton_iterations: 60,
            unconverged: 1,
            contact_substeps: 40,
            energy_j: 12.5,
            contact_work_j: -0.5,
            contact_stored_j: 0.25,
            joint_work_j: 1.5,
            joint_loss_j: 0.75,
            energy_error_j: 1e-7,
            cut_substeps: 2,
            passages: 0,
            passed_body: 0,
            passed_against: 0,
        },
        ..State::default()
    };
    state.objects[0] = ObjectState {
        position: numbers(tick, 6.0),
        orientation: [0.0, 0.0, 0.0, 1.0],
        linear_velocity: numbers(tick, 7.0),
        angular_velocity: numbers(tick, 8.0),
    };
    let contact = ContactState { body: 0, against: 1, point: numbers(tick, 9.0), force: [1.0, 0.0, 50.0], depth: 1e-4 };
    state.contacts[0] = contact;
    state.contacts[1] = ContactState { against: 9, ..contact };
    state
}

pub(crate) fn reference(tick: i64) -> Reference {
    let [target, start, start_velocity, brake_acceleration, brake_time, amplitude, rate, phase] = numbers::<8>(tick, 10.0);
    let plan = AxisPlan { target, start, start_velocity, brake_acceleration, brake_time, amplitude, rate, phase };
    Reference {
        stamp_ns: 5,
        tick,
        parameters_version: 3,
        position: numbers(tick, 11.0),
        velocity: numbers(tick, 12.0),
        limbs: 1,
        reserved: 0,
        orientation: numbers(tick, 24.0),
        angular_velocity: numbers(tick, 25.0),
        planner: PlannerState {
            ticks: 77,
            axes: [plan; 3],
            rotation: RotationPlan { ticks: 78, exists: 1, target_rpy: numbers(tick, 26.0), axes: [plan; 3] },
        },
    }
}

pub(crate) fn request(tick: i64) -> Request {
    Request {
        stamp_ns: 6,
        tick,
        state_tick: tick - 1,
        parameters_version: 3,
        controller: Process::Controller.code(),
        joints: JOINTS,
        limbs: 1,
        reserved: 0,
        error: numbers(tick, 13.0),
        error_rate: numbers(tick, 14.0),
        force: numbers(tick, 15.0),
        torque: numbers(tick, 16.0),
        joint_space_torque: numbers(tick, 27.0),
        state: controller_state(tick, 17.0),
        rotation: RotationRequest {
            error: numbers(tick, 28.0),
            error_rate: numbers(tick, 29.0),
            moment: numbers(tick, 30.0),
            state: controller_state(tick, 31.0),
        },
    }
}

fn controller_state(tick: i64, group: f64) -> ControllerState {
    ControllerState {
        offset: numbers(tick, group),
        x_max: numbers(tick, group + 1.0),
        stiffness: [6000.0, 6000.0, 12000.0],
        max_force: [150.0, 150.0, 300.0],
        position_bound: [0.025; 3],
        force: [1.0, 2.0, 3.0],
        converging: [0, 1, 0],
        taper: [0.0, 0.05, 0.4],
        force_error: [0.0, 0.5, -0.5],
        slow_error: [0.0, 0.25, 0.75],
        free_time: [1.0, 0.0, 0.002],
        x_max_force: [3.0, 4.0, 5.0],
        at_rest_ticks: [0, 7, 0],
    }
}

/// Request of the standby at the same tick.
pub(crate) fn standby_request(tick: i64) -> Request {
    Request { stamp_ns: 9, controller: Process::Standby.code(), torque: numbers(tick, 22.0), ..request(tick) }
}

pub(crate) fn command(tick: i64) -> Command {
    Command {
        stamp_ns: 7,
        tick,
        mode: Mode::Active.code(),
        source: Source::Fresh.code(),
        severity: Severity::Degraded.code(),
        joints: JOINTS,
        limited: 0b101,
        ramped: 0b010,
        rate_limited: 0b001,
        limbs: 1,
        torque: numbers(tick, 19.0),
        // Between gates alone: a log has the torques themselves.
        gate: GateState::default(),
        request: standby_request(tick),
    }
}

pub(crate) fn parameters(effective_tick: i64) -> Parameters {
    Parameters {
        version: 3,
        effective_tick,
        target_position: numbers(0, 20.0),
        desired_force: [0.0, 0.0, 50.0],
        stiffness: [6000.0, 6000.0, 12000.0],
        max_force: [150.0, 150.0, 300.0],
        position_bound: [0.025; 3],
        reset_policy: ResetPolicy::AsPrinted.code(),
        saturation: Saturation::AsPrinted.code(),
        search: Search::Sign.code(),
        gravity_compensation: 1,
        offset_anti_windup: 1,
        stall_release: 1,
        force_hold: 1,
        continuous_reentry: 1,
        damping: 0.5,
        posture_lead: 0.0015,
        taper: 0.2,
        search_scale: 0.01,
        force_resolution: 0.02,
        mean_speed: 0.2,
        max_acceleration: 10.0,
        task: Task::Pose.code(),
        joints: JOINTS,
        rotation: RotationParameters {
            target_rpy: numbers(0, 33.0),
            desired_moment: numbers(0, 34.0),
            stiffness: [30.0, 31.0, 32.0],
            max_moment: [10.0, 11.0, 12.0],
            bound: [0.3, 0.4, 0.5],
            damping: 0.05,
            moment_resolution: 0.01,
            mean_speed: 0.6,
            max_acceleration: 11.0,
        },
        joint_space: JointSpaceParameters {
            posture: numbers(0, 35.0),
            stiffness: 10.0,
            damping: 4.0,
            joint_damping: 0.5,
            limit_margin: 0.1,
            limit_stiffness: 100.0,
        },
    }
}

pub(crate) fn event(tick: i64, description: &str) -> Event {
    let mut text = [0; EVENT_TEXT];
    text[..description.len()].copy_from_slice(description.as_bytes());
    Event {
        stamp_ns: 8,
        tick,
        process: Process::Planner.code(),
        kind: EventKind::Lost.code(),
        severity: Severity::Brake.code(),
        detector: Detector::Heartbeat.code(),
        text_len: description.len() as u32,
        reserved: 0,
        text,
    }
}

pub(crate) fn timing(tick: i64) -> Timing {
    Timing {
        process: Process::Supervisor.code(),
        phase: Phase::Running.code(),
        tick,
        due_ns: 1_000,
        wake_ns: 1_250,
        publish_ns: 1_900,
        latency_ns: 40_000 + tick as u64,
        allocations: 1,
        rejected: 2,
        page_faults: 3,
        realtime: 0,
        generation: 4,
        failed_connections: 0,
    }
}

pub(crate) fn viewer() -> Viewer {
    let part = |shape| SceneShape { position: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0], shape, color: [0.5; 4] };
    let foot = [
        ViewerShape::Sphere { radius: 0.02 },
        ViewerShape::Cylinder { radius: 0.02, length: 0.3 },
        ViewerShape::Box { size: [0.1, 0.2, 0.3] },
    ];
    let bodies = vec![
        SceneBody { name: "floor".into(), frame: "world".into(), shapes: vec![part(ViewerShape::Plane { size: 2.0 })] },
        SceneBody { name: "foot".into(), frame: "shank".into(), shapes: foot.map(part).into() },
    ];
    Viewer::new(ViewerScene { bodies }, 60, 0)
}

pub(crate) fn transforms(tick: i64) -> FrameTransforms {
    viewer().transforms(tick, &[(numbers(tick, 21.0), [0.0, 0.0, 0.0, 1.0])])
}

pub(crate) fn scene(tick: i64) -> SceneUpdate {
    let contacts = convert::state(&state(tick), &names()).contacts;
    viewer().scene_update(tick, &contacts, Some([0.1, 0.2, 0.3]), None)
}

pub(crate) fn line(tick: i64) -> Log {
    viewer().log_line(&convert::event(&event(tick, "gone")))
}

/// Writes one message to every topic.
pub(crate) fn write_tick<W: Write>(writer: &mut Writer<W>, tick: i64) -> Result<(), LogError> {
    writer.operator(&parameters(tick))?;
    writer.state(&state(tick))?;
    writer.reference(&reference(tick))?;
    writer.request(&request(tick))?;
    writer.request(&standby_request(tick))?;
    writer.command(&command(tick))?;
    writer.event(&event(tick, "größer"))?;
    writer.timing(&timing(tick), writer.time_of(tick) + 17)?;
    writer.transforms(tick, &transforms(tick))?;
    writer.scene(tick, &scene(tick))?;
    writer.log(tick, &line(tick))
}

/// Log of some ticks, in memory.
pub(crate) fn log(ticks: i64, options: &WriterOptions) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = Writer::new(&mut bytes, Path::new("memory"), &names(), &header(), &attachments(), options).unwrap();
    for tick in 0..ticks {
        write_tick(&mut writer, tick).unwrap();
    }
    writer.finish().unwrap();
    bytes
}

/// Reads until the end or the first error, which must be the last item.
pub(crate) fn read(bytes: &[u8]) -> (Vec<LogMessage>, Option<LogError>) {
    let mut entries = Vec::new();
    let mut reader = match Reader::new(bytes, Path::new("memory")) {
        Ok(reader) => reader,
        Err(error) => return (entries, Some(error)),
    };
    while let Some(item) = reader.next() {
        match item {
            Ok(entry) => entries.push(entry),
            Err(error) => {
                assert!(reader.next().is_none(), "a message after the error {error}");
                return (entries, Some(error));
            }
        }
    }
    (entries, None)
}
