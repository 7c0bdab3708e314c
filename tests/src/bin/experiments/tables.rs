//! Tables of `experiments`, as Markdown.

use crate::changes::MeasuredChange;
use crate::figures::{AXES, TICK_S, axis_figure, digits, largest, number, sum};
use crate::runs::{
    ExperimentResults, FORCES, IMPROVEMENT_SCENARIOS, IMPROVEMENTS, LAWS, SCENARIOS, SUBSTEPS, TUNING_SETTINGS, force_setting,
};
use crate::verdict;

/// Table: name of its marker, and function that makes it.
pub(crate) type MarkedTable = (&'static str, fn(&ExperimentResults) -> String);

/// All tables.
pub(crate) const TABLES: [MarkedTable; 8] = [
    ("short", short),
    ("floor", floor),
    ("tracking", tracking),
    ("force", force),
    ("milestones", milestones),
    ("integration", integration),
    ("improvements", improvements),
    ("tuning", tuning),
];

fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: String| format!("| {cells} |\n");
    let mut text = line(head.join(" | "));
    text.push_str(&format!("|{}\n", "---|".repeat(head.len())));
    text.extend(rows.iter().map(|row| line(row.join(" | "))));
    text
}

fn seconds(ticks: Option<f64>) -> String {
    digits(ticks.map(|ticks| ticks * TICK_S), 3)
}

/// Short table of the floor, for README.
fn short(results: &ExperimentResults) -> String {
    let head = ["F_d, N", "settled rms, % of F_d", "sliding rms, % of F_d", "`sign`: settled", "`fidelity = \"paper\"`: settled"];
    let row = |force: u32| {
        let setting = force_setting(force);
        let figure = |law: usize, figure: &str| {
            let settings: Vec<&str> = LAWS[law].1.iter().copied().chain([setting.as_str()]).collect();
            digits(axis_figure(results.summary("floor", &settings), &format!("/force/{figure}"), 2), 3)
        };
        let settled = "settled_rms_percent";
        vec![force.to_string(), figure(0, settled), figure(0, "sliding_rms_percent"), figure(2, settled), figure(3, settled)]
    };
    table(&head, &FORCES.map(row))
}

fn floor(results: &ExperimentResults) -> String {
    let head =
        ["law", "F_d, N", "settled rms, % of F_d", "sliding rms, % of F_d", "max \\|x - x_d\\| / x_b", "max \\|F_c\\| / F_max"];
    let mut rows = Vec::new();
    for (name, law) in LAWS {
        for force in FORCES {
            let setting = force_setting(force);
            let settings: Vec<&str> = law.iter().copied().chain([setting.as_str()]).collect();
            let summary = results.summary("floor", &settings);
            rows.push(vec![
                name.to_owned(),
                force.to_string(),
                digits(axis_figure(summary, "/force/settled_rms_percent", 2), 3),
                digits(axis_figure(summary, "/force/sliding_rms_percent", 2), 3),
                digits(largest(summary, "/tracking/max_ratio"), 2),
                digits(largest(summary, "/force_command/max_ratio"), 2),
            ]);
        }
    }
    table(&head, &rows)
}

fn tracking(results: &ExperimentResults) -> String {
    let head = [
        "scenario",
        "axis",
        "max \\|F_c\\| / F_max",
        "at F_max, s",
        "max \\|x - x_d\\| / x_b",
        "rms",
        "outside x_b, s",
        "F_c at F_max, s",
        "torque cut, s",
        "force held, s",
        "converging, s",
        "no command, s",
        "unexplained, s",
    ];
    let mut rows = Vec::new();
    for scenario in SCENARIOS {
        let summary = results.summary(scenario, &[]);
        for (axis, name) in AXES.iter().enumerate() {
            let outside = |figure: &str| seconds(axis_figure(summary, &format!("/tracking/outside/{figure}"), axis));
            rows.push(vec![
                format!("`{scenario}`"),
                (*name).to_owned(),
                digits(axis_figure(summary, "/force_command/max_ratio", axis), 3),
                seconds(axis_figure(summary, "/force_command/at_limit_ticks", axis)),
                digits(axis_figure(summary, "/tracking/max_ratio", axis), 3),
                digits(axis_figure(summary, "/tracking/rms_ratio", axis), 3),
                outside("ticks"),
                outside("force_limited_ticks"),
                outside("torque_limited_ticks"),
                outside("force_held_ticks"),
                outside("converging_ticks"),
                outside("inactive_ticks"),
                outside("unexplained_ticks"),
            ]);
        }
    }
    table(&head, &rows)
}

fn force(results: &ExperimentResults) -> String {
    let head = [
        "scenario",
        "law",
        "axis",
        "holds",
        "worst hold rms, % of F_d",
        "its F_d, N",
        "all holds, %",
        "last hold, %",
        "sliding rms, %",
        "sliding without break-away, %",
    ];
    let mut rows = Vec::new();
    for scenario in SCENARIOS {
        for (law, settings) in LAWS {
            let summary = results.summary(scenario, settings);
            for (axis, name) in AXES.iter().enumerate() {
                let figure = |figure: &str| axis_figure(summary, &format!("/force/{figure}"), axis);
                if figure("desired_n").is_none() {
                    continue;
                }
                rows.push(vec![
                    format!("`{scenario}`"),
                    law.to_owned(),
                    (*name).to_owned(),
                    digits(figure("holds"), 0),
                    digits(figure("worst_hold_rms_percent"), 3),
                    digits(figure("worst_hold_desired_n"), 0),
                    digits(figure("settled_rms_percent"), 3),
                    digits(figure("last_hold_rms_percent"), 3),
                    digits(figure("sliding_rms_percent"), 3),
                    digits(figure("steady_sliding_rms_percent"), 3),
                ]);
            }
        }
    }
    table(&head, &rows)
}

fn milestones(results: &ExperimentResults) -> String {
    let row = |milestone: verdict::Milestone| {
        let reached = if milestone.reached { "yes" } else { "**no**" };
        vec![format!("`{}`", milestone.scenario), milestone.what, milestone.figure, milestone.expected, reached.to_owned()]
    };
    let rows: Vec<_> = verdict::milestones(results).into_iter().map(row).collect();
    table(&["scenario", "milestone", "found", "expected", "reached"], &rows)
}

fn integration(results: &ExperimentResults) -> String {
    let head = [
        "scenario",
        "sub-step, us",
        "ticks in contact",
        "contact sub-steps",
        "Newton iterations a sub-step",
        "unconverged",
        "energy given back, mJ",
        "energy created, mJ",
    ];
    let mut rows = Vec::new();
    for scenario in SCENARIOS {
        for (substep, settings) in SUBSTEPS {
            let summary = results.summary(scenario, settings);
            let figure = |figure: &str| number(summary, &format!("/integration/{figure}"));
            rows.push(vec![
                format!("`{scenario}`"),
                substep.to_owned(),
                digits(figure("contact_ticks"), 0),
                digits(figure("contact_substeps"), 0),
                digits(figure("newton_per_contact_substep"), 3),
                digits(figure("unconverged"), 0),
                digits(figure("contact_energy_returned_j").map(|joule| joule * 1e3), 3),
                figure("contact_energy_created_j").map_or("-".to_owned(), |joule| format!("{:.0e}", joule * 1e3)),
            ]);
        }
    }
    table(&head, &rows)
}

fn improvements(results: &ExperimentResults) -> String {
    let head = [
        "scenario",
        "improvements",
        "outside x_b, s",
        "of it at rest while converging, s",
        "slowest recovery of F_d, s",
        "recovered",
        "not recovered",
        "largest force beyond F_d, N",
        "last hold rms, %",
    ];
    let mut rows = Vec::new();
    for scenario in IMPROVEMENT_SCENARIOS {
        for (name, settings) in IMPROVEMENTS {
            let summary = results.summary(scenario, settings);
            rows.push(vec![
                format!("`{scenario}`"),
                name.to_owned(),
                seconds(largest(summary, "/tracking/outside/ticks")),
                seconds(largest(summary, "/tracking/outside/standing_ticks")),
                seconds(largest(summary, "/force/slowest_recovery_ticks")),
                format!("{:.0}", sum(summary, "/force/recoveries")),
                format!("{:.0}", sum(summary, "/force/unrecovered")),
                digits(largest(summary, "/force/overshoot_n"), 1),
                digits(largest(summary, "/force/last_hold_rms_percent"), 3),
            ]);
        }
    }
    table(&head, &rows)
}

fn tuning(results: &ExperimentResults) -> String {
    let head = [
        "t, s",
        "change",
        "F_d, N",
        "on: F_z, N",
        "on: at the end, N",
        "on: settled after, s",
        "off: F_z, N",
        "off: at the end, N",
        "off: settled after, s",
    ];
    let [with, without] = TUNING_SETTINGS.map(|settings| results.changes(settings));
    let figures = |change: Option<&MeasuredChange>| {
        [
            change.map_or("-".to_owned(), |change| format!("{:.1} to {:.1}", change.smallest_n, change.largest_n)),
            digits(change.map(|change| change.end_n), 1),
            seconds(change.and_then(|change| change.settled_ticks).map(|ticks| ticks as f64)),
        ]
    };
    let row = |(index, change): (usize, &MeasuredChange)| {
        let mut cells = vec![seconds(Some(change.tick as f64)), change.what.clone(), digits(Some(change.desired_n), 0)];
        cells.extend(figures(Some(change)));
        cells.extend(figures(without.get(index)));
        cells
    };
    let rows: Vec<_> = with.iter().enumerate().map(row).collect();
    table(&head, &rows)
}
