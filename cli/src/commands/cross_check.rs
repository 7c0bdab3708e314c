//! `hapfic cross-check`: the same scenario in both physics engines, and in an external plant.

use crate::{CommandOutcome, print};
use anyhow::{Context, Result, ensure};
use clap::Args;
use hapfic_config::Settings;
use hapfic_log::MetricsSummary;
use hapfic_plant::Plant;
use hapfic_simulation::study::{End, study};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Softness of rapier's contacts, where nobody gives one.
const SOFTNESS: &str = "plant.softness={ frequency_hz = 100.0, damping_ratio = 1.0 }";

/// Arguments of `hapfic cross-check`.
#[derive(Args, Debug)]
pub struct CrossCheckArgs {
    /// Names of embedded scenarios, or paths of files.
    #[arg(default_values = ["floor", "box", "ball", "ball-actuators", "arm-press"])]
    pub scenarios: Vec<String>,
    /// Simulated time of each run; replaces the scenario's [s].
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Command of an external plant for a third column, run in lockstep: `python3 python/examples/mujoco_plant.py`.
    #[arg(long, value_name = "COMMAND")]
    pub plant: Option<String>,
    /// Replace a value, in both engines; `plant.softness` and `plant.rapier_substep_us` in rapier alone.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// Simulates each scenario in both engines, and prints what came out side by side.
pub fn cross_check(args: &CrossCheckArgs) -> Result<CommandOutcome> {
    let mut cases = Vec::new();
    for scenario in &args.scenarios {
        match [false, true].map(|rapier| load(scenario, args, rapier)) {
            [Ok(own), Ok(rapier)] => cases.push((scenario, [own, rapier])),
            [Err(e), _] | [_, Err(e)] => return Ok(CommandOutcome::Rejected(e)),
        }
    }
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register_conditional_shutdown(signal, 3, Arc::clone(&stop)).context("cannot handle signals")?;
        signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot handle signals")?;
    }
    let external = args.plant.as_deref().map(|command| command.split_whitespace().map(str::to_owned).collect::<Vec<_>>());
    print(if external.is_some() {
        "| scenario | figure | hapfic | rapier | external | |\n|---|---|---|---|---|---|"
    } else {
        "| scenario | figure | hapfic | rapier | |\n|---|---|---|---|---|"
    });
    let mut completed = true;
    for (scenario, settings) in &cases {
        let mut metrics = Vec::new();
        for settings in settings {
            let done = study(settings, &stop, None)?;
            completed &= done.end == End::Completed;
            metrics.push(done.metrics);
        }
        if let Some(command) = &external {
            metrics.push(run_external(scenario, args, command)?);
        }
        for row in rows(&metrics) {
            let differs = if row.by_law { "the contact law's" } else { "" };
            print(&format!("| {scenario} | {} | {} | {differs} |", row.figure, row.values.join(" | ")));
        }
    }
    Ok(if completed { CommandOutcome::Done } else { CommandOutcome::Failed })
}

fn load(scenario: &str, args: &CrossCheckArgs, rapier: bool) -> Result<Settings> {
    let of_rapier = |change: &&String| change.starts_with("plant.softness") || change.starts_with("plant.rapier_");
    let mut changes: Vec<String> = args.set.iter().filter(|change| !of_rapier(change)).cloned().collect();
    if let Some(duration) = args.duration {
        changes.push(format!("duration_s={duration:?}"));
    }
    if rapier {
        let own: Vec<String> = args.set.iter().filter(of_rapier).cloned().collect();
        changes.push("plant.engine=\"rapier\"".to_owned());
        if !own.iter().any(|change| change.starts_with("plant.softness")) {
            changes.push(SOFTNESS.to_owned());
        }
        changes.extend(own);
    }
    let settings = Settings::load(scenario, &changes)?;
    Plant::new(&settings).with_context(|| scenario.to_owned())?;
    Ok(settings)
}

/// Runs a scenario in lockstep with an external plant, as `hapfic run` does.
fn run_external(scenario: &str, args: &CrossCheckArgs, command: &[String]) -> Result<MetricsSummary> {
    let folder = Folder::new()?;
    let (log, summary) = (folder.0.join("run.mcap"), folder.0.join("summary.json"));
    let mut run = hapfic_supervisor::children::this_program()?;
    run.args(["run", scenario, "--clock", "lockstep", "--log"]).arg(&log).arg("--summary-json").arg(&summary);
    if let Some(duration) = args.duration {
        run.args(["--duration", &format!("{duration:?}")]);
    }
    for change in args.set.iter().filter(|change| !change.starts_with("plant.softness") && !change.starts_with("plant.rapier_")) {
        run.args(["--set", change]);
    }
    run.args(["--set", &format!("processes.plant={}", serde_json::to_string(command)?)]);
    let done = run.output().context("cannot run the scenario")?;
    ensure!(
        done.status.success(),
        "{scenario} with the external plant: {}",
        String::from_utf8_lossy(&done.stderr).lines().last().unwrap_or("failed without a message")
    );
    let all: serde_json::Value = serde_json::from_slice(&std::fs::read(&summary)?)?;
    let part = |name: &str| all.get(name).cloned().unwrap_or_default();
    Ok(MetricsSummary {
        tracking: serde_json::from_value(part("tracking"))?,
        force: serde_json::from_value(part("force"))?,
        force_command: serde_json::from_value(part("force_command"))?,
        moments: serde_json::from_value(part("moments"))?,
        ..MetricsSummary::default()
    })
}

/// A folder for a run, removed with all that is in it.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Result<Self> {
        let path = std::env::temp_dir().join(format!("hapfic-cross-check-{}", std::process::id()));
        std::fs::create_dir(&path).with_context(|| format!("cannot make the folder {}", path.display()))?;
        Ok(Self(path))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What remains is in the folder for temporary files.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A figure in each engine.
struct Row {
    figure: String,
    values: Vec<String>,
    /// Whether it depends on depth and damping of the contacts, which the engines do not share.
    by_law: bool,
}

fn rows(metrics: &[MetricsSummary]) -> Vec<Row> {
    let own = &metrics[0];
    let mut rows = Vec::new();
    let mut add = |figure: String, by_law: bool, of: &dyn Fn(&MetricsSummary) -> Option<String>| {
        let values: Vec<_> = metrics.iter().map(of).collect();
        if values.iter().any(Option::is_some) {
            let values = values.into_iter().map(|value| value.unwrap_or_else(|| "-".to_owned())).collect();
            rows.push(Row { figure, values, by_law });
        }
    };
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let percent = |value: Option<f64>| value.map(|value| format!("{value:.3}"));
        add(format!("settled force on {name}, % of F_d"), false, &|m| percent(m.force.last_hold_rms_percent[axis]));
        add(format!("the worst hold on {name}, %"), true, &|m| percent(m.force.worst_hold_rms_percent[axis]));
        add(format!("sliding on {name}, %"), true, &|m| percent(m.force.sliding_rms_percent[axis]));
    }
    add("tracking rms in x, y, z, mm".to_owned(), true, &|m| {
        Some(m.tracking.rms_m.map(|value| format!("{:.2}", value * 1e3)).join(", "))
    });
    add("ticks with F_c above F_max".to_owned(), false, &|m| Some(m.force_command.above_limit_ticks.to_string()));
    add("largest F_c / F_max".to_owned(), true, &|m| {
        Some(format!("{:.3}", m.force_command.max_ratio.into_iter().fold(0.0, f64::max)))
    });
    for (index, pair) in own.moments.contacts.iter().enumerate() {
        let same = |m: &MetricsSummary| {
            let all = m.moments.contacts.iter();
            let found = all.clone().find(|other| (other.body, other.against) == (pair.body, pair.against));
            found.map(|pair| format!("{:.0}", pair.peak_n))
        };
        if index < 4 {
            add(format!("largest force {} on {}, N", pair.body, pair.against), true, &same);
        }
    }
    for object in own.moments.objects.iter() {
        let same = |m: &MetricsSummary| {
            let found = m.moments.objects.iter().find(|other| other.name == object.name)?;
            Some(format!("{:.1} deg, {:.1} mm", found.max_turn_deg, found.max_displacement_m * 1e3))
        };
        add(format!("largest turn and way of {}", object.name), true, &same);
    }
    rows
}
