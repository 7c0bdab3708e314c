//! Built-in robots with the gains that calibration finds for them, and nothing else.

use hapfic_config::{ParameterSettings, Settings, robots};
use hapfic_plant::ContactLaw;
use hapfic_robot::{Chain, ends};
use hapfic_simulation::Simulation;
use hapfic_simulation::calibrate::{calibrate, start_posture};
use nalgebra::{Rotation3, Vector3};

/// A robot, what a scenario adds to its description, and the force that it must hold [N].
const ROBOTS: [(&str, &str, f64); 4] = [
    ("leg.urdf", "", 50.0),
    ("quadruped-leg.urdf", "armature_kg_m2 = [0.0012, 0.0012, 0.0029]\n", 50.0),
    ("arm6.urdf", "armature_kg_m2 = 0.02\n", 20.0),
    ("arm7.urdf", "", 20.0),
];
/// Time after which the force is observed, and end of the run [ticks].
const SETTLED: i64 = 4000;
const PUSHED: i64 = 6000;
const END: i64 = 9000;
/// Impulse at the hand [N s].
const PUSH_N_S: f64 = 1.0;

fn settings(name: &str, extra: &str) -> Settings {
    let text = robots().iter().find(|(robot, _)| *robot == name).unwrap().1;
    let (roots, leaves) = ends(text, name).unwrap();
    let posture = start_posture(&Chain::from_urdf(text, name, &roots[0], &leaves[0]).unwrap());
    let task = if posture.len() >= 6 { "pose" } else { "position" };
    let scenario = format!(
        "[robot]\nurdf = \"{name}\"\nbase_link = \"{}\"\ntip_link = \"{}\"\nstart_position_rad = {posture:?}\n{extra}\
         [world.floor]\nstiffness_n_per_m = 1e5\ndamping_n_s_per_m = 200.0\n[controller]\ntask = \"{task}\"\n",
        roots[0], leaves[0]
    );
    Settings::from_str(&scenario, name, None, &[]).unwrap()
}

/// The robot with its foot on the floor, under the force; `sole` is how far the foot reaches below the tip at the target [m], if
/// it turns on the way.
fn pressing(settings: &Settings, set: &ParameterSettings, force: f64, sole: Option<f64>) -> Simulation {
    let chain = Chain::from_settings(&settings.robot).unwrap();
    let kin = chain.kinematics(&settings.robot.start_position);
    let tip = kin.tip_position();
    let foot = chain.collisions().iter().filter(|shape| shape.link == chain.tip_link());
    let spheres = foot.flat_map(|shape| shape.spheres(&chain.collision_pose(&kin, shape)));
    let lowest = spheres.map(|(center, radius)| center.z - radius).fold(f64::INFINITY, f64::min);
    let mut pressing = settings.clone();
    let floor = pressing.world.floor.as_mut().unwrap();
    (floor.height_m, floor.tip_only) = (lowest, true);
    let depth = sole.map_or(0.0, |sole| tip.z - lowest - sole) + 0.3 * force / set.stiffness[2];
    pressing.initial =
        ParameterSettings { target_position: Some([tip.x, tip.y, tip.z - depth]), desired_force: [0.0, 0.0, force], ..*set };
    Simulation::new(&pressing).unwrap()
}

#[test]
fn built_in_robots_hold_force_and_orientation_with_calibrated_gains_and_return_from_push() {
    for (name, extra, force) in ROBOTS {
        let settings = settings(name, extra);
        let found = calibrate(&settings, Some(force)).unwrap();
        assert!(found.reserve && found.unsteady.is_empty() && found.mode.margin <= 0.84, "{name}: {found:?}");
        let chain = Chain::from_settings(&settings.robot).unwrap();
        let mut simulation = pressing(&settings, &found.set, force, None);
        let (mut squares, mut count, mut turned, mut speed) = (0.0, 0, 0.0_f64, 0.0_f64);
        let mut held = None;
        for tick in 0..END {
            let snapshot = *simulation.step().unwrap();
            let (state, request) = (&snapshot.state, &snapshot.command.request);
            for (joint, q) in chain.joints().iter().zip(&state.joint_position) {
                assert!(*q > joint.lower && *q < joint.upper, "{name}: {} at its stop", joint.name);
            }
            let quiet = (SETTLED..PUSHED).contains(&tick) || tick >= END - 500;
            if quiet {
                squares += (state.foot_force[2] - force).powi(2);
                count += 1;
                turned = request.rotation.error.iter().fold(turned, |most, e| most.max(e.abs()));
                speed = state.joint_velocity.iter().fold(speed, |most, rate| most.max(rate.abs()));
            }
            if tick == PUSHED {
                held = Some(state.joint_position);
                simulation.push_tip(&Vector3::new(0.0, PUSH_N_S, 0.0));
            }
        }
        let error = (squares / f64::from(count)).sqrt() / force;
        assert!(error < 2e-3, "{name}: {error} of the force");
        assert!(turned.to_degrees() < 0.2, "{name}: turned by {} degrees", turned.to_degrees());
        assert!(speed < 0.02, "{name}: {speed} rad/s at rest");
        let (held, now) = (held.unwrap(), simulation.snapshot().state.joint_position);
        let moved = held.iter().zip(&now).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(moved < 0.01, "{name}: {moved} rad off its posture after the push");
    }
}

/// A flat foot that is turned level stands on all its corners, each with its share of the force.
#[test]
fn flat_foot_holds_force_on_all_its_corners() {
    let feet = [
        "[robot.foot]\nsize_m = [0.1, 0.06, 0.02]\n",
        "[robot.foot]\nradius_m = 0.01\ncenters_m = [[0.05, 0.03, 0], [0.05, -0.03, 0], [-0.05, 0.03, 0], [-0.05, -0.03, 0]]\n",
    ];
    for foot in feet {
        let settings = settings("arm6.urdf", &format!("armature_kg_m2 = 0.02\n{foot}"));
        let mut set = calibrate(&settings, Some(20.0)).unwrap().set;
        let chain = Chain::from_settings(&settings.robot).unwrap();
        let rotation = Rotation3::from_matrix_unchecked(chain.kinematics(&settings.robot.start_position).tip_rotation());
        // The least turn that makes the sole level.
        let up = Vector3::z() * (rotation * Vector3::z()).z.signum();
        let level = Rotation3::rotation_between(&(rotation * Vector3::z()), &up).unwrap() * rotation;
        let (roll, pitch, yaw) = level.euler_angles();
        set.rotation.as_mut().unwrap().target_orientation = Some([roll, pitch, yaw]);
        let mut simulation = pressing(&settings, &set, 20.0, Some(0.01));
        let law = ContactLaw::of(&settings.world.floor.as_ref().unwrap().surface);
        let (mut squares, mut count, mut deepest) = (0.0, 0, 0.0_f64);
        for tick in 0..PUSHED {
            let state = simulation.step().unwrap().state;
            if tick >= SETTLED {
                squares += (state.foot_force[2] - 20.0).powi(2);
                count += 1;
                deepest =
                    state.contacts[..state.contact_count as usize].iter().map(|contact| contact.depth).fold(deepest, f64::max);
            }
        }
        let error = (squares / f64::from(count)).sqrt() / 20.0;
        assert!(error < 2e-3, "{foot}: {error} of the force");
        let share = law.depth_at(20.0 / 4.0);
        assert!((deepest / share - 1.0).abs() < 0.1, "{foot}: {deepest} m deep, expected {share} m at a quarter of the force");
    }
}

#[test]
fn calibration_repeats_and_leaves_room_for_its_own_check() {
    let settings = settings("arm7.urdf", "");
    let (first, second) = (calibrate(&settings, None).unwrap(), calibrate(&settings, None).unwrap());
    assert_eq!(first.set, second.set);
    assert_eq!(first.pressed_n, Some(20.0));
    // More dead time leaves less.
    assert!(first.margin_one_more > first.mode.margin);
    // Rotors make the robot heavier, so it bears more.
    let heavy = calibrate(&self::settings("arm7.urdf", "armature_kg_m2 = 0.1\n"), None).unwrap();
    assert!(heavy.masses.least_kg > first.masses.least_kg && heavy.mode.margin < first.mode.margin);
}
