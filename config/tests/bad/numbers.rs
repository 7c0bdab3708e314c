//! Numbers out of range, not finite, and lists of a wrong length.

use crate::common::ROBOT;
use crate::{after_robot, assert_message, before_robot, rejection};
use hapfic_config::{ConfigError, Settings};

#[test]
fn number_out_of_range_rejected() {
    let cases = [
        ("controller", "stiffness_n_per_m = [1, -5, 1]", "stiffness_n_per_m[1]: found -5, expected a number in (0, 1000000]"),
        ("controller", "stiffness = [1, 1, 1000001]", "stiffness_n_per_m[2]: found 1000001, expected a number in (0, 1000000]"),
        ("controller", "max_force_n = [0, 1, 1]", "max_force_n[0]: found 0, expected a number in (0, 100000]"),
        ("controller", "position_bound_m = [1, 1, 1.5]", "position_bound_m[2]: found 1.5, expected a number in (0, 1]"),
        ("controller", "taper = 1.1", "taper: found 1.1, expected a number in (0, 1]"),
        ("controller", "damping = -0.1", "damping_sqrt_kg: found -0.1, expected a number in [0, 100]"),
        ("controller", "posture_lead = 0.021", "posture_lead_s: found 0.021, expected a number in [0, 0.02]"),
        ("plant", "force_noise_n = -1", "force_noise_n: found -1, expected a number in [0, 100]"),
        ("planner", "mean_speed = 11", "mean_speed_m_per_s: found 11, expected a number in (0, 10]"),
        ("planner", "max_acceleration = 0.0", "max_acceleration_m_per_s2: found 0, expected a number in (0, 1000]"),
        ("world.floor", "damping_n_s_per_m = -1e-9", "damping_n_s_per_m: found -1e-9, expected a number in [0, 10000000]"),
        ("world.floor", "transition_width_m = 0", "transition_width_m: found 0, expected a number in (0, 0.1]"),
        ("plant", "contact_substep_us = 21", "contact_substep_us: found 21, expected an integer in [1, 20]"),
        ("plant", "contact_substep_us = 0", "contact_substep_us: found 0, expected an integer in [1, 20]"),
        ("plant", "flight_substep_us = -1", "flight_substep_us: found -1, expected an integer in [1, 200]"),
        ("supervisor", "tick_timeout_ms = 49", "tick_timeout_ms: found 49, expected an integer in [50, 60000]"),
        ("supervisor", "restart_budget = -1", "restart_budget: found -1, expected an integer in [0, 1000000]"),
        ("supervisor", "restart_window_ms = 99", "restart_window_ms: found 99, expected an integer in [100, 3600000]"),
        ("supervisor", "restart_backoff_ms = 60001", "restart_backoff_ms: found 60001, expected an integer in [0, 60000]"),
        ("supervisor", "ramp_rate_n_m_per_s = 0", "ramp_rate_n_m_per_s: found 0, expected a number in (0, 10000000]"),
        ("supervisor", "torque_rate_n_m_per_s = 0", "torque_rate_n_m_per_s: found 0, expected a number in (0, 10000000]"),
        (
            "supervisor",
            "torque_rate_n_m_per_s = 10000001",
            "torque_rate_n_m_per_s: found 10000001, expected a number in (0, 10000000]",
        ),
        ("supervisor", "discontinuity_n_m = 100001", "discontinuity_n_m: found 100001, expected a number in (0, 100000]"),
        ("supervisor", "deadline_us = 951", "deadline_us: found 951, expected an integer in [50, 950]"),
        ("realtime", "priority_plant = 99", "priority_plant: found 99, expected an integer in [1, 98]"),
        ("recorder", "flush_ms = 99999999999999999999", "flush_ms: found 99999999999999999999, expected an integer in"),
    ];
    for (section, line, expected) in cases {
        let error = after_robot(&format!("[{section}]\n{line}\n"));
        assert!(matches!(error, ConfigError::OutOfRange(_)), "{error:?}");
        assert_message(&error, &format!("x.toml:7: {section}.{expected}"), &[]);
    }
    for (line, expected) in [
        ("duration_s = 0", "duration_s: found 0, expected a number in [0.001, 86400]"),
        ("duration_s = 86401", "duration_s: found 86401, expected a number in [0.001, 86400]"),
        ("seed = -1", "seed: found -1, expected an integer in [0, 9223372036854775807]"),
        ("seed = 9223372036854775808", "seed: found 9223372036854775808, expected an integer in [0, 9223372036854775807]"),
    ] {
        assert_message(&before_robot(&format!("{line}\n")), &format!("x.toml:1: {expected}"), &[]);
    }
}

#[test]
fn vector_too_long_rejected() {
    assert_message(
        &after_robot("[world]\ngravity_m_per_s2 = [80, 0, -80]\n"),
        "x.toml:7: world.gravity_m_per_s2: found [80, 0, -80], of length 113.",
        &["expected a vector no longer than 100"],
    );
    assert_message(
        &after_robot("[[operator]]\nat = 1\ntarget_position = [80, 0, 80]\n"),
        "x.toml:8: operator[0].target_position_m: found [80, 0, 80], of length 113.",
        &["no longer than 100"],
    );
    assert_message(
        &after_robot("[[operator]]\nat = 1\ndesired_force = [8000, 0, 8000]\n"),
        "x.toml:8: operator[0].desired_force_n: found [8000, 0, 8000], of length 11313.",
        &["no longer than 10000"],
    );
}

/// Replaces every number of an effective configuration by nan and by inf.
#[test]
fn number_not_finite_rejected() {
    fn paths(value: &toml::Value, path: &str, numbers: &mut Vec<String>) {
        let below = |step: &str| if path.is_empty() { step.to_owned() } else { format!("{path}.{step}") };
        match value {
            toml::Value::Table(table) => table.iter().for_each(|(key, child)| paths(child, &below(key), numbers)),
            toml::Value::Array(items) => {
                items.iter().enumerate().for_each(|(index, child)| paths(child, &below(&index.to_string()), numbers));
            }
            toml::Value::Integer(_) | toml::Value::Float(_) => numbers.push(path.to_owned()),
            _ => {}
        }
    }
    let settings = Settings::load(
        "floor",
        &[
            "robot.joint_damping_n_m_s_per_rad=[1, 1, 1]".to_owned(),
            "robot.effort_limit_n_m=80".to_owned(),
            "supervisor.torque_bandwidth_hz=20".to_owned(),
            "supervisor.torque_peak_n_m=40".to_owned(),
            "operator.2.taper=0.1".to_owned(),
            "operator.2.mean_speed=0.1".to_owned(),
            r#"fault=[{kind="slow", process="plant", random={count=2, from_s=1, to_s=2}, for_ms=5, by_us=9}, {kind="hog", at_s=1}]"#
                .to_owned(),
        ],
    )
    .unwrap();
    let effective: toml::Table = settings.effective_toml().parse().unwrap();
    let mut numbers = Vec::new();
    paths(&toml::Value::Table(effective), "", &mut numbers);
    assert!(["fault.0.random.count", "fault.0.by_us", "fault.1.at_s"].iter().all(|path| numbers.iter().any(|n| n == path)));
    assert!(numbers.len() > 60, "only {numbers:?}");
    for path in numbers {
        for word in ["nan", "-nan", "inf", "-inf"] {
            let argument = format!("{path}={word}");
            let error = rejection(&settings.effective_toml(), &[&argument]);
            assert!(matches!(error, ConfigError::OutOfRange(_)), "{argument}: {error:?}");
            let found = if word.ends_with("nan") { "found nan".to_owned() } else { format!("found {word}") };
            assert_message(&error, &format!("--set {argument}: "), &[&found, "give a finite number"]);
        }
    }
}

#[test]
fn file_nan_rejected() {
    assert_message(
        &after_robot("[controller]\nstiffness = [1, nan, 1]\n"),
        "x.toml:7: controller.stiffness_n_per_m[1]: found nan, expected a number in (0, 1000000]",
        &["give a finite number"],
    );
}

#[test]
fn list_wrong_length_rejected() {
    let cases = [
        ("[controller]\nstiffness = [1, 2]\n", "7: controller.stiffness_n_per_m: found a list of 2, expected a list of 3"),
        ("[controller]\nstiffness = []\n", "7: controller.stiffness_n_per_m: found a list of 0, expected a list of 3"),
        (
            "[[operator]]\nat = 1\ntarget_position = [1, 2, 3, 4]\n",
            "8: operator[0].target_position_m: found a list of 4, expected a list of 3",
        ),
        (
            "[supervisor]\ntorque_peak_n_m = [40, 40]\n",
            "7: supervisor.torque_peak_n_m: found a list of 2, expected a number for all joints, or a list of 3, as \
             robot.start_position_rad (x.toml:5) has",
        ),
        ("[processes]\nplanner = []\n", "7: processes.planner: found [], expected a program and its arguments"),
        ("[processes]\nplanner = [\" \", \"x\"]\n", "7: processes.planner: found [\" \", \"x\"], expected a program"),
    ];
    for (text, expected) in cases {
        let error = after_robot(text);
        assert!(matches!(error, ConfigError::WrongLength(_)), "{error:?}");
        assert_message(&error, &format!("x.toml:{expected}"), &[]);
    }
    for list in ["[]", "[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]"] {
        let text = ROBOT.replace("[0, 0.9, -1.8]", list);
        assert_message(
            &rejection(&text, &[]),
            "x.toml:5: robot.start_position_rad: found a list of ",
            &["expected a list of 1 to 16 numbers"],
        );
    }
}
