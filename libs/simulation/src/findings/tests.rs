#![allow(clippy::unwrap_used)]

use super::*;
use hapfic_config::scenarios;

fn advisor(overrides: &[&str]) -> Advisor {
    let overrides: Vec<String> = overrides.iter().map(|argument| (*argument).to_owned()).collect();
    Advisor::new(&Settings::load("floor", &overrides).unwrap()).unwrap()
}

/// Findings of `floor` with overrides, without simulation.
fn of_floor(overrides: &[&str]) -> Vec<Finding> {
    advisor(overrides).scenario()
}

/// Asserts that there is one finding, with these words, and returns it.
#[track_caller]
fn expect_one(findings: &[Finding], dangerous: bool, words: &[&str]) {
    let texts: Vec<String> = findings.iter().map(Finding::to_string).collect();
    let [only] = findings else { panic!("expected one finding, found {texts:#?}") };
    assert_eq!(only.dangerous, dangerous, "{texts:?}");
    for word in words {
        assert!(texts[0].contains(word), "'{word}' is not in: {}", texts[0]);
    }
}

/// Findings of a change of the running scenario `floor`, pressed with 50 N.
fn of_change(pairs: &[&str]) -> Vec<Finding> {
    let advisor = advisor(&[]);
    let base = advisor.settings.operator[..3].iter().fold(advisor.settings.initial, |set, change| set.with(change));
    let change = OperatorChange::from_pairs(pairs, &base).unwrap().change;
    advisor.set(&base.with(&change), &change, Source::Request(pairs), advisor.start())
}

#[test]
fn scenario_floor_has_no_finding() {
    assert_eq!(of_floor(&[]), []);
}

#[test]
fn desired_force_beyond_limit_is_dangerous() {
    let found = of_floor(&["operator.2.desired_force=[0, 0, 4000]"]);
    expect_one(&found, true, &["--set operator.2.desired_force", "F_d = 4000 N on z", "at most F_max = 300 N"]);
}

#[test]
fn desired_force_beyond_linear_profile_is_dangerous_and_told_once() {
    // Four later entries keep the force.
    let found = of_floor(&["controller.stiffness_n_per_m=[1000, 1000, 1000]"]);
    let words = ["floor.toml:55: operator[2].desired_force_n: found F_d = 50 N on z", "at most 0.95 K0 x_b = 23.75 N"];
    expect_one(&found, true, &words);
}

#[test]
fn desired_force_smaller_limit_names_its_key() {
    let found = of_change(&["max_force.z=40"]);
    expect_one(&found, true, &["set max_force.z=40: max_force: found F_d = 50 N on z", "at most F_max = 40 N"]);
    let found = of_change(&["position_bound=[0.0025, 0.0025, 0.0025]"]);
    let names: Vec<_> = found.iter().map(|finding| finding.diagnostic.key.as_str()).collect();
    assert_eq!(names, ["position_bound", "position_bound"], "{found:?}");
    assert!(found[0].to_string().contains("at most 0.95 K0 x_b = 28.5 N"), "{}", found[0]);
    assert!(found[1].to_string().contains("8 mm inside the floor"), "the target is deeper than x_b: {}", found[1]);
}

#[test]
fn desired_force_into_floor_pulls() {
    let found = of_floor(&["operator.2.desired_force=[0, 0, -50]"]);
    // Later targets keep the force; its own place counts.
    let words = ["--set operator.2.desired_force", "F_d = [0, 0, -50] N, which points into the floor", "pressing is [0, 0, 50]"];
    expect_one(&found, false, &words);
    assert_eq!(of_floor(&["operator.2.desired_force=[10, 0, 50]"]), [], "along the floor is no pull");
}

#[test]
fn desired_force_into_side_of_box_pulls() {
    let boxed = |force: &str| {
        let object =
            "world.object=[{name=\"box\", shape=\"box\", size_m=[0.1, 0.4, 0.4], mass_kg=2.0, position_m=[-0.25, 0.05, 0.2]}]";
        // The foot's sphere of 20 mm is 10 mm inside the face at x = -0.2.
        let script = format!("operator=[{{at=1, target_position=[-0.19, 0.05, 0.2], desired_force={force}}}]");
        of_floor(&[object, &script])
    };
    assert_eq!(boxed("[20, 0, 0]"), []);
    expect_one(&boxed("[-20, 0, 0]"), false, &["points into 'box' where it starts", "along [1, 0, 0]"]);
}

#[test]
fn desired_force_without_surface_never_pulls() {
    let mut advisor = advisor(&["operator.2.desired_force=[0, 0, -50]"]);
    advisor.settings.world.floor = None;
    assert_eq!(advisor.scenario(), []);
}

#[test]
fn desired_force_above_surface_touches_nothing() {
    let found = of_floor(&["operator=[{at=1, target_position=[0, 0.05, 0.1], desired_force=[0, 0, 20]}]"]);
    expect_one(&found, false, &["F_d = [0, 0, 20] N at a target whose foot is 80 mm away from the floor", "no force comes"]);
}

#[test]
fn desired_force_beyond_effort_names_joint() {
    let found = of_floor(&["controller.max_force=[60, 60, 60]", "robot.effort_limit_n_m=5"]);
    expect_one(&found, false, &["F_d = [0, 0, 50] N, which takes", "at joint '", "at most its effort of 5 N m"]);
    let found = of_floor(&["controller.max_force=[60, 60, 60]", "supervisor.torque_peak_n_m=5"]);
    expect_one(&found, false, &["at most its effort of 5 N m"]);
}

#[test]
fn max_force_far_above_effort_is_dangerous() {
    let found = of_change(&["max_force=[10000, 10000, 10000]"]);
    expect_one(&found, true, &["F_max = 10000 N", "at most 10 times its effort of 80 N m"]);
    assert_eq!(of_change(&["max_force=[600, 600, 600]"]), [], "a drive that cuts the torque is common");
}

#[test]
fn target_out_of_reach_is_dangerous_beyond_bound() {
    let found = of_floor(&["operator.0.target_position=[0, 0.05, 4.5]"]);
    expect_one(&found, true, &["operator.0.target_position", "mm out of reach", "pushes with F_max"]);
    expect_one(&of_change(&["target_position.z=5"]), true, &["set target_position.z=5", "out of reach"]);
    // The leg is 0.575 m long, its hip 0.05 m off the axis at a height of 0.5 m: 1 cm more than it reaches.
    let found = of_change(&["target_position=[-0.585, 0.05, 0.5]"]);
    expect_one(&found, false, &["10 mm out of reach"]);
}

#[test]
fn target_deep_in_floor_is_dangerous() {
    let found = of_change(&["target_position.z=-0.3"]);
    assert!(found.iter().any(|f| f.dangerous && f.to_string().contains("320 mm inside the floor")), "{found:?}");
    expect_one(&of_change(&["target_position.z=-0.02"]), true, &["40 mm inside the floor", "at most 25."]);
    assert_eq!(of_change(&["target_position.z=0.0"]), [], "20 mm below contact are within x_b");
}

#[test]
fn target_deep_in_soft_ball_is_no_finding() {
    let settings = Settings::load("ball", &[]).unwrap();
    let found = Advisor::new(&settings).unwrap().scenario();
    // The scenario stretches the leg through the straight knee on purpose.
    expect_one(&found, true, &["operator[9].target_position_m", "out of reach"]);
}

#[test]
fn target_in_object_counts_where_the_object_is() {
    let settings = Settings::load("box", &[]).unwrap();
    let advisor = Advisor::new(&settings).unwrap();
    let pairs = ["target_position=[-0.25, -0.07, 0.2]"];
    let change = OperatorChange::from_pairs(&pairs, &settings.initial).unwrap().change;
    let set = settings.initial.with(&change);
    let found = advisor.set(&set, &change, Source::Request(&pairs), advisor.start());
    expect_one(&found, true, &["mm inside 'box' where it starts"]);
    let away = Scene { objects: vec![Isometry3::translation(1.0, 0.0, 0.15)], ..advisor.start().clone() };
    assert_eq!(advisor.set(&set, &change, Source::Request(&pairs), &away), []);
}

#[test]
fn script_entry_after_end_is_found_unless_cut_short() {
    let text = scenarios().iter().find(|scenario| scenario.name == "floor").unwrap().text;
    let short = text.replace("duration_s = 10.0 ", "duration_s = 5.0 ");
    let settings = Settings::from_str(&short, "x.toml", None, &[]).unwrap();
    let found = Advisor::new(&settings).unwrap().scenario();
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].to_string().contains("x.toml:62: operator[4].at_s: found 6 s, after the end of the run"), "{}", found[0]);
    assert!(found.iter().all(|finding| !finding.dangerous));
    assert_eq!(of_floor(&["duration_s=5.0"]), [], "--duration leaves entries out on purpose");
}

#[test]
fn gravity_upwards_is_found() {
    let found = of_floor(&["world.gravity_m_per_s2=[0, 0, 9.81]"]);
    expect_one(&found, false, &["world.gravity_m_per_s2: found [0, 0, 9.81] m/s^2", "points down"]);
}

#[test]
fn angles_beyond_full_turn_look_like_degrees() {
    let found = of_floor(&["robot.base_orientation_rpy_rad=[0, 0, 9]"]);
    let orientation: Vec<_> = found.iter().filter(|f| f.diagnostic.key == "robot.base_orientation_rpy_rad").collect();
    assert_eq!(orientation.len(), 1, "{found:?}");
    assert!(orientation[0].to_string().contains("if these are degrees, write [0, 0, 0.1571]"), "{}", orientation[0]);
    assert_eq!(degrees_hint(&[0.0, 6.2, -6.1]), None);
    assert_eq!(degrees_hint(&[0.0, 45.0]).unwrap(), "angles are in rad: if these are degrees, write [0, 0.7854]");
}

#[test]
fn findings_come_all_in_order_of_lines() {
    let text = scenarios().iter().find(|scenario| scenario.name == "floor").unwrap().text;
    let bad = text
        .replace("[0.0, 0.0, -9.81]", "[0.0, 0.0, 9.81]")
        .replace("[0.0, 0.0, 50.0]", "[0.0, 0.0, -50.0]")
        .replace("[-0.10, 0.05, 0.06]", "[-0.10, 0.05, 4.5]");
    let settings = Settings::from_str(&bad, "x.toml", None, &[]).unwrap();
    let found = Advisor::new(&settings).unwrap().scenario();
    let lines: Vec<_> = found.iter().map(|finding| finding.diagnostic.place.line()).collect();
    assert_eq!(lines, [Some(17), Some(47), Some(55)], "{found:#?}");
}

#[test]
fn gains_that_oscillate_are_found_once() {
    let mut settings = Settings::load("floor", &[]).unwrap();
    settings.world.floor = None;
    let advisor = Advisor::new(&settings).unwrap();
    assert_eq!(simulated(&advisor, 2).unwrap(), []);
    let stiff = settings.initial.stiffness.map(|k| 3.0 * k);
    let change = |at_tick, stiffness| OperatorChange { at_tick, stiffness: Some(stiffness), ..OperatorChange::default() };
    settings.operator = vec![change(100, stiff), change(200, settings.initial.stiffness), change(300, stiff)];
    let found = simulated(&Advisor::new(&settings).unwrap(), 2).unwrap();
    let words =
        ["operator[0].stiffness_n_per_m: found stiffness [18000, 18000, 36000] N/m", "oscillates (", " mm at the end of 3 s)"];
    expect_one(&found, true, &words);
}

#[test]
fn walls_on_which_search_cycles_are_found() {
    // A step of the whole force each millisecond cycles on any wall.
    let found = all(
        &Settings::load("floor", &["controller.search=sign".to_owned(), "controller.search_scale=0.5".to_owned()]).unwrap(),
        2,
    );
    let found = found.unwrap();
    let words =
        ["floor.toml:55: operator[2].desired_force_n: found F_d = 50 N on z, whose error stays large on test walls of 1e4 N/m ("];
    expect_one(&found, false, &words);
    assert_eq!(found[0].to_string().matches("at damping ratio").count(), 6, "{}", found[0]);
}

#[test]
fn numbers_keep_four_digits() {
    let texts = [0.0, -0.0, 18000.0, 0.0025, 23.75, 38.1354, -0.1, -1e-9, -50.0].map(number);
    assert_eq!(texts, ["0", "0", "18000", "0.0025", "23.75", "38.14", "-0.1", "0", "-50"]);
}

#[test]
fn walls_need_a_floor() {
    let mut settings =
        Settings::load("floor", &["controller.search=sign".to_owned(), "controller.search_scale=0.5".to_owned()]).unwrap();
    settings.world.floor = None;
    assert_eq!(all(&settings, 2).unwrap(), []);
}
