//! Limits that the runs with the defaults must keep, and the milestones of the scenarios.

use crate::changes;
use crate::figures::{AXES, axis_figure, digits, largest, list, number};
use crate::runs::{ExperimentResults, FORCES, SCENARIOS, TUNING_SETTINGS, force_setting};
use serde_json::Value;

/// Largest settled error of a hold [% of F_d].
const SETTLED_PERCENT: f64 = 0.2;
/// Largest error while sliding [% of F_d].
const SLIDING_PERCENT: f64 = 2.0;
/// Rotation of a tipped box [deg].
const TIPPED_DEG: f64 = 80.0;
/// Displacement of a kicked ball [m].
const KICKED_M: f64 = 0.1;
/// Largest angle of a straight knee [deg].
const STRAIGHT_DEG: f64 = 1.0;
/// Largest energy created by contacts [J].
const CREATED_J: f64 = 1e-6;
/// Largest share of contact sub-steps that end above the tolerance.
const UNCONVERGED: f64 = 1e-4;
/// Largest position error in the air along an axis with a desired force [m].
const DRIFT_M: f64 = 2e-3;

/// Milestone that a scenario must reach.
pub(crate) struct Milestone {
    pub(crate) scenario: &'static str,
    pub(crate) what: String,
    pub(crate) figure: String,
    pub(crate) expected: String,
    pub(crate) reached: bool,
}

/// Milestones of all scenarios.
pub(crate) fn milestones(results: &ExperimentResults) -> Vec<Milestone> {
    SCENARIOS.into_iter().flat_map(|scenario| scenario_milestones(scenario, results.summary(scenario, &[]))).collect()
}

fn scenario_milestones(scenario: &'static str, summary: &Value) -> Vec<Milestone> {
    let milestone = |what: &str, figure: String, expected: String, reached: bool| Milestone {
        scenario,
        what: what.to_owned(),
        figure,
        expected,
        reached,
    };
    let held = {
        let count = largest(summary, "/force/holds");
        milestone("a desired force is held", format!("{} times", digits(count, 0)), "once".to_owned(), count >= Some(1.0))
    };
    let mut all = vec![held];
    let object = match scenario {
        "box" => "box",
        "ball" | "ball-actuators" => "ball",
        _ => return all,
    };
    let body = list(summary, "/moments/objects").iter().find(|body| body["name"] == object).unwrap_or(&Value::Null);
    let rotation = number(body, "/max_turn_deg");
    let displacement = number(body, "/max_displacement_m");
    if object == "box" {
        let rests = body["tipped_at_rest"] == true;
        let figure = format!("{} deg, {}", digits(rotation, 1), if rests { "at rest" } else { "never at rest" });
        let reached = rotation >= Some(TIPPED_DEG) && rests;
        all.push(milestone("the box is tipped over", figure, format!("{TIPPED_DEG} deg, at rest on another face"), reached));
        let (offset, error) =
            (axis_figure(summary, "/moments/air/max_offset_m", 0), axis_figure(summary, "/moments/air/max_error_m", 0));
        let ticks = axis_figure(summary, "/moments/air/ticks", 0);
        let figure = format!(
            "{} ticks, dx {} mm, e {} mm",
            digits(ticks, 0),
            digits(offset.map(|m| m * 1e3), 3),
            digits(error.map(|m| m * 1e3), 2)
        );
        let reached = ticks > Some(0.0) && offset == Some(0.0) && error.is_some_and(|error| error <= DRIFT_M);
        let expected = format!("dx 0, e {} mm at most", DRIFT_M * 1e3);
        all.push(milestone("no drift in the air with a desired force along x", figure, expected, reached));
    } else {
        let figure = format!("{} mm", digits(displacement.map(|m| m * 1e3), 0));
        let expected = format!("{} mm", KICKED_M * 1e3);
        all.push(milestone("the ball is kicked away", figure, expected, displacement >= Some(KICKED_M)));
        // The knee is the last joint.
        let knee = list(summary, "/moments/joints").last().unwrap_or(&Value::Null);
        let least = number(knee, "/smallest_deg");
        let figure = format!("{} deg", digits(least, 3));
        let reached = least.is_some_and(|least| least <= STRAIGHT_DEG);
        all.push(milestone("the knee is straight", figure, format!("{STRAIGHT_DEG} deg at most"), reached));
    }
    let shank = list(summary, "/moments/contacts").iter().find(|pair| pair["body"] == "shank" && pair["against"] == object);
    let ticks = shank.and_then(|pair| number(pair, "/foot_free_ticks")).unwrap_or(0.0);
    let peak = shank.and_then(|pair| number(pair, "/peak_n"));
    let figure = format!("{ticks:.0} ticks, {} N at most", digits(peak, 1));
    all.push(milestone(&format!("the shank touches the {object}, the foot nothing"), figure, "1 tick".to_owned(), ticks >= 1.0));
    all
}

/// Lists everything that fell short of its limit.
pub(crate) fn shortfalls(results: &ExperimentResults) -> Vec<String> {
    let mut shortfalls = Vec::new();
    for (name, summary) in results.iter() {
        if summary["completed"] != true {
            shortfalls.push(format!("{name}: not completed"));
        }
        let ratio = largest(summary, "/force_command/max_ratio");
        if ratio.is_none_or(|ratio| ratio > 1.0) {
            shortfalls.push(format!("{name}: |F_c| / F_max is {}, expected 1 at most", digits(ratio, 6)));
        }
    }
    for scenario in SCENARIOS {
        physics(scenario, results.summary(scenario, &[]), &mut shortfalls);
        forces(scenario, scenario, results.summary(scenario, &[]), &mut shortfalls);
    }
    for force in FORCES {
        let setting = force_setting(force);
        forces("floor", &format!("floor with {force} N"), results.summary("floor", &[setting.as_str()]), &mut shortfalls);
    }
    let [with, without] = TUNING_SETTINGS.map(|settings| results.changes(settings));
    shortfalls.extend(changes::regressions(with, without));
    let missed = milestones(results).into_iter().filter(|milestone| !milestone.reached);
    shortfalls.extend(missed.map(|m| format!("{}: {}: found {}, expected {}", m.scenario, m.what, m.figure, m.expected)));
    shortfalls
}

fn physics(scenario: &str, summary: &Value, shortfalls: &mut Vec<String>) {
    let figure = |figure: &str| number(summary, &format!("/integration/{figure}"));
    let created = figure("contact_energy_created_j");
    if created.is_none_or(|created| created > CREATED_J) {
        let found = created.map_or("not measured".to_owned(), |created| format!("{created:.1e} J"));
        shortfalls.push(format!("{scenario}: energy created by contacts is {found}, expected {CREATED_J:.0e} J at most"));
    }
    let share = figure("unconverged").zip(figure("contact_substeps")).map(|(unconverged, all)| unconverged / all.max(1.0));
    if share.is_none_or(|share| share > UNCONVERGED) {
        shortfalls.push(format!("{scenario}: share of unconverged sub-steps is {share:?}, expected {UNCONVERGED:.0e} at most"));
    }
    let unexplained = largest(summary, "/tracking/outside/unexplained_ticks");
    if unexplained != Some(0.0) {
        shortfalls.push(format!("{scenario}: {unexplained:?} ticks outside x_b are unexplained, expected none"));
    }
}

fn forces(scenario: &str, name: &str, summary: &Value, shortfalls: &mut Vec<String>) {
    // `tuning` also desires forces out of reach, so its last hold counts.
    let settled = if scenario == "tuning" { "last_hold_rms_percent" } else { "worst_hold_rms_percent" };
    for (figure, most) in [(settled, SETTLED_PERCENT), ("steady_sliding_rms_percent", SLIDING_PERCENT)] {
        for (axis, axis_name) in AXES.iter().enumerate() {
            if let Some(percent) = axis_figure(summary, &format!("/force/{figure}"), axis)
                && percent > most
            {
                shortfalls.push(format!("{name}, {axis_name}: {figure} is {percent:.3}, expected {most} at most"));
            }
        }
    }
}
