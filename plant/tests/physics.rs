//! The plant against conservation laws, theory, and references of the same law at far smaller steps.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use hapfic_config::Settings;
use hapfic_messages::{Command, MAX_JOINTS, Mode};
use hapfic_plant::{ContactLaw, DriveAction, Plant};
use nalgebra::{DMatrix, DVector, Vector3};

fn floor(overrides: &[&str]) -> Plant {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_owned()).collect();
    Plant::new(&Settings::load("floor", &overrides).unwrap()).unwrap()
}

const LAW: ContactLaw = ContactLaw {
    stiffness: 1e6,
    damping: 1e4,
    transition_width: 1e-3,
    friction_static: 0.0,
    friction_dynamic: 0.0,
    critical_speed: 1e-3,
};

#[test]
fn leg_free_flight_keeps_energy() {
    // High above the floor, and fast enough to pass through the whole workspace.
    let mut plant = floor(&["robot.base_position_m=[0, 0, 5]", "robot.start_position_rad=[0.3, 0.9, -1.2]"]);
    let world = plant.world();
    world.qd[..3].copy_from_slice(&[1.0, -2.0, 1.5]);
    // Zero of the energy: the leg hangs straight down, its lowest posture.
    let lowest = {
        let mut hanging = floor(&["robot.base_position_m=[0, 0, 5]", "robot.start_position_rad=[0, 0, 0]"]);
        hanging.world().q[0] = 0.0;
        hanging.world().energy()
    };
    let before = plant.world().energy() - lowest;
    let (mut worst, mut contact) = (0.0_f64, 0);
    for _ in 0..5000 {
        let world = plant.world();
        let advance = world.advance(DriveAction::Torque([0.0; MAX_JOINTS]), 1000);
        contact += advance.physics.newton_iterations;
        // Joint stops dissipate energy: measure the flight between them alone.
        worst = worst.max(((world.energy() - lowest) / before - 1.0).abs());
        if contact > 0 {
            break;
        }
    }
    assert_eq!(contact, 0, "the leg reached a stop: choose another start");
    assert!(worst < 1e-9, "energy drifts by {worst:e} of {before} J");
}

#[test]
fn leg_joint_damping_energy_falls() {
    let mut plant = floor(&["robot.base_position_m=[0, 0, 5]", "robot.joint_damping_n_m_s_per_rad=0.5"]);
    plant.world().qd[..3].copy_from_slice(&[1.0, -2.0, 1.5]);
    let mut energy = plant.world().energy();
    for tick in 0..2000 {
        plant.world().advance(DriveAction::Torque([0.0; MAX_JOINTS]), 1000);
        let now = plant.world().energy();
        assert!(now < energy, "tick {tick}: {now} after {energy}");
        energy = now;
    }
}

#[test]
fn leg_any_joint_damping_is_stable() {
    for damping in ["11.46", "100", "1e4"] {
        let set = format!("robot.joint_damping_n_m_s_per_rad={damping}");
        let mut plant = floor(&["robot.base_position_m=[0, 0, 5]", &set]);
        plant.world().qd[..3].copy_from_slice(&[3.0, -5.0, 4.0]);
        let mut energy = plant.world().energy();
        for tick in 0..300 {
            plant.world().advance(DriveAction::Torque([0.0; MAX_JOINTS]), 1000);
            let now = plant.world().energy();
            assert!(now <= energy, "damping {damping}, tick {tick}: {now} after {energy}");
            energy = now;
        }
    }
}

/// A vertical slider of 2 kg with a sphere of 20 mm at its end, between stops 0.3 m apart.
const SLIDER: &str = r#"<robot name="slider">
  <link name="rail"/>
  <joint name="lift" type="prismatic"><parent link="rail"/><child link="rod"/><axis xyz="0 0 1"/>
    <limit lower="-0.2" upper="0.1" effort="500" velocity="5"/></joint>
  <link name="rod"><inertial><mass value="2"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="end" type="fixed"><parent link="rod"/><child link="foot"/></joint>
  <link name="foot"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
</robot>"#;

fn slider(base_height: f64) -> Plant {
    let scenario = format!(
        "[robot]\nurdf = \"slider.urdf\"\nbase_link = \"rail\"\ntip_link = \"foot\"\n\
         base_position_m = [0, 0, {base_height:?}]\nstart_position_rad = [0]\n[world.floor]\n"
    );
    Plant::new(&Settings::from_effective(&scenario, "slider.urdf", SLIDER).unwrap()).unwrap()
}

#[test]
fn slider_fall_landing_and_stop_match_theory() {
    // Free fall.
    let mut plant = slider(5.0);
    for _ in 0..100 {
        plant.world().advance(DriveAction::Torque([0.0; MAX_JOINTS]), 1000);
    }
    assert!((plant.world().q[0] + 0.5 * 9.81 * 0.01).abs() < 1e-12);
    // Pressed onto its lower stop with full effort: depth within 3 mm.
    for _ in 0..2000 {
        plant.world().advance(DriveAction::Torque([-500.0; MAX_JOINTS]), 1000);
    }
    let q = plant.world().q[0];
    assert!(q < -0.2 && q > -0.203 && plant.world().qd[0].abs() < 1e-6, "{q}");
    // At rest on the floor: the sensor measures the weight.
    let mut plant = slider(0.05);
    let mut advance = hapfic_plant::TickResult::default();
    for _ in 0..2000 {
        advance = plant.world().advance(DriveAction::Torque([0.0; MAX_JOINTS]), 1000);
    }
    assert!((advance.sensed_force.z - 2.0 * 9.81).abs() < 1e-4, "{:?}", advance.sensed_force);
}

#[test]
fn leg_start_inside_floor_is_rejected() {
    let settings = Settings::load("floor", &["world.floor.height_m=0.3".to_owned()]).unwrap();
    let error = Plant::new(&settings).unwrap_err().to_string();
    assert!(error.contains("deep in floor") && error.contains("0.17"), "{error}");
}

/// Torque that presses the foot down with a force and carries the leg's weight, from the plant's own model.
fn press(plant: &mut Plant, force: f64) -> [f64; MAX_JOINTS] {
    let chain = plant.chain().clone();
    let world = plant.world();
    let kin = world.kinematics();
    let mut torque = chain.jacobian(&kin).linear_transpose_mul(&Vector3::new(0.0, 0.0, -force));
    let weight = chain.gravity_torque(&kin, &world.gravity);
    for i in 0..3 {
        // Damping: without friction nothing else slows the foot sideways.
        torque[i] += weight[i] - 2.0 * world.qd[i];
    }
    torque
}

#[test]
fn foot_pressed_has_force_and_depth_of_law() {
    // The foot just above the floor.
    let mut plant = floor(&["robot.start_position_rad=[0, 0.6, -1.2]", "robot.base_position_m=[0, 0, 0.4947]"]);
    for force in [50.0, 300.0] {
        let mut advance = hapfic_plant::TickResult::default();
        for _ in 0..3000 {
            let torque = press(&mut plant, force);
            advance = plant.world().advance(DriveAction::Torque(torque), 1000);
        }
        let sensed = advance.sensed_force;
        assert!((sensed.z / force - 1.0).abs() < 1e-3, "{force} N pressed, {sensed:?} sensed");
        assert!(sensed.x.abs() < 1e-9 && sensed.y.abs() < 1e-9, "a frictionless floor pushes sideways: {sensed:?}");
        let depth = 0.02 - plant.world().kinematics().tip_position().z;
        let theory = LAW.depth_at(sensed.z);
        assert!((depth / theory - 1.0).abs() < 1e-3, "depth {depth}, expected {theory}");
        assert_eq!(advance.contact_count, 1);
    }
}

/// Peak normal force [N] of a fall on the floor, by explicit steps of 0.1 us with the same law.
fn reference_peak(plant: &mut Plant) -> f64 {
    let chain = plant.chain().clone();
    let (mut q, mut qd) = (plant.world().q, plant.world().qd);
    let (h, mut peak) = (1e-7, 0.0_f64);
    for _ in 0..60_000 {
        let kin = chain.kinematics(&q);
        let jacobian = chain.jacobian(&kin);
        let depth = 0.02 - kin.tip_position().z;
        let rate = -jacobian.linear_mul(&qd[..3]).z;
        let force = LAW.normal(depth, rate).force;
        peak = peak.max(force);
        let mass = chain.mass_matrix(&kin);
        let bias = chain.bias(&kin, &qd[..3], &Vector3::new(0.0, 0.0, -9.81));
        let contact = jacobian.linear_transpose_mul(&Vector3::new(0.0, 0.0, force));
        let right = DVector::from_fn(3, |i, _| contact[i] - bias[i]);
        let qdd = DMatrix::from_fn(3, 3, |i, j| mass[(i, j)]).cholesky().unwrap().solve(&right);
        for i in 0..3 {
            qd[i] += h * qdd[i];
            q[i] += h * qd[i];
        }
    }
    peak
}

/// A leg whose foot is 0.5 mm above the floor and falls at 1 m/s.
fn falling(substep_us: u32) -> Plant {
    let substep = format!("plant.contact_substep_us={substep_us}");
    let mut plant = floor(&["robot.start_position_rad=[0, 0.6, -1.2]", "robot.base_position_m=[0, 0, 0.4951]", &substep]);
    let chain = plant.chain().clone();
    let world = plant.world();
    let gap = world.kinematics().tip_position().z - 0.02;
    assert!(gap > 0.0 && gap < 2e-3, "gap {gap}");
    let jacobian = chain.jacobian(&world.kinematics());
    let columns = DMatrix::from_fn(3, 3, |i, j| jacobian.linear[j][i]);
    let qd = columns.lu().solve(&DVector::from_vec(vec![0.0, 0.0, -1.0])).unwrap();
    world.qd[..3].copy_from_slice(qd.as_slice());
    plant
}

#[test]
fn leg_impact_1_m_per_s_has_reference_peak() {
    let reference = reference_peak(&mut falling(20));
    assert!(reference > 500.0, "the reference has no impact: {reference} N");
    for (substep, tolerance) in [(20, 0.01), (10, 0.003), (5, 0.001)] {
        let mut plant = falling(substep);
        let mut peak = 0.0_f64;
        for _ in 0..6 {
            peak = peak.max(plant.world().advance(DriveAction::Torque([0.0; MAX_JOINTS]), 1000).peak_normal);
        }
        let error = peak / reference - 1.0;
        println!("sub-step {substep} us: peak {peak:.1} N, reference {reference:.1} N, {:.2} %", 100.0 * error);
        assert!(error.abs() < tolerance, "sub-step {substep} us: {peak} N against {reference} N");
    }
}

#[test]
fn joint_at_limit_stops() {
    let mut plant = floor(&["robot.base_position_m=[0, 0, 5]", "robot.start_position_rad=[0, 0, -2.8]"]);
    let mut lowest = 0.0_f64;
    for _ in 0..1000 {
        plant.world().advance(DriveAction::Torque(torques([0.0, 0.0, -10.0])), 1000);
        lowest = lowest.min(plant.world().q[2]);
    }
    assert!(lowest > -2.95, "the knee went to {lowest} rad, its limit is -2.9");
    assert!(plant.world().qd[2].abs() < 0.1, "the knee still moves at {} rad/s", plant.world().qd[2]);
}

#[test]
fn drive_first_torque_releases_brakes_and_is_limited() {
    let mut plant = floor(&[]);
    let start = plant.sample();
    for _ in 0..50 {
        plant.advance().unwrap();
    }
    let held = plant.sample();
    assert_eq!((held.tick, held.joint_position), (50, start.joint_position));
    plant.take(&Command { tick: 49, mode: Mode::Active.code(), joints: 3, torque: [1e6; MAX_JOINTS], ..Command::default() });
    plant.advance().unwrap();
    assert_eq!(&plant.sample().joint_torque[..3], &[80.0; 3], "the URDF allows 80 N m");
}

#[test]
fn plant_same_commands_give_same_bits() {
    let run = || {
        let mut plant = falling(20);
        let mut out = Vec::new();
        for tick in 0..200_i64 {
            let torque = std::array::from_fn(|i| (tick as f64 * 0.1 + i as f64).sin());
            plant.take(&Command { tick: tick - 1, mode: Mode::Active.code(), torque, ..Command::default() });
            plant.advance().unwrap();
            let s = plant.sample();
            out.extend(s.joint_position.iter().chain(&s.joint_velocity).chain(&s.foot_force).map(|v| v.to_bits()));
        }
        out
    };
    assert_eq!(run(), run());
}

/// Torques of the leg's joints.
fn torques(leg: [f64; 3]) -> [f64; MAX_JOINTS] {
    let mut all = [0.0; MAX_JOINTS];
    all[..3].copy_from_slice(&leg);
    all
}
