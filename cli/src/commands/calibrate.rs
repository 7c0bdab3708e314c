//! `hapfic calibrate`: gains that a robot bears, as a `[controller]` section with reasons.

use crate::{CommandOutcome, log_line, print};
use anyhow::{Context, Result};
use clap::Args;
use hapfic_config::Settings;
use hapfic_robot::{Chain, RobotError, ends};
use hapfic_simulation::calibrate::{Calibration, calibrate as find, start_posture};
use std::fmt::Write;
use std::path::Path;

/// Inertia below which a wrist lacks its rotors, probably [kg m^2].
const LIGHT_WRIST_KG_M2: f64 = 2e-3;

/// Joints from which on a description is calibrated for a pose.
const POSE_JOINTS: usize = 6;

/// Arguments of `calibrate`.
#[derive(Args, Debug)]
pub struct CalibrateArgs {
    /// Scenario (name or file), or robot description: a URDF file, or the name of an embedded one such as arm7.urdf.
    what: String,
    /// First link of the chain; only for a description. Default: the link that no joint moves.
    #[arg(long, value_name = "LINK")]
    base: Option<String>,
    /// Last link of the chain; only for a description. Default: the only link without further joints.
    #[arg(long, value_name = "LINK")]
    tip: Option<String>,
    /// Start posture [rad]; only for a description. Default: one far from limits and singularities.
    #[arg(long, value_name = "Q1,Q2,...", value_delimiter = ',', allow_hyphen_values = true)]
    posture: Option<Vec<f64>>,
    /// Force to hold on z [N]. Default: the largest of the scenario, or 20.
    #[arg(long, value_name = "N")]
    force: Option<f64>,
    /// Replace a value of the scenario: `controller.task=pose`, `robot.armature_kg_m2=0.1`.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Prints gains for a robot.
pub fn calibrate(args: &CalibrateArgs) -> Result<CommandOutcome> {
    let settings = match load(args) {
        Ok(settings) => settings,
        Err(error) => return Ok(CommandOutcome::Rejected(error)),
    };
    if let Some(force) = args.force.filter(|force| !(force.is_finite() && *force > 0.0)) {
        return Ok(CommandOutcome::Rejected(anyhow::anyhow!("--force: found {force}, expected a positive number of newtons")));
    }
    match find(&settings, args.force) {
        Ok(found) => {
            if let Ok(chain) = Chain::from_settings(&settings.robot) {
                chain.warnings().iter().for_each(|warning| log_line(&format!("hapfic: {warning}")));
            }
            print(section(args, &settings, &found)?.trim_end());
            let verified = found.reserve && found.unsteady.is_empty();
            Ok(if verified { CommandOutcome::Done } else { CommandOutcome::NotGoodEnough })
        }
        Err(error) => Ok(CommandOutcome::Rejected(anyhow::anyhow!("{}: {error}", args.what))),
    }
}

fn load(args: &CalibrateArgs) -> Result<Settings> {
    let embedded = hapfic_config::robots().iter().find(|(name, _)| *name == args.what);
    let file = Path::new(&args.what).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("urdf"));
    if embedded.is_none() && !file {
        for (option, given) in
            [("--base", args.base.is_some()), ("--tip", args.tip.is_some()), ("--posture", args.posture.is_some())]
        {
            anyhow::ensure!(!given, "{option}: found beside a scenario, which decides it; expected a robot description (.urdf)");
        }
        return Ok(Settings::load(&args.what, &args.set)?);
    }
    let text = match embedded {
        Some((_, text)) => (*text).to_owned(),
        None => std::fs::read_to_string(&args.what).with_context(|| {
            let names: Vec<&str> = hapfic_config::robots().iter().map(|(name, _)| *name).collect();
            format!(
                "{}: found no file that can be read, expected one, or an embedded description: {}",
                args.what,
                names.join(", ")
            )
        })?,
    };
    let (roots, leaves) = ends(&text, &args.what)?;
    let one = |option: &str, given: &Option<String>, all: &[String]| match (given, all) {
        (Some(link), _) => Ok(link.clone()),
        (None, [only]) => Ok(only.clone()),
        (None, several) => Err(anyhow::anyhow!(
            "{}: found {} links where the chain could end, expected {option} with one of {}",
            args.what,
            several.len(),
            several.join(", ")
        )),
    };
    let (base, tip) = (one("--base", &args.base, &roots)?, one("--tip", &args.tip, &leaves)?);
    let load = |posture: &[f64]| -> Result<Settings> {
        let mut scenario = format!("{}\n", robot_section(&args.what, &base, &tip, posture));
        if posture.len() >= POSE_JOINTS && !args.set.iter().any(|set| set.trim_start().starts_with("controller.task")) {
            scenario.push_str("[controller]\ntask = \"pose\"\n");
        }
        Ok(Settings::from_str(&scenario, "calibrate", embedded.is_none().then(|| Path::new("")), &args.set)?)
    };
    if let Some(posture) = &args.posture {
        return load(posture);
    }
    // What --set gives the robot counts for its chain. A first posture of one joint finds out how many there are.
    let first = load(&[0.0])?;
    let chain = match Chain::from_settings(&first.robot) {
        Ok(chain) => chain,
        Err(RobotError::PerJoint { joints, .. }) => Chain::from_settings(&load(&vec![0.0; joints])?.robot)?,
        Err(error) => return Err(error.into()),
    };
    load(&start_posture(&chain))
}

/// The `[robot]` section of a description.
fn robot_section(what: &str, base: &str, tip: &str, posture: &[f64]) -> String {
    format!(
        "[robot]\nurdf = {}\nbase_link = {}\ntip_link = {}\nstart_position_rad = {posture:?}",
        toml_string(what),
        toml_string(base),
        toml_string(tip)
    )
}

/// The `[robot]` tables of a scenario, with all that `--set` gave the robot.
fn robot_tables(scenario: &str) -> String {
    let mut inside = false;
    let mut lines = Vec::new();
    for line in scenario.lines() {
        if line.starts_with('[') {
            inside = line.starts_with("[robot]") || line.starts_with("[robot.");
        }
        if inside {
            lines.push(line);
        }
    }
    lines.join("\n").trim_end().to_owned()
}

/// A string of TOML.
fn toml_string(text: &str) -> String {
    let escaped: String = text
        .chars()
        .map(|c| match c {
            '"' | '\\' => format!("\\{c}"),
            c if c.is_control() => format!("\\u{:04X}", c as u32),
            c => c.to_string(),
        })
        .collect();
    format!("\"{escaped}\"")
}

/// The section, with its reasons as comments.
fn section(args: &CalibrateArgs, settings: &Settings, found: &Calibration) -> Result<String> {
    let (set, mode) = (&found.set, &found.mode);
    let mut out = String::new();
    let vector = |v: [f64; 3]| format!("[{}, {}, {}]", v[0], v[1], v[2]);
    let finite = |v: f64| if v.is_finite() { format!("{v:.3}") } else { "unlimited".to_owned() };
    writeln!(out, "# hapfic calibrate {}: {} postures, one tick of dead time", args.what, found.postures)?;
    writeln!(out, "# start posture: {:?} rad", settings.robot.start_position)?;
    let m = &found.masses;
    let [x, y, z] = m.axes_kg.map(finite);
    writeln!(
        out,
        "# effective mass at the tip, least of all postures: x {x}, y {y}, z {z} kg; in any direction {} kg",
        finite(m.least_kg)
    )?;
    if set.rotation.is_some() {
        writeln!(out, "# effective inertia about the least axis: {:.5} kg m^2", m.least_kg_m2)?;
        if m.least_kg_m2 < LIGHT_WRIST_KG_M2 {
            writeln!(out, "# that is little: a URDF has no rotors. Give them as robot.armature_kg_m2, and the robot bears more")?;
        }
    }
    writeln!(
        out,
        "# limiting mode: {:.1} Hz, damping ratio {:.2}, mostly {}: omega tau at {:.0} % of its limit",
        mode.frequency_hz,
        mode.zeta,
        mode.axis(),
        100.0 * mode.margin
    )?;
    let verdict = if found.margin_one_more < 1.0 { "still stable" } else { "not stable" };
    writeln!(out, "# with one more tick of dead time: {:.0} %, {verdict}", 100.0 * found.margin_one_more)?;
    let reserve = if found.reserve { "settles" } else { "does NOT settle" };
    writeln!(out, "# free air, simulated: {reserve} with 1.4 times the stiffness")?;
    match found.pressed_n {
        None => writeln!(
            out,
            "# walls: not tried: the tip has no shape to press with; give it one as --set 'robot.foot={{radius_m=0.02}}'"
        )?,
        Some(force) if found.unsteady.is_empty() => {
            writeln!(out, "# walls of 1e4, 1e5 and 1e6 N/m at damping ratios 0.3 and 0.1: {force} N held within 3 % on all")?;
        }
        Some(force) => {
            for (stiffness, ratio, error) in &found.unsteady {
                writeln!(
                    out,
                    "# NOT steady under {force} N on a wall of {stiffness:e} N/m, damping ratio {ratio}: {:.0} %",
                    100.0 * error
                )?;
            }
        }
    }
    if found.pressed_n.is_some_and(|pressed| pressed < found.asked_n) {
        writeln!(out, "# less than the {} N asked for: 0.8 of F_max, which effort or K0 x_b limit", found.asked_n)?;
    }
    if !found.reserve || !found.unsteady.is_empty() {
        writeln!(
            out,
            "# NOT verified: give the rotors (robot.armature_kg_m2), joint damping, or a posture further from its limits"
        )?;
    }
    if set.rotation.is_none() && settings.robot.start_position.len() >= POSE_JOINTS {
        writeln!(out, "# a position task; for the orientation, too: --set controller.task=pose")?;
    }
    if found.lowered > 0 {
        writeln!(out, "# the rule allowed more: lowered {} times by 0.7, since a simulation did not settle", found.lowered)?;
    }
    if Path::new(&args.what).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("urdf")) {
        writeln!(out, "{}\n", robot_tables(&settings.effective_toml()))?;
    }
    writeln!(out, "[controller]")?;
    let row =
        |out: &mut String, key: &str, value: String, reason: &str| writeln!(out, "{:<52} # {reason}", format!("{key} = {value}"));
    if set.rotation.is_some() {
        row(&mut out, "task", "\"pose\"".to_owned(), "position and orientation")?;
    }
    row(&mut out, "stiffness_n_per_m", vector(set.stiffness), "N/m, what the limiting mode bears, at most 12000")?;
    row(&mut out, "max_force_n", vector(set.max_force), "N, 0.95 K0 x_b, or 0.8 of the joints' effort beside the weight")?;
    row(&mut out, "position_bound_m", vector(set.position_bound), "m, reaches twice the force")?;
    row(
        &mut out,
        "damping_sqrt_kg",
        set.damping.to_string(),
        "kg^(1/2), damping ratio 0.35 at the largest mass, as far as the least bears it",
    )?;
    if let Some(r) = &set.rotation {
        row(
            &mut out,
            "rotation_stiffness_n_m_per_rad",
            vector(r.rotation_stiffness),
            "N m/rad, what the limiting mode bears, at most 100",
        )?;
        row(&mut out, "max_moment_n_m", vector(r.max_moment), "N m, 0.95 K_R x_b,R")?;
        row(&mut out, "rotation_bound_rad", vector(r.rotation_bound), "rad")?;
        row(&mut out, "rotation_damping_sqrt_kg_m", r.rotation_damping.to_string(), "kg^(1/2) m, by the same rule")?;
    }
    row(&mut out, "gravity_compensation", set.gravity_compensation.to_string(), "on above three joints by default")?;
    Ok(out)
}
