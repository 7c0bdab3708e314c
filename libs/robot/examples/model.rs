//! Prints kinematics and dynamics of a chain as JSON, for a comparison with another library.
//!
//! `model FILE BASE TIP [POSTURES]`: POSTURES (default 3) postures within the joint limits. The program ends with 2 and the
//! message of `hapfic check` if the description is refused.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use hapfic_config::JointValues;
use hapfic_robot::{Chain, Replacements, RobotError, TaskRows};
use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};
use std::process::ExitCode;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [file, base, tip, rest @ ..] = words.as_slice() else {
        eprintln!("usage: model FILE BASE TIP [POSTURES]");
        return ExitCode::from(2);
    };
    let count = rest.first().and_then(|text| text.parse().ok()).unwrap_or(3);
    let text = match std::fs::read(file) {
        Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
        Err(error) => {
            eprintln!("{file}: {error}");
            return ExitCode::from(2);
        }
    };
    // As a scenario would complete a description without efforts: the first try is the file as shipped.
    let (chain, completed) = match Chain::from_urdf(&text, file, base, tip) {
        Ok(chain) => (chain, false),
        Err(RobotError::Effort { .. }) => {
            let with = |n: usize| {
                let effort = JointValues::InOrder(vec![100.0; n]);
                let replacements = Replacements { effort_limit: Some(&effort), ..Replacements::default() };
                Chain::from_urdf_with(&text, file, base, tip, &replacements)
            };
            // A list of the wrong length says how many joints there are.
            let joints = if let Err(RobotError::PerJoint { joints, .. }) = with(0) { joints } else { 1 };
            match with(joints) {
                Ok(chain) => (chain, true),
                Err(error) => {
                    eprintln!("{error}");
                    return ExitCode::from(2);
                }
            }
        }
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::from(2);
        }
    };
    let postures: Vec<Value> = (0..count).map(|index| posture(&chain, index)).collect();
    let joints: Vec<&str> = chain.joints().iter().map(|joint| joint.name.as_str()).collect();
    let foot = chain.collisions().iter().any(|shape| shape.link == chain.tip_link());
    println!(
        "{}",
        json!({ "joints": joints, "completed": completed, "foot": foot, "warnings": chain.warnings(), "postures": postures })
    );
    ExitCode::SUCCESS
}

fn posture(chain: &Chain, index: u32) -> Value {
    let n = chain.dof();
    let q = chain.posture(index + 1);
    let wave = |phase: f64, i: usize| (phase + 1.7 * f64::from(index) + i as f64).sin();
    let qd: Vec<f64> = (0..n).map(|i| wave(0.3, i)).collect();
    let qdd: Vec<f64> = (0..n).map(|i| 2.0 * wave(1.1, i)).collect();
    let mut tau = [0.0; hapfic_robot::MAX_JOINTS];
    tau.iter_mut().enumerate().take(n).for_each(|(i, tau)| *tau = wave(2.2, i));
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let kin = chain.kinematics(&q);
    let (mass, jacobian) = (chain.mass_matrix(&kin), chain.jacobian(&kin));
    let rotation: Matrix3<f64> = kin.tip_rotation();
    let rows = |part: &[Vector3<f64>]| -> Vec<Vec<f64>> { (0..3).map(|row| (0..n).map(|i| part[i][row]).collect()).collect() };
    let six: Vec<Vec<f64>> = rows(&jacobian.linear).into_iter().chain(rows(&jacobian.angular)).collect();
    let rows = if n > 6 { TaskRows::Both } else { TaskRows::Linear };
    json!({
        "q": q[..n], "qd": qd, "qdd": qdd, "tau": tau[..n],
        "position": kin.tip_position().as_slice(),
        "rotation": (0..3).map(|i| (0..3).map(|j| rotation[(i, j)]).collect::<Vec<_>>()).collect::<Vec<_>>(),
        "jacobian": six,
        "mass": (0..n).map(|i| (0..n).map(|j| mass[(i, j)]).collect::<Vec<_>>()).collect::<Vec<_>>(),
        "gravity": chain.gravity_torque(&kin, &gravity)[..n],
        "inverse_dynamics": chain.inverse_dynamics(&kin, &qd, &qdd, &gravity)[..n],
        "null_rows": rows.count(),
        "null_space": chain.null_space_torque(&mass, &jacobian, rows, &tau)[..n],
    })
}
