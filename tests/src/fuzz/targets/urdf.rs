//! Target `urdf`: robot descriptions in XML.

use super::config::simulated;
use crate::fuzz::target::{FuzzOutcome, FuzzTarget};
use hapfic_config::{Settings, robots};
use hapfic_messages::Check;
use hapfic_robot::{Chain, MAX_JOINTS};
use nalgebra::Vector3;
use std::path::Path;

pub(super) const TARGET: FuzzTarget = FuzzTarget {
    name: "urdf",
    seeds,
    dictionary: &[
        "<robot name=\"leg\">",
        "</robot>",
        "<link name=\"base\"/>",
        "<link name=\"foot\">",
        "</link>",
        "<joint name=\"j\" type=\"fixed\">",
        "</joint>",
        "<parent link=\"base\"/>",
        "<child link=\"foot\"/>",
        "<origin xyz=\"0 0 1\" rpy=\"0 1 0\"/>",
        "<axis xyz=\"0 1 0\"/>",
        "<axis xyz=\"0 0 0\"/>",
        "<limit lower=\"-1\" upper=\"1\" effort=\"9\" velocity=\"9\"/>",
        "<dynamics damping=\"0.1\"/>",
        "<mimic joint=\"haa\"/>",
        "<inertial>",
        "</inertial>",
        "<mass value=\"1\"/>",
        "<inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/>",
        "<collision>",
        "</collision>",
        "<geometry>",
        "</geometry>",
        "<sphere radius=\"0.1\"/>",
        "<box size=\"1 1 1\"/>",
        "<cylinder radius=\"1\" length=\"1\"/>",
        "<capsule radius=\"1\" length=\"1\"/>",
        "<mesh filename=\"a.stl\"/>",
        "revolute",
        "continuous",
        "prismatic",
        "fixed",
        "floating",
        "planar",
        "base",
        "foot",
        "hip",
        "thigh",
        "shank",
        "haa",
        "hfe",
        "kfe",
        "&amp;",
        "&#0;",
        "<![CDATA[",
        "]]>",
        "<?xml version=\"1.0\"?>",
        "<!DOCTYPE a>",
    ],
    text: true,
    max_bytes: 32 * 1024,
    execute,
};

/// Setting of a floor so deep that no posture of the leg reaches it.
const DEEP: &str = "world.floor.height_m=-0.2";
/// Posture, and velocity and acceleration too [rad, rad/s, rad/s^2].
const POSTURE: [f64; MAX_JOINTS] = [0.3, -0.4, 0.5, -0.6, 0.7, -0.8, 0.9, -1.0, 0.2, -0.3, 0.4, -0.5, 0.6, -0.7, 0.8, -0.9];

fn seeds() -> Vec<Vec<u8>> {
    robots().iter().map(|(_, text)| text.as_bytes().to_vec()).collect()
}

fn floor() -> Settings {
    thread_local! {
        static FLOOR: Settings = Settings::load("floor", &[DEEP.to_owned()]).expect("an embedded scenario");
    }
    FLOOR.with(Clone::clone)
}

fn execute(input: &[u8], _: &Path) -> FuzzOutcome {
    let mut settings = floor();
    settings.robot.urdf.name = "fuzz.urdf".to_owned();
    settings.robot.urdf.text = String::from_utf8_lossy(input).into_owned();
    let chain = match Chain::from_settings(&settings.robot) {
        Ok(chain) => chain,
        Err(error) => return FuzzOutcome::Rejected(error.to_string()),
    };
    let n = chain.dof();
    assert!((1..=MAX_JOINTS).contains(&n), "{n} joints");
    let kin = chain.kinematics(&POSTURE[..n]);
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    let _ = chain.mass_matrix(&kin);
    let _ = chain.jacobian(&kin);
    let _ = chain.inverse_dynamics(&kin, &POSTURE[..n], &POSTURE[..n], &gravity);
    settings.robot.start_position = chain.joints().iter().map(|joint| 0.0_f64.clamp(joint.lower, joint.upper)).collect();
    match simulated(&settings) {
        // Lengths and masses near the largest number overflow, and then the plant publishes an invalid state.
        Ok(plant) => match plant.sample().check() {
            Ok(()) => FuzzOutcome::Accepted,
            Err(error) => FuzzOutcome::Rejected(format!("the first state: {error}")),
        },
        Err(message) => FuzzOutcome::Rejected(message),
    }
}
