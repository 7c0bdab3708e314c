//! Valid scenarios, and the settings they load to.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use hapfic_config::{
    Fidelity, Foot, JointValues, OnLoss, ResetPolicy, Saturation, Search, Settings, TorqueSaturation, json_schema, robots,
    scenarios,
};
use std::path::Path;

const MINIMAL: &str = r#"[robot]
urdf = "leg.urdf"
base_link = "base"
tip_link = "foot"
start_position_rad = [0, 0.9, -1.8]
"#;

fn load(text: &str, overrides: &[&str]) -> Settings {
    let overrides: Vec<String> = overrides.iter().map(|argument| (*argument).to_owned()).collect();
    Settings::from_str(text, "x.toml", None, &overrides).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn again(settings: &Settings) -> Settings {
    let urdf = &settings.robot.urdf;
    let toml = settings.effective_toml();
    Settings::from_effective(&toml, &urdf.name, &urdf.text).unwrap_or_else(|error| panic!("{error}\n{toml}"))
}

#[test]
fn foot_is_spheres_or_box() {
    let foot = |table: &str| {
        let settings = load(&format!("{MINIMAL}[robot.foot]\n{table}\n"), &[]);
        assert_eq!(again(&settings), settings);
        settings.robot.foot.unwrap()
    };
    assert_eq!(foot("radius_m = 0.02"), Foot::Spheres { radius_m: 0.02, centers_m: vec![[0.0; 3]] });
    assert_eq!(
        foot("radius_m = 0.01\noffset_m = [0, 0, 0.5]\ncenters_m = [[0.25, 0, 0], [-0.25, 0, 0]]"),
        Foot::Spheres { radius_m: 0.01, centers_m: vec![[0.25, 0.0, 0.5], [-0.25, 0.0, 0.5]] }
    );
    assert_eq!(
        foot("size_m = [0.1, 0.06, 0.02]\noffset_m = [0, 0, -0.01]"),
        Foot::Box { size_m: [0.1, 0.06, 0.02], offset_m: [0.0, 0.0, -0.01] }
    );
}

#[test]
fn embedded_scenarios_round_trip_equal() {
    assert!(scenarios().iter().any(|scenario| scenario.name == "floor"));
    for scenario in scenarios() {
        let settings = Settings::load(scenario.name, &[]).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(settings.title, scenario.title);
        assert_eq!(again(&settings), settings, "{}", scenario.name);
    }
}

#[test]
fn minimal_scenario_has_documented_defaults() {
    let s = load(MINIMAL, &[]);
    assert_eq!((s.duration_ticks, s.seed), (10_000, 1));
    assert_eq!(s.robot.start_position, [0.0, 0.9, -1.8]);
    assert_eq!((s.robot.base_position_m, s.robot.base_orientation_rpy_rad), ([0.0; 3], [0.0; 3]));
    assert_eq!((s.robot.joint_damping.clone(), s.robot.effort_limit.clone()), (None, None));
    assert_eq!(s.robot.urdf.name, "leg.urdf");
    assert!(s.robot.urdf.text.contains("<robot"));
    assert_eq!((s.world.gravity_m_per_s2, s.world.floor), ([0.0, 0.0, -9.81], None));
    assert_eq!((s.plant.contact_substep_us, s.plant.flight_substep_us), (20, 100));
    assert_eq!((s.plant.command_timeout_ticks, s.plant.brake_damping_n_m_s_per_rad), (3, 2.0));
    assert_eq!(s.plant.on_loss, OnLoss::Fail);
    assert_eq!(s.fidelity, Fidelity::Hapfic);
    let p = s.initial;
    assert_eq!((p.target_position, p.desired_force), (None, [0.0; 3]));
    assert_eq!((p.stiffness, p.max_force), ([6000.0, 6000.0, 12_000.0], [150.0, 150.0, 300.0]));
    assert_eq!(p.position_bound, [0.025; 3]);
    assert_eq!((p.search, p.reset_policy, p.saturation), (Search::Adaptive, ResetPolicy::ContactLoss, Saturation::Softening));
    assert_eq!((p.taper, p.search_scale, p.force_resolution), (0.4, 0.01, 0.01));
    assert!(!p.gravity_compensation);
    assert!(p.offset_anti_windup && p.stall_release && p.force_hold && p.continuous_reentry);
    assert_eq!((p.damping, p.posture_lead), (0.5, 1.5e-3));
    assert_eq!((p.mean_speed, p.max_acceleration), (0.2, 10.0));
    assert!(s.operator.is_empty() && s.faults.is_empty());
    assert_eq!((s.supervisor.deadline_us, s.supervisor.torque_bandwidth_hz), (800, None));
    assert_eq!(s.supervisor.torque_peak, None);
    assert_eq!((s.supervisor.ready_timeout_ms, s.supervisor.heartbeat_timeout_ms), (10_000, 1000));
    assert_eq!((s.supervisor.stall_timeout_ms, s.supervisor.tick_timeout_ms), (10_000, 300));
    assert!(s.supervisor.standby);
    assert_eq!((s.supervisor.restart_budget, s.supervisor.restart_window_ms, s.supervisor.restart_backoff_ms), (5, 10_000, 10));
    assert_eq!((s.supervisor.ramp_rate, s.supervisor.discontinuity), (2000.0, 10.0));
    assert_eq!(s.supervisor.credit_ticks, 1024);
    let r = s.realtime;
    assert_eq!((r.priority_plant, r.priority_gate, r.priority_controller, r.priority_planner), (80, 78, 76, 72));
    assert_eq!((r.core_plant, r.core_gate, r.core_controller, r.core_planner), (None, None, None, None));
    assert_eq!((s.recorder.flush_ms, s.recorder.viewer_rate_hz, s.recorder.chunk_kib), (50, 60.0, 256));
    assert_eq!((s.processes.plant.clone(), s.processes.planner.clone(), s.processes.controller.clone()), (None, None, None));
    assert_eq!(again(&s), s);
}

#[test]
fn torque_limits_default_off_and_round_trip() {
    let s = load(MINIMAL, &[]);
    assert_eq!((s.supervisor.torque_saturation, s.supervisor.torque_rate), (TorqueSaturation::Clip, None));
    let s = load(MINIMAL, &["supervisor.torque_saturation=scale", "supervisor.torque_rate_n_m_per_s=2500"]);
    assert_eq!((s.supervisor.torque_saturation, s.supervisor.torque_rate), (TorqueSaturation::Scale, Some(2500.0)));
    assert_eq!(again(&s), s);
    let schema: serde_json::Value = serde_json::from_str(&json_schema()).unwrap();
    let supervisor = &schema["properties"]["supervisor"]["properties"];
    assert_eq!(supervisor["torque_rate_n_m_per_s"]["maximum"], 1e7);
    assert_eq!(supervisor["torque_saturation"]["default"], "clip");
}

#[test]
fn floor_empty_has_documented_defaults() {
    let floor = load(&format!("{MINIMAL}[world.floor]\n"), &[]).world.floor.unwrap();
    assert_eq!((floor.height_m, floor.surface.stiffness_n_per_m, floor.surface.damping_n_s_per_m), (0.0, 1e6, 1e4));
    assert_eq!((floor.surface.transition_width_m, floor.surface.critical_speed_m_per_s), (1e-3, 1e-3));
    assert_eq!((floor.surface.friction_static, floor.surface.friction_dynamic), (0.0, 0.0));
}

#[test]
fn all_keys_round_trip_equal() {
    let text = r#"
title = "all \"of\" it"
description = """
two
lines"""
duration_s = 2
seed = 9223372036854775807
[robot]
urdf = "leg.urdf"
base_link = "base"
tip_link = "foot"
base_position_m = [0.1, 1e-300, -3]
base_orientation_rpy_rad = [0.3333333333333333, 0, 0]
start_position_rad = [0, 0.6, -1.2]
joint_damping_n_m_s_per_rad = 11.46
foot = { radius_m = 0.03, offset_m = [0.0, 0.0, 0.01] }
effort_limit_n_m = [80, 70, 60.5]
[world]
gravity_m_per_s2 = [0, 0, -1.62]
[world.floor]
friction_static = 0.5
friction_dynamic = 0.3
[plant]
on_loss = "restart"
contact_substep_us = 7
[controller]
stiffness = [1, 2, 3]
search = "sign"
reset_policy = "never"
saturation = "as_printed"
gravity_compensation = true
offset_anti_windup = false
stall_release = false
force_hold = false
continuous_reentry = false
damping = 0
posture_lead_s = 0.02
[planner]
mean_speed = 0.1
[supervisor]
torque_bandwidth_hz = 20
torque_peak_n_m = 40
standby = false
tick_timeout_ms = 50
restart_budget = 0
restart_window_ms = 3600000
restart_backoff_ms = 0
ramp_rate_n_m_per_s = 1e7
discontinuity_n_m = 0.5
[realtime]
core_plant = 1
[processes]
plant = ["python3", "driver.py", ""]
[[operator]]
at = 0
target_position = [1, 2, 3]
max_force = [1, 1, 1]
[[operator]]
at = 0.005
desired_force = [0, 0, -5]
stiffness = [10, 10, 10]
position_bound = [0.1, 0.1, 0.1]
reset_policy = "as_printed"
saturation = "continuous"
search = "tapered"
taper = 1
search_scale = 1
force_resolution = 0.5
gravity_compensation = false
offset_anti_windup = true
stall_release = true
force_hold = true
continuous_reentry = true
damping_sqrt_kg = 100
posture_lead = 0
mean_speed = 10
max_acceleration = 1000
"#;
    let s = load(text, &[]);
    assert_eq!(again(&s), s);
    assert_eq!((s.duration_ticks, s.seed), (2000, 9_223_372_036_854_775_807));
    assert_eq!(s.robot.joint_damping, Some(JointValues::InOrder(vec![11.46; 3])));
    assert_eq!(s.robot.foot, Some(Foot::Spheres { radius_m: 0.03, centers_m: vec![[0.0, 0.0, 0.01]] }));
    assert_eq!(s.robot.effort_limit, Some(JointValues::InOrder(vec![80.0, 70.0, 60.5])));
    assert_eq!(s.supervisor.torque_peak.as_deref(), Some([40.0; 3].as_slice()));
    assert_eq!((s.supervisor.standby, s.supervisor.tick_timeout_ms), (false, 50));
    assert_eq!((s.supervisor.restart_budget, s.supervisor.restart_window_ms, s.supervisor.restart_backoff_ms), (0, 3_600_000, 0));
    assert_eq!((s.supervisor.ramp_rate, s.supervisor.discontinuity), (1e7, 0.5));
    assert_eq!(s.plant.on_loss, OnLoss::Restart);
    assert_eq!(s.initial.target_position, Some([1.0, 2.0, 3.0]), "the entry at 0 sets the start values");
    assert_eq!((s.initial.stiffness, s.initial.max_force), ([1.0, 2.0, 3.0], [1.0; 3]));
    assert_eq!(s.operator.len(), 1, "the entry at 0 is only in the start values");
    let change = s.operator[0];
    assert_eq!((change.at_tick, change.target_position), (5, None));
    assert_eq!(change.desired_force, Some([0.0, 0.0, -5.0]));
    let after = s.initial.with(&change);
    assert_eq!(after.target_position, s.initial.target_position);
    assert_eq!((after.stiffness, after.search, after.mean_speed), ([10.0; 3], Search::Tapered, 10.0));
    assert!(!s.initial.offset_anti_windup && !s.initial.stall_release);
    assert!(after.offset_anti_windup && after.stall_release);
    assert!(!s.initial.force_hold && !s.initial.continuous_reentry && after.force_hold && after.continuous_reentry);
    assert_eq!((s.initial.damping, s.initial.posture_lead), (0.0, 0.02));
    assert_eq!((after.damping, after.posture_lead), (100.0, 0.0));
}

#[test]
fn fidelity_paper_selects_paper_policies() {
    let s = Settings::load("floor", &["controller.fidelity=paper".to_owned()]).unwrap();
    let p = s.initial;
    assert_eq!((p.search, p.reset_policy, p.saturation), (Search::Sign, ResetPolicy::AsPrinted, Saturation::AsPrinted));
    assert!(!p.offset_anti_windup && !p.stall_release && !p.force_hold && !p.continuous_reentry);
    assert_eq!((p.damping, p.posture_lead), (0.0, 0.0));
    assert_eq!(s.fidelity, Fidelity::Paper);
    assert_eq!(again(&s), s);
}

#[test]
fn gains_incompatible_accepted() {
    let p = load(MINIMAL, &["controller.max_force=[1, 1, 1]"]).initial;
    assert!(p.max_force[2] < 0.95 * p.stiffness[2] * p.position_bound[2]);
}

#[test]
fn override_alias_replaces_value() {
    let text = format!("{MINIMAL}[controller]\nstiffness_n_per_m = [1, 2, 3]\nmax_force = [7, 8, 9]\n");
    let s = load(&text, &["controller.stiffness=[4, 5, 6]", "controller.max_force_n.1=80"]);
    assert_eq!((s.initial.stiffness, s.initial.max_force), ([4.0, 5.0, 6.0], [7.0, 80.0, 9.0]));
}

#[test]
fn override_paths_reach_defaults_entries_words() {
    let s = load(MINIMAL, &["controller.stiffness.1=5", "controller.search=sign", " plant.contact_substep_us = 10 "]);
    assert_eq!(s.initial.stiffness, [6000.0, 5.0, 12_000.0]);
    assert_eq!((s.initial.search, s.plant.contact_substep_us), (Search::Sign, 10));
    let s = load(MINIMAL, &["supervisor.standby=false", "plant.on_loss=restart"]);
    assert_eq!((s.supervisor.standby, s.plant.on_loss), (false, OnLoss::Restart));

    let floor = |argument: &str| Settings::load("floor", &[argument.to_owned()]).unwrap();
    assert_eq!(floor("operator.2.desired_force=[0, 0, 100]").operator[2].desired_force, Some([0.0, 0.0, 100.0]));
    assert_eq!(floor("operator.2.desired_force_n.2=80").operator[2].desired_force, Some([0.0, 0.0, 80.0]));
    assert_eq!(floor("title=\"two words\"").title, "two words");
    assert_eq!(floor("seed=7").seed, 7);
    let with_floor = load(MINIMAL, &["world.floor.friction_static=0.5"]);
    assert_eq!(with_floor.world.floor.unwrap().surface.friction_static, 0.5);
}

#[test]
fn override_repeated_last_wins() {
    let s = load(MINIMAL, &["controller.taper=0.1", "controller.taper=0.3"]);
    assert_eq!(s.initial.taper, 0.3);
}

#[test]
fn file_relative_robot_found() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("mine.toml");
    std::fs::create_dir(dir.path().join("robots")).unwrap();
    std::fs::write(dir.path().join("robots/own.urdf"), "<robot name=\"own\"/>").unwrap();
    std::fs::write(&file, MINIMAL.replace("leg.urdf", "robots/own.urdf")).unwrap();
    let s = Settings::load(file.to_str().unwrap(), &[]).unwrap();
    assert_eq!(s.robot.urdf.text, "<robot name=\"own\"/>");
    assert!(Path::new(&s.robot.urdf.name).is_file());
    assert_eq!(again(&s), s, "the effective configuration and its description load to equal settings");

    std::fs::write(&file, MINIMAL).unwrap();
    let s = Settings::load(file.to_str().unwrap(), &[]).unwrap();
    assert_eq!(s.robot.urdf.text, robots()[0].1, "an embedded robot is found from any directory");
}

/// Asserts that the schema describes every key of a table and of its inner tables.
fn assert_described(schema: &serde_json::Value, table: &toml::Table, keys: &mut usize) {
    for (key, value) in table {
        let property = &schema["properties"][key];
        let description = property["description"].as_str();
        assert!(description.is_some_and(|text| !text.is_empty()), "{key} has no description in the schema");
        *keys += 1;
        match value {
            toml::Value::Table(inner) => assert_described(property, inner, keys),
            toml::Value::Array(entries) => {
                for entry in entries.iter().filter_map(toml::Value::as_table) {
                    assert_described(&property["items"], entry, keys);
                }
            }
            _ => {}
        }
    }
}

#[test]
fn schema_describes_floor_scenario() {
    let schema: serde_json::Value = serde_json::from_str(&json_schema()).unwrap();
    let floor: toml::Table = scenarios()[0].text.parse().unwrap();
    let mut keys = 0;
    assert_described(&schema, &floor, &mut keys);
    assert!(keys > 20, "only {keys} keys seen");
    let controller = &schema["properties"]["controller"]["properties"];
    assert_eq!(controller["taper"]["default"], 0.4);
    assert_eq!(controller["taper"]["maximum"], 1.0);
    assert_eq!(controller["stiffness"]["items"]["exclusiveMinimum"], 0.0);
    assert_eq!(schema["required"], serde_json::json!(["robot"]));
}

#[test]
fn place_of_parameter_names_line_and_key() {
    let s = load(
        &format!(
            "{MINIMAL}[controller]\nstiffness = [1, 2, 3]\n[[operator]]\nat = 0\ntaper = 0.1\n[[operator]]\nat = 1\ntaper = 0.3\n"
        ),
        &["controller.max_force=[9, 9, 9]"],
    );
    let place = |entry, name| {
        let key = s.parameter_key(entry, name);
        format!("{} {key}", s.place(&key))
    };
    assert_eq!(place(None, "stiffness"), "x.toml:7 controller.stiffness_n_per_m");
    assert_eq!(place(None, "taper"), "x.toml:10 operator[0].taper", "the entry at 0 s is part of the initial set");
    assert_eq!(place(Some(0), "taper"), "x.toml:13 operator[1].taper");
    assert_eq!(place(None, "max_force"), "--set controller.max_force=[9, 9, 9] controller.max_force_n");
    assert_eq!(s.parameter_key(None, "mean_speed"), "planner.mean_speed_m_per_s");
    assert_eq!(s.place("world.gravity_m_per_s2").line(), None, "not given: the file as a whole");
}
