//! The QP controller is a fair peer: it tracks the reference and presses with the desired force, within the torque
//! limits.
#![allow(clippy::unwrap_used)]

use hapfic_bench_control::{Gains, OperationalSpace, Task};
use hapfic_config::{PERIOD_S, Settings};
use hapfic_controller::parameters::TipPose;
use hapfic_gate::parameter_schedule::ParameterSchedule;
use hapfic_messages::{Command, Mode, State};
use hapfic_planner::TickPlan;
use hapfic_plant::Plant;
use hapfic_simulation::Simulation;

/// State, reference and torque of a tick.
struct TrackingSample {
    state: State,
    /// x_d.
    position: [f64; 3],
    torque: [f64; hapfic_robot::MAX_JOINTS],
}

impl TrackingSample {
    /// Returns the distance of the foot from its reference over the first `axes` axes [m].
    fn error(&self, axes: usize) -> f64 {
        (0..axes).map(|i| (self.state.foot_position[i] - self.position[i]).powi(2)).sum::<f64>().sqrt()
    }
}

/// Runs the floor scenario under the QP controller, with the stack's plant, planner, operator and dead time.
fn under_qp(settings: &Settings, ticks: i64) -> Vec<TrackingSample> {
    let mut plant = Plant::new(settings).unwrap();
    let mut schedule = ParameterSchedule::new(settings, TipPose::of(&plant.chain().kinematics(&plant.sample().joint_position)));
    schedule.announce(-1);
    let mut plan = TickPlan::at_rest(0, &plant.sample(), false);
    let mut controller: Option<OperationalSpace> = None;
    let mut command = Command { tick: -1, mode: Mode::Hold.code(), joints: 3, ..Command::default() };
    let mut samples = Vec::new();
    for tick in 0..ticks {
        let (state, operator) = (plant.sample(), *schedule.operator());
        let reference = plan.reference(1);
        plan = TickPlan::next(Some(plan), &state, command.mode == Mode::Active.code(), &operator);
        let next_velocity = plan.reference(1).velocity;
        let task = Task {
            position: reference.position,
            velocity: reference.velocity,
            acceleration: std::array::from_fn(|i| (next_velocity[i] - reference.velocity[i]) / PERIOD_S),
            parameters: operator.at(tick),
        };
        let controller = controller.get_or_insert_with(|| {
            let gravity = settings.world.gravity_m_per_s2;
            OperationalSpace::new(plant.chain().clone(), gravity, Gains::default(), &state, &task).unwrap()
        });
        let torque = controller.step(&state, &task).unwrap().torque;
        schedule.announce(tick);
        plant.take(&command);
        plant.advance().unwrap();
        command = Command { tick, mode: Mode::Active.code(), joints: 3, torque, ..Command::default() };
        samples.push(TrackingSample { state, position: reference.position, torque });
    }
    samples
}

/// Runs the same scenario under the stack's own controller.
fn under_hapfic(settings: &Settings, ticks: i64) -> Vec<TrackingSample> {
    let mut simulation = Simulation::new(settings).unwrap();
    (0..ticks)
        .map(|_| {
            let snapshot = simulation.step().unwrap();
            TrackingSample { state: snapshot.state, position: snapshot.reference.position, torque: snapshot.command.torque }
        })
        .collect()
}

fn floor(overrides: &[&str]) -> Settings {
    Settings::load("floor", &overrides.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>()).unwrap()
}

fn largest_error(samples: &[TrackingSample], axes: usize) -> f64 {
    samples.iter().map(|s| s.error(axes)).fold(0.0, f64::max)
}

#[test]
fn tracking_small_motion_in_air_both_stay_within_bounds() {
    let settings = floor(&["operator.0.target_position=[-0.10, 0.05, 0.10]"]);
    let (qp, hapfic) = (under_qp(&settings, 1000), under_hapfic(&settings, 1000));
    let moved = qp.last().unwrap().state.foot_position[2] - qp[0].state.foot_position[2];
    assert!(moved < -0.02, "moved by {moved} m, expected less than -0.02 m");
    // Exact compensation of the dynamics: the rest of the error comes from the dead time.
    assert!(largest_error(&qp, 3) < 1.5e-3, "QP: {} m", largest_error(&qp, 3));
    // A compliant law without gravity compensation stays within x_b.
    assert!(largest_error(&hapfic, 3) < 25e-3, "HapFIC: {} m", largest_error(&hapfic, 3));
}

#[test]
fn qp_floor_scenario_presses_with_desired_force() {
    let qp = under_qp(&floor(&[]), 6000);
    let mean = |ticks: std::ops::Range<usize>| {
        let n = ticks.len() as f64;
        qp[ticks].iter().map(|s| s.state.foot_force[2]).sum::<f64>() / n
    };
    assert_eq!(qp[1500].state.foot_force[2], 0.0, "expected no contact");
    assert!((mean(4000..4400) - 50.0).abs() < 1.0, "at rest {} N", mean(4000..4400));
    assert!((mean(4600..4900) - 50.0).abs() < 2.0, "sliding {} N", mean(4600..4900));
    let lateral_error = largest_error(&qp[3500..6000], 2);
    assert!(lateral_error < 2e-3, "along the floor {lateral_error} m");
}

#[test]
fn qp_torque_limits_reached_hold() {
    // 200 N on the floor need more.
    let limit = 12.0;
    let settings = floor(&["robot.effort_limit_n_m=[12, 12, 12]", "operator.2.desired_force=[0, 0, 200]"]);
    let qp = under_qp(&settings, 4400);
    let most = qp.iter().flat_map(|s| s.torque).map(f64::abs).fold(0.0, f64::max);
    assert!(most < limit + 1e-3, "{most} N m");
    assert!(most > limit - 0.1, "the limit is never reached: {most} N m");
    assert!(qp[4300].state.foot_force[2] > 20.0, "found {} N, expected more than 20 N", qp[4300].state.foot_force[2]);
}
