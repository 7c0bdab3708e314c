//! Conditions of the task: each begins where it holds, ends, and leaves the others alone.

use hapfic_config::{OperatorChange, Settings};
use hapfic_messages::{EventKind, TaskCondition};
use hapfic_simulation::conditions::{TaskReport, TaskWatch};
use hapfic_simulation::{DeadTime, Simulation};

/// Runs a scenario; returns the events' ticks and texts, and the report at the end.
fn run(scenario: &str, overrides: &[&str], changes: &[OperatorChange], ticks: i64) -> (Vec<(i64, String)>, Vec<TaskReport>) {
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    let mut settings = Settings::load(scenario, &overrides).unwrap();
    settings.operator.extend(changes);
    let mut simulation = Simulation::with_dead_time(&settings, DeadTime::One).unwrap();
    let mut watch = TaskWatch::new(&settings, simulation.plant().chain().clone());
    let mut events = Vec::new();
    for tick in 0..ticks {
        let s = simulation.step().unwrap();
        for event in watch.push(&s.state, &s.reference, &s.command, s.operator.at(tick)) {
            assert_eq!(event.kind, EventKind::Condition.code());
            events.push((event.tick, event.text().into_owned()));
        }
    }
    (events, watch.report())
}

fn names(reports: &[TaskReport]) -> Vec<String> {
    reports.iter().map(|report| format!("{} {}", report.condition, report.place)).collect()
}

/// Report of a condition at a place.
fn find<'a>(reports: &'a [TaskReport], condition: TaskCondition, place: &str) -> &'a TaskReport {
    let found = reports.iter().find(|report| report.condition == condition.name() && report.place == place);
    found.unwrap_or_else(|| panic!("no {condition} on '{place}' in {:?}", names(reports)))
}

#[test]
fn conditions_of_fine_task_are_none() {
    let (events, reports) = run("floor", &[], &[], 10_000);
    assert!(events.is_empty() && reports.is_empty(), "{events:?}");
}

#[test]
fn conditions_wall_beyond_the_loop_is_told_within_300_ms() {
    let wall = ["world.floor.stiffness_n_per_m=1e7", "world.floor.damping_n_s_per_m=67"];
    let (events, reports) = run("floor", &wall, &[], 6000);
    let (tick, text) = events.iter().find(|(_, text)| text.starts_with("force_oscillates on z began")).unwrap();
    assert!((3000..=3300).contains(tick), "{tick}: {text}");
    assert!(find(&reports, TaskCondition::ForceOscillates, "z").found.ends_with("% of 50.00 N"));
}

#[test]
fn conditions_force_beyond_the_limit_is_not_reached_until_it_is() {
    let back = OperatorChange { at_tick: 5500, desired_force: Some([0.0, 0.0, 50.0]), ..OperatorChange::default() };
    let overrides = ["operator.2.desired_force=[0, 0, 400]", "operator.3.at_s=9", "operator.4.at_s=9.2", "operator.5.at_s=9.4"];
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    let mut settings = Settings::load("floor", &overrides).unwrap();
    settings.operator.retain(|change| change.at_tick < 5500);
    settings.operator.push(back);
    let mut simulation = Simulation::new(&settings).unwrap();
    let mut watch = TaskWatch::new(&settings, simulation.plant().chain().clone());
    let mut events = Vec::new();
    for tick in 0..7000 {
        let s = simulation.step().unwrap();
        events.extend(
            watch.push(&s.state, &s.reference, &s.command, s.operator.at(tick)).iter().map(|e| (e.tick, e.text().into_owned())),
        );
    }
    for name in ["force_not_reached", "force_at_limit"] {
        let of: Vec<_> = events.iter().filter(|(_, text)| text.starts_with(name)).collect();
        assert!(
            of.len() == 2 && of[0].1.contains(" on z began: ") && of[1].1.contains(" on z ended after "),
            "{name}: {events:?}"
        );
        assert!((3000..5500).contains(&of[0].0) && of[1].0 >= 5500, "{of:?}");
    }
}

#[test]
fn conditions_target_out_of_reach_ends_when_target_returns() {
    let (events, reports) = run("ball", &[], &[], 22_000);
    let of: Vec<_> = events.iter().filter(|(_, text)| text.starts_with("target_out_of_reach on x")).collect();
    assert!(of.len() >= 2, "{events:?}");
    let outside = find(&reports, TaskCondition::OutsideBound, "x");
    assert!(outside.since_tick.is_none() && outside.total_s > 2.0, "{outside:?}");
    assert!(find(&reports, TaskCondition::ForceAtLimit, "x").found.contains("of 150.0 N"));
}

#[test]
fn conditions_stiff_gains_leave_little_margin() {
    let stiff = ["controller.stiffness=[18000, 18000, 36000]", "controller.damping_sqrt_kg=0"];
    let (_, reports) = run("floor", &stiff, &[], 200);
    let margin = find(&reports, TaskCondition::StabilityMargin, "");
    assert!(margin.since_tick.is_some() && margin.found.starts_with("omega tau at "), "{margin:?}");
}

#[test]
fn conditions_late_torque_is_not_passive() {
    let settings = Settings::load("floor", &["controller.damping_sqrt_kg=0".to_owned()]).unwrap();
    let falls = |dead_time: DeadTime| {
        let mut simulation = Simulation::with_dead_time(&settings, dead_time).unwrap();
        let mut watch = TaskWatch::new(&settings, simulation.plant().chain().clone());
        for tick in 0..1500 {
            let s = *simulation.step().unwrap();
            watch.push(&s.state, &s.reference, &s.command, s.operator.at(tick));
        }
        names(&watch.report()).iter().any(|name| name.starts_with("not_passive"))
    };
    assert!(!falls(DeadTime::One));
    assert!(falls(DeadTime::Five));
}

/// In the air no moment can be reached; a stop keeps the tool from its orientation.
#[test]
fn conditions_moment_and_orientation_not_reached() {
    let moment = ["operator=[{at_s=0, desired_moment_n_m=[0, 0, 0.5]}]", "world.object=[]"];
    let (_, reports) = run("arm-press", &moment, &[], 1500);
    let found = find(&reports, TaskCondition::MomentNotReached, "z");
    assert!(found.since_tick.is_some() && found.found.contains("instead of 0.500 N m"), "{found:?}");
    let turned =
        ["operator=[{at_s=0, target_orientation_rpy_rad=[1.5707963, 0, 0]}]", "controller.max_moment_n_m=[0.2, 0.2, 0.2]"];
    let (_, reports) = run("arm-press", &turned, &[], 8000);
    let found = reports.iter().find(|report| report.condition == TaskCondition::OrientationNotReached.name());
    assert!(found.is_some_and(|report| report.found.contains("degrees off the reference at rest")), "{reports:?}");
}

#[test]
fn conditions_joint_at_its_stop_is_named() {
    let settings = Settings::load("floor", &[]).unwrap();
    let mut simulation = Simulation::new(&settings).unwrap();
    let mut watch = TaskWatch::new(&settings, simulation.plant().chain().clone());
    let (name, upper) = {
        let joint = &simulation.plant().chain().joints()[2];
        (joint.name.clone(), joint.upper)
    };
    for tick in 0..200 {
        let s = *simulation.step().unwrap();
        let mut state = s.state;
        if (50..120).contains(&tick) {
            state.joint_position[2] = upper;
        }
        watch.push(&state, &s.reference, &s.command, s.operator.at(tick));
    }
    let stop = watch.report().into_iter().find(|report| report.condition == TaskCondition::AtJointStop.name()).unwrap();
    assert_eq!((stop.place, stop.since_tick, stop.times), (name, None, 1));
    assert!((stop.total_s - 0.07).abs() < 1e-9, "{}", stop.total_s);
}
