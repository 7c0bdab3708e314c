//! Margins of the default law: dead time and mass of the plant.

use crate::case::{Case, Condition, LAWS};
use crate::outcome::outcome_with;
use hapfic_config::Settings;
use hapfic_simulation::{DeadTime, stability};

/// Factors of all masses and inertias.
const MASSES: [f64; 3] = [0.7, 1.0, 1.3];

/// Table of the margins.
pub(crate) fn table() -> Result<String, String> {
    let mut text = "| dead time, ticks | mass | free air | k = 1e6, b = 0.01 s k: settled, % | settling, s | k = 1e5, ratio 0.1: settled, % | settling, s |\n".to_owned();
    text.push_str(&format!("|{}\n", "---|".repeat(7)));
    let normal = DeadTime::ALL.map(|dead_time| (dead_time, 1.0));
    let heavy = MASSES.map(|mass| (DeadTime::One, mass)).into_iter().filter(|(_, mass)| *mass != 1.0);
    for (dead_time, mass) in normal.into_iter().chain(heavy) {
        let mut line = format!("| {} | {mass} |", dead_time as u8);
        let settings = scaled(Settings::load("floor", &[]).map_err(|e| e.to_string())?, mass);
        let air = stability::settles(&settings, &settings.initial, dead_time).map_err(|e| e.to_string())?;
        line.push_str(&if air.settles {
            " rests |".to_owned()
        } else {
            format!(" oscillates, {:.1} mm |", 1e3 * air.amplitude_m)
        });
        for (stiffness, ratio) in [(1e6, None), (1e5, Some(0.1))] {
            let case = Case { law: LAWS[0], stiffness, ratio, friction: 0.0, force: 50.0, condition: Condition::Plain };
            let found = outcome_with(&case, &scaled(case.settings(), mass), dead_time)?;
            let settling = if found.settling_s.is_finite() { format!("{:.2}", found.settling_s) } else { "never".to_owned() };
            line.push_str(&format!(" {:.3} | {settling} |", 100.0 * found.settled));
        }
        text.push_str(&line);
        text.push('\n');
    }
    Ok(text)
}

/// Settings with all masses and inertias of the robot multiplied.
fn scaled(mut settings: Settings, factor: f64) -> Settings {
    for attribute in [" mass value=\"", "<mass value=\"", "ixx=\"", "ixy=\"", "ixz=\"", "iyy=\"", "iyz=\"", "izz=\""] {
        let mut rest = std::mem::take(&mut settings.robot.urdf.text);
        while let Some(at) = rest.find(attribute) {
            let start = at + attribute.len();
            let end = start + rest[start..].find('"').expect("an attribute ends");
            let value: f64 = rest[start..end].trim().parse().expect("an attribute is a number");
            settings.robot.urdf.text.push_str(&rest[..start]);
            settings.robot.urdf.text.push_str(&format!("{:e}", value * factor));
            rest = rest.split_off(end);
        }
        settings.robot.urdf.text.push_str(&rest);
    }
    settings
}
