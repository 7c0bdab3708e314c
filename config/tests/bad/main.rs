//! Invalid scenarios: each error message names place, key, value found and value expected.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "../common/mod.rs"]
mod common;
mod numbers;

use common::ROBOT;
use hapfic_config::{ConfigError, JointValues, Settings};

pub(crate) fn rejection(text: &str, overrides: &[&str]) -> ConfigError {
    let overrides: Vec<String> = overrides.iter().map(|argument| (*argument).to_owned()).collect();
    match Settings::from_str(text, "x.toml", None, &overrides) {
        Ok(_) => panic!("accepted {overrides:?}:\n{text}"),
        Err(error) => error,
    }
}

/// Rejection of text after [`ROBOT`], whose first line is line 6.
pub(crate) fn after_robot(text: &str) -> ConfigError {
    rejection(&format!("{ROBOT}{text}"), &[])
}

/// Rejection of text before [`ROBOT`].
pub(crate) fn before_robot(text: &str) -> ConfigError {
    rejection(&format!("{text}{ROBOT}"), &[])
}

#[track_caller]
pub(crate) fn assert_message(error: &ConfigError, start: &str, rest: &[&str]) {
    let message = error.to_string();
    assert!(message.starts_with(start), "{message}\ndoes not start with\n{start}");
    for part in rest {
        assert!(message.contains(part), "{message}\ndoes not contain\n{part}");
    }
    assert!(message.contains(". Hint: "), "{message}\nhas no hint");
}

#[test]
fn text_not_toml_rejected() {
    let error = after_robot("[controller]\ntaper = = 3\n");
    assert!(matches!(error, ConfigError::NotToml(_)), "{error:?}");
    assert_message(&error, "x.toml:7: found text that is not TOML (", &["expected `key = value`"]);
}

#[test]
fn key_duplicate_rejected() {
    let error = after_robot("[controller]\ntaper = 0.1\ntaper = 0.2\n");
    assert_message(&error, "x.toml:8: found text that is not TOML (duplicate key", &["each key once"]);
}

#[test]
fn key_with_alias_rejected() {
    let error = after_robot("[controller]\nstiffness_n_per_m = [1, 1, 1]\nstiffness = [1, 1, 1]\n");
    assert!(matches!(error, ConfigError::Combination(_)), "{error:?}");
    assert_message(
        &error,
        "x.toml:8: controller.stiffness: found a second spelling of stiffness_n_per_m, which is given at x.toml:7",
        &["expected one of the two", "remove stiffness"],
    );
}

#[test]
fn key_unknown_rejected_with_suggestion() {
    let error = after_robot("[controller]\n\ntapr = 0.1\n");
    assert!(matches!(error, ConfigError::UnknownKey(_)), "{error:?}");
    assert_message(
        &error,
        "x.toml:8: controller.tapr: found an unknown key, expected one of ",
        &["search_scale", "did you mean taper?"],
    );
    assert_message(&after_robot("[controler]\n"), "x.toml:6: controler: found an unknown key", &["did you mean controller?"]);
    assert_message(&after_robot("[world.flor]\n"), "x.toml:6: world.flor: found an unknown key", &["did you mean floor?"]);
    assert_message(
        &after_robot("[[operator]]\nat = 1\nforce = [0, 0, 1]\n"),
        "x.toml:8: operator[0].force: found an unknown key",
        &["desired_force_n"],
    );
    assert_message(&after_robot("[planner]\nstiffness = [1, 1, 1]\n"), "x.toml:7: planner.stiffness: found an unknown key", &[]);
}

#[test]
fn key_missing_rejected() {
    let error = rejection("title = \"none\"\n", &[]);
    assert!(matches!(error, ConfigError::MissingKey(_)), "{error:?}");
    assert_message(&error, "x.toml: robot: found nothing, expected a value", &["add robot"]);
    assert_message(
        &rejection("\n[robot]\nurdf = \"leg.urdf\"\n", &[]),
        "x.toml:2: robot.base_link: found nothing",
        &["add base_link"],
    );
    assert_message(&after_robot("[[operator]]\ntaper = 0.1\n"), "x.toml:6: operator[0].at_s: found nothing", &["add at_s"]);
}

#[test]
fn value_wrong_type_rejected() {
    let cases = [
        ("[controller]\ntaper = \"much\"\n", "7: controller.taper: found \"much\", expected a number in (0, 1]"),
        ("[controller]\nstiffness = 6000\n", "7: controller.stiffness_n_per_m: found 6000, expected a list of 3 numbers"),
        (
            "[controller]\nstiffness = [1,\n \"x\", 3]\n",
            "8: controller.stiffness_n_per_m[1]: found \"x\", expected a number in (0, 1000000]",
        ),
        ("[controller]\ngravity_compensation = 1\n", "7: controller.gravity_compensation: found 1, expected a boolean"),
        (
            "[controller]\nsearch = \"sing\"\n",
            "7: controller.search: found \"sing\", expected one of \"adaptive\", \"tapered\", \"sign\"",
        ),
        ("[controller]\nsearch = 3\n", "7: controller.search: found 3, expected one of \"adaptive\", \"tapered\", \"sign\""),
        ("[plant]\ncontact_substep_us = 1.5\n", "7: plant.contact_substep_us: found 1.5, expected an integer in [1, 20]"),
        ("[supervisor]\ntorque_peak_n_m = true\n", "7: supervisor.torque_peak_n_m: found true, expected a number in"),
        ("[supervisor.torque_peak_n_m]\n", "6: supervisor.torque_peak_n_m: found a table, expected a number for all joints"),
        (
            "[supervisor]\ntorque_saturation = \"scaled\"\n",
            "7: supervisor.torque_saturation: found \"scaled\", expected one of \"clip\", \"scale\"",
        ),
        ("[supervisor]\nstandby = 1\n", "7: supervisor.standby: found 1, expected a boolean"),
        ("[plant]\non_loss = \"restrt\"\n", "7: plant.on_loss: found \"restrt\", expected one of \"fail\", \"restart\""),
        ("[processes]\nplant = \"driver\"\n", "7: processes.plant: found \"driver\", expected a list"),
        ("[processes]\nplant = [\"a\", 3]\n", "7: processes.plant[1]: found 3, expected a string"),
        ("[operator]\nat = 1\n", "6: operator: found a table, expected a list"),
        ("[recorder]\nflush_ms = 1979-05-27\n", "7: recorder.flush_ms: found 1979-05-27, expected an integer in [1, 10000]"),
    ];
    for (text, expected) in cases {
        let error = after_robot(text);
        assert!(matches!(error, ConfigError::WrongType(_)), "{error:?}");
        assert_message(&error, &format!("x.toml:{expected}"), &[]);
    }
    assert_message(&before_robot("title = 3\n"), "x.toml:1: title: found 3, expected a string", &[]);
    assert_message(&before_robot("world = []\n"), "x.toml:1: world: found [], expected a table", &[]);
    let suggestion = after_robot("[controller]\nsearch = \"sing\"\n").diagnostic().help.clone();
    assert_eq!(suggestion, "did you mean \"sign\"?");
}

#[test]
fn lists_of_robot_are_left_to_robot_model() {
    // The robot model knows the number of joints: either list may be the wrong one.
    let overrides = ["robot.joint_damping_n_m_s_per_rad=[1, 2]".to_owned(), "robot.effort_limit_n_m=[1, 2, 3, 4]".to_owned()];
    let robot = Settings::from_str(ROBOT, "x.toml", None, &overrides).unwrap().robot;
    let lengths = [robot.joint_damping, robot.effort_limit].map(|values| match values.unwrap() {
        JointValues::InOrder(list) => list.len(),
        JointValues::ByName(list) => panic!("{list:?}"),
    });
    assert_eq!(lengths, [2, 4]);
}

#[test]
fn foot_has_one_form() {
    let many = format!("radius_m = 0.01\ncenters_m = {:?}", vec![[0.0; 3]; 9]);
    for (table, parts) in [
        ("radius_m = 0.02\nsize_m = [0.1, 0.1, 0.1]", ["x.toml:", "robot.foot.size_m: found radius_m and size_m"]),
        ("offset_m = [0, 0, 0]", ["x.toml:", "robot.foot: found neither radius_m nor size_m"]),
        ("size_m = [0.1, 0.1, 0.1]\ncenters_m = [[0, 0, 0]]", ["x.toml:", "robot.foot.centers_m: found centres beside size_m"]),
        ("radius_m = 0.01\ncenters_m = []", ["x.toml:", "robot.foot.centers_m: found 0 centres, expected 1 to 8"]),
        (&many, ["x.toml:", "robot.foot.centers_m: found 9 centres"]),
        ("size_m = [0.1, 0, 0.1]", ["robot.foot.size_m[1]", "[0.001, 1]"]),
        ("radius_m = 0.01\ncenters_m = [[0, 0, 2]]", ["robot.foot.centers_m[0][2]", "[-1, 1]"]),
    ] {
        let error = Settings::from_str(&format!("{ROBOT}[robot.foot]\n{table}\n"), "x.toml", None, &[]).unwrap_err().to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{table}: {error}");
    }
}

#[test]
fn hint_names_probable_meaning() {
    let cases = [
        ("[operator]\nat = 1\ntaper = 0.1\n", "write [[operator]], with double brackets"),
        ("[fault]\nkind = \"kill\"\n", "write [[fault]], with double brackets"),
        ("[world.object]\nname = \"box\"\n", "write [[world.object]], with double brackets"),
        ("[[controller]]\ntaper = 0.1\n", "write [controller], with single brackets"),
        ("[[operator]]\nat = 1\nforce = [0, 0, 50]\n", "did you mean desired_force?"),
        ("[[operator]]\nat = 1\ntarget = [0, 0, 50]\n", "did you mean target_position?"),
        ("[[operator]]\nat = 1\nspeed = 0.1\n", "did you mean mean_speed?"),
        ("[[operator]]\nat = 1\ncontroller.taper = 0.1\n", "leave controller. out"),
        ("[[operator]]\nat = 1\ndesird_force = [0, 0, 50]\n", "did you mean desired_force_n?"),
    ];
    for (text, hint) in cases {
        let help = after_robot(text).diagnostic().help.clone();
        assert!(help.contains(hint), "{text}{help}");
    }
    assert!(before_robot("taper = 0.1\n").diagnostic().help.contains("did you mean controller.taper?"));
    assert!(before_robot("mean_speed_m_per_s = 0.1\n").diagnostic().help.contains("did you mean planner.mean_speed_m_per_s?"));
    assert!(before_robot("duration = 3\n").diagnostic().help.contains("did you mean duration_s?"));
}

#[test]
fn values_incompatible_rejected() {
    let cases = [
        (
            "[world.floor]\nfriction_static = 0.3\nfriction_dynamic = 0.5\n",
            "8: world.floor.friction_dynamic: found 0.5, expected at most world.floor.friction_static = 0.3",
        ),
        (
            "[controller]\nsearch = \"tapered\"\nfidelity = \"paper\"\n",
            "7: controller.search: found \"tapered\" beside controller.fidelity = \"paper\" (x.toml:8)",
        ),
        (
            "[controller]\nfidelity = \"paper\"\nsaturation = \"as_printed\"\n",
            "8: controller.saturation: found \"as_printed\" beside controller.fidelity = \"paper\" (x.toml:7)",
        ),
        (
            "[controller]\nfidelity = \"paper\"\nreset_policy = \"never\"\n",
            "8: controller.reset_policy: found \"never\" beside controller.fidelity = \"paper\" (x.toml:7)",
        ),
        (
            "[controller]\noffset_anti_windup = false\nfidelity = \"paper\"\n",
            "7: controller.offset_anti_windup: found false beside controller.fidelity = \"paper\" (x.toml:8)",
        ),
        (
            "[controller]\nfidelity = \"paper\"\nstall_release = true\n",
            "8: controller.stall_release: found true beside controller.fidelity = \"paper\" (x.toml:7)",
        ),
        (
            "[controller]\nfidelity = \"paper\"\nforce_hold = true\n",
            "8: controller.force_hold: found true beside controller.fidelity = \"paper\" (x.toml:7)",
        ),
        (
            "[controller]\nfidelity = \"paper\"\ncontinuous_reentry = true\n",
            "8: controller.continuous_reentry: found true beside controller.fidelity = \"paper\" (x.toml:7)",
        ),
        (
            "[controller]\nfidelity = \"paper\"\ndamping = 0.1\n",
            "8: controller.damping_sqrt_kg: found 0.1 beside controller.fidelity = \"paper\" (x.toml:7)",
        ),
        (
            "[controller]\nfidelity = \"paper\"\nposture_lead_s = 0\n",
            "8: controller.posture_lead_s: found 0 beside controller.fidelity = \"paper\" (x.toml:7)",
        ),
        (
            "[realtime]\npriority_gate = 80\n",
            "7: realtime.priority_gate: found 80, expected less than realtime.priority_plant = 80",
        ),
        (
            "[realtime]\npriority_plant = 70\n",
            "7: realtime.priority_plant: found 70, expected more than realtime.priority_gate = 78",
        ),
        (
            "[realtime]\npriority_planner = 77\n",
            "7: realtime.priority_planner: found 77, expected less than realtime.priority_controller = 76",
        ),
        ("[[operator]]\nat = 1\n", "6: operator[0]: found an entry that changes nothing"),
        (
            "[[operator]]\nat = 1\ntaper = 0.1\n[[operator]]\nat = 0.5\ntaper = 0.1\n",
            "10: operator[1].at_s: found 0.5, expected at least 1.005",
        ),
        (
            "[[operator]]\nat = 1\ntaper = 0.1\n[[operator]]\nat = 1.004\ntaper = 0.1\n",
            "10: operator[1].at_s: found 1.004, expected at least 1.005",
        ),
    ];
    for (text, expected) in cases {
        let error = after_robot(text);
        assert!(matches!(error, ConfigError::Combination(_)), "{error:?}");
        assert_message(&error, &format!("x.toml:{expected}"), &[]);
    }
    let same = ROBOT.replace("foot", "base");
    assert_message(
        &rejection(&same, &[]),
        "x.toml:4: robot.tip_link: found \"base\", expected another link than robot.base_link",
        &[],
    );
    let empty = ROBOT.replace("foot", "");
    assert_message(&rejection(&empty, &[]), "x.toml:4: robot.tip_link: found empty text, expected a name", &[]);
}

#[test]
fn override_unreadable_rejected() {
    let cases = [
        ("controller.taper", "found no =, expected KEY=VALUE"),
        ("controller..taper=1", "controller..taper: found an empty key"),
        ("=1", "found an empty key"),
        ("controller.taper=", "controller.taper: found nothing after ="),
        ("title=two words", "title: found \"two words\", which is not TOML"),
        ("controller.stiffness=[1, 2", "controller.stiffness: found \"[1, 2\", which is not TOML"),
        ("operator.0.taper.x=1", "operator: "),
        ("seed.x=1", "seed: found 1, expected a table or a list, to set x in it"),
        (
            "robot.start_position_rad.3=1",
            "robot.start_position_rad: found \"3\" as an index into the list, expected a number from 0 to 2",
        ),
        ("robot.start_position_rad.x=1", "robot.start_position_rad: found \"x\" as an index into the list"),
    ];
    let text = format!("seed = 1\n{ROBOT}");
    for (argument, expected) in cases {
        let error = rejection(&text, &[argument]);
        assert_message(&error, &format!("--set {argument}: {expected}"), &[]);
    }
}

#[test]
fn override_invalid_rejected_like_file() {
    let cases = [
        ("controller.taper=abc", "controller.taper: found \"abc\", expected a number in (0, 1]"),
        ("controller.tapr=0.1", "controller.tapr: found an unknown key, expected one of"),
        ("controler.taper=0.1", "controler: found an unknown key, expected one of"),
        ("controller.stiffness.1=-5", "controller.stiffness_n_per_m[1]: found -5, expected a number in (0, 1000000]"),
        ("controller.search=fast", "controller.search: found \"fast\", expected one of"),
        ("duration_s=1e9", "duration_s: found 1000000000, expected a number in [0.001, 86400]"),
        ("robot.urdf=none.urdf", "robot.urdf: found \"none.urdf\", which cannot be read"),
    ];
    for (argument, expected) in cases {
        let error = rejection(ROBOT, &[argument]);
        assert_message(&error, &format!("--set {argument}: {expected}"), &[]);
    }
}

#[test]
fn scenario_missing_rejected() {
    let error = Settings::load("flor", &[]).unwrap_err();
    assert!(matches!(error, ConfigError::UnknownScenario(_)), "{error:?}");
    assert_message(&error, "flor: found no scenario of this name, expected one of floor", &["did you mean floor?"]);

    let error = Settings::load("nowhere/at_all.toml", &[]).unwrap_err();
    assert!(matches!(error, ConfigError::Read(_)), "{error:?}");
    assert_message(&error, "nowhere/at_all.toml: found a file that cannot be read (", &["embedded scenario: floor"]);
}

#[test]
fn robot_missing_rejected() {
    let error = rejection(&ROBOT.replace("leg.urdf", "arm.urdf"), &[]);
    assert!(matches!(error, ConfigError::Read(_)), "{error:?}");
    assert_message(&error, "x.toml:2: robot.urdf: found \"arm.urdf\", which cannot be read (", &["an embedded one: leg.urdf"]);
}

#[test]
fn keys_of_the_orientation_rejected_in_a_position_task() {
    for (text, words) in [
        ("[controller]\nrotation_stiffness = [1, 2, 3]\n", ["controller.rotation_stiffness_n_m_per_rad", "a pose task"]),
        ("[planner]\nmean_turn_speed = 1\n", ["planner.mean_turn_speed_rad_per_s", "a pose task"]),
        ("[[operator]]\nat_s = 1\ndesired_moment = [0, 0, 1]\n", ["operator[0].desired_moment_n_m", "a pose task"]),
        ("[controller]\ntask = \"pose\"\n", ["controller.task", "at least 6 joints"]),
        ("[controller]\ntask = \"poes\"\n", ["controller.task", "did you mean \"pose\"?"]),
        ("[controller]\nposture = [0.1]\n", ["controller.posture_rad", "a list of 3"]),
        ("[controller]\nposture = { hip = 0.1 }\n", ["controller.posture_rad", "a number for all joints"]),
        ("[controller]\nlimit_margin = -1\n", ["controller.limit_margin_rad", "[0, 1]"]),
    ] {
        let text = format!("{ROBOT}{text}");
        let error = Settings::from_str(&text, "x.toml", None, &[]).unwrap_err().to_string();
        for word in words {
            assert!(error.contains(word), "'{word}' is not in: {error}");
        }
    }
}

#[test]
fn values_of_joints_by_name_have_their_range() {
    let values = |list: &str| Settings::from_str(&ROBOT.replace("[robot]\n", &format!("[robot]\n{list}\n")), "x.toml", None, &[]);
    let named = values("effort_limit = { knee = 30.0 }").or_else(|_| values("effort_limit_n_m = { knee = 30.0 }")).unwrap();
    assert_eq!(named.robot.effort_limit, Some(JointValues::ByName(vec![("knee".to_owned(), 30.0)])));
    let error = values("armature_kg_m2 = { knee = -1.0 }").unwrap_err().to_string();
    assert!(error.contains("robot.armature_kg_m2.knee") && error.contains("[0, 1000]"), "{error}");
    let error = values("joint_friction_n_m = { knee = \"much\" }").unwrap_err().to_string();
    assert!(error.contains("robot.joint_friction_n_m.knee"), "{error}");
}
