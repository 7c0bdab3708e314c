//! Findings about a scenario as a whole: entries after its end, gravity upwards, angles in degrees.

use super::{Advisor, Finding, number, vector};
use hapfic_config::{Diagnostic, Location, PERIOD_S};
use hapfic_robot::JointKind;
use std::f64::consts::TAU;

impl Advisor {
    /// Findings that concern no parameter set.
    pub(super) fn script(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        self.gravity_upwards(&mut findings);
        self.angles(&mut findings);
        self.after_end(&mut findings);
        findings
    }

    fn at(&self, key: &str, [found, expected, help]: [String; 3]) -> Finding {
        let key = key.to_owned();
        Finding::new(Diagnostic { place: self.settings.place(&key), key, found, expected, help }, false)
    }

    fn gravity_upwards(&self, findings: &mut Vec<Finding>) {
        if self.gravity.z > 0.0 {
            let found = format!("{} m/s^2, which points upwards", vector(self.gravity.into()));
            let help = "z points up: weight is [0, 0, -9.81]".to_owned();
            findings.push(self.at("world.gravity_m_per_s2", [found, "a gravity that points down".to_owned(), help]));
        }
    }

    /// Angles beyond a full turn, which look like degrees.
    fn angles(&self, findings: &mut Vec<Finding>) {
        let robot = &self.settings.robot;
        let rotate = self.chain.joints().iter().map(|joint| joint.kind != JointKind::Prismatic);
        let joints: Vec<f64> = robot.start_position.iter().zip(rotate).filter(|(_, rotates)| *rotates).map(|(q, _)| *q).collect();
        for (key, angles) in
            [("robot.start_position_rad", &joints[..]), ("robot.base_orientation_rpy_rad", &robot.base_orientation_rpy_rad)]
        {
            if let Some(help) = degrees_hint(angles) {
                let most = angles.iter().fold(0.0_f64, |most, angle| most.max(angle.abs()));
                let found = format!("an angle of {} rad, more than a full turn", number(most));
                findings.push(self.at(key, [found, "angles within 2 pi".to_owned(), help]));
            }
        }
    }

    /// Entries that never take effect. A run that `--duration` or `--set` cuts short is meant to leave some out.
    fn after_end(&self, findings: &mut Vec<Finding>) {
        if matches!(self.settings.place("duration_s"), Location::Override(_)) {
            return;
        }
        let seconds = |ticks: i64| number(ticks as f64 * PERIOD_S);
        let end = self.settings.duration_ticks as i64;
        for (index, change) in self.settings.operator.iter().enumerate() {
            if change.at_tick >= end {
                let found = format!("{} s, after the end of the run", seconds(change.at_tick));
                let expected = format!("less than duration_s = {}", seconds(end));
                let help = "the entry never takes effect: lengthen the run, or remove the entry".to_owned();
                findings.push(self.at(&self.settings.parameter_key(Some(index), "at_s"), [found, expected, help]));
            }
        }
    }
}

/// Hint at angles that look like degrees: one of them is beyond a full turn.
#[must_use]
pub fn degrees_hint(angles: &[f64]) -> Option<String> {
    let degrees = angles.iter().any(|angle| angle.abs() > TAU);
    degrees.then(|| {
        let rad: Vec<String> = angles.iter().map(|angle| number(angle.to_radians())).collect();
        format!("angles are in rad: if these are degrees, write [{}]", rad.join(", "))
    })
}
