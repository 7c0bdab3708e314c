//! The QP controller is no straw man: it moves and presses as well as one would wish, within the limits of the torques.
#![allow(clippy::unwrap_used)]

use hapfic_bench_control::{Gains, OperationalSpace, Task};
use hapfic_config::{PERIOD_S, Settings};
use hapfic_gate::parameter_schedule::ParameterSchedule;
use hapfic_messages::{Command, Mode, State};
use hapfic_planner::Plan;
use hapfic_plant::Plant;
use hapfic_simulation::Simulation;

/// What was seen at a tick.
struct Seen {
    state: State,
    /// x_d.
    position: [f64; 3],
    torque: [f64; 8],
}

impl Seen {
    /// Distance of the foot from its reference over the first `axes` axes, m.
    fn error(&self, axes: usize) -> f64 {
        (0..axes).map(|i| (self.state.foot_position[i] - self.position[i]).powi(2)).sum::<f64>().sqrt()
    }
}

/// The floor scenario under the QP controller: the stack's plant, planner, operator and dead time.
fn under_qp(settings: &Settings, ticks: i64) -> Vec<Seen> {
    let mut plant = Plant::new(settings).unwrap();
    let mut schedule = ParameterSchedule::new(settings, plant.sample().foot_position);
    schedule.announce(-1);
    let mut plan = Plan::at_rest(0, plant.sample().foot_position);
    let mut controller: Option<OperationalSpace> = None;
    let mut due = Command { tick: -1, mode: Mode::Hold.code(), joints: 3, ..Command::default() };
    let mut seen = Vec::new();
    for tick in 0..ticks {
        let (state, operator) = (plant.sample(), *schedule.operator());
        let reference = plan.reference(1);
        plan = Plan::next(Some(plan), &state, due.mode == Mode::Active.code(), &operator);
        let ahead = plan.reference(1).velocity;
        let task = Task {
            position: reference.position,
            velocity: reference.velocity,
            acceleration: std::array::from_fn(|i| (ahead[i] - reference.velocity[i]) / PERIOD_S),
            parameters: operator.at(tick),
        };
        let controller = controller.get_or_insert_with(|| {
            let gravity = settings.world.gravity_m_per_s2;
            OperationalSpace::new(plant.chain().clone(), gravity, Gains::default(), &state, &task).unwrap()
        });
        let torque = controller.step(&state, &task).unwrap().torque;
        schedule.announce(tick);
        plant.take(&due);
        plant.advance().unwrap();
        due = Command { tick, mode: Mode::Active.code(), joints: 3, torque, ..Command::default() };
        seen.push(Seen { state, position: reference.position, torque });
    }
    seen
}

/// The same under the stack's own controller.
fn under_hapfic(settings: &Settings, ticks: i64) -> Vec<Seen> {
    let mut simulation = Simulation::new(settings).unwrap();
    (0..ticks)
        .map(|_| {
            let made = simulation.step().unwrap();
            Seen { state: made.state, position: made.reference.position, torque: made.command.torque }
        })
        .collect()
}

fn floor(overrides: &[&str]) -> Settings {
    Settings::load("floor", &overrides.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>()).unwrap()
}

fn largest_error(seen: &[Seen], axes: usize) -> f64 {
    seen.iter().map(|s| s.error(axes)).fold(0.0, f64::max)
}

#[test]
fn both_follow_a_small_motion_through_the_air() {
    let settings = floor(&["operator.0.target_position=[-0.10, 0.05, 0.10]"]);
    let (qp, hapfic) = (under_qp(&settings, 1000), under_hapfic(&settings, 1000));
    let moved = qp.last().unwrap().state.foot_position[2] - qp[0].state.foot_position[2];
    assert!(moved < -0.02, "it moved by {moved} m");
    // Exact compensation of the dynamics; what is left comes from the dead time.
    assert!(largest_error(&qp, 3) < 1.5e-3, "QP: {} m", largest_error(&qp, 3));
    // Compliant, without gravity compensation: within x_b.
    assert!(largest_error(&hapfic, 3) < 25e-3, "HapFIC: {} m", largest_error(&hapfic, 3));
}

#[test]
fn it_lands_presses_with_the_desired_force_and_slides_under_it() {
    let qp = under_qp(&floor(&[]), 6000);
    let mean = |ticks: std::ops::Range<usize>| {
        let n = ticks.len() as f64;
        qp[ticks].iter().map(|s| s.state.foot_force[2]).sum::<f64>() / n
    };
    assert_eq!(qp[1500].state.foot_force[2], 0.0, "still in the air");
    assert!((mean(4000..4400) - 50.0).abs() < 1.0, "at rest {} N", mean(4000..4400));
    assert!((mean(4600..4900) - 50.0).abs() < 2.0, "sliding {} N", mean(4600..4900));
    let slipped = largest_error(&qp[3500..6000], 2);
    assert!(slipped < 2e-3, "along the floor {slipped} m");
}

#[test]
fn torque_limits_hold_where_they_are_reached() {
    // Less than 200 N on the floor take.
    let limit = 12.0;
    let settings = floor(&["robot.effort_limit_n_m=[12, 12, 12]", "operator.2.desired_force=[0, 0, 200]"]);
    let qp = under_qp(&settings, 4400);
    let most = qp.iter().flat_map(|s| s.torque).map(f64::abs).fold(0.0, f64::max);
    assert!(most < limit + 1e-3, "{most} N m");
    assert!(most > limit - 0.1, "the limit is never reached: {most} N m");
    assert!(qp[4300].state.foot_force[2] > 20.0, "it presses as hard as it can: {} N", qp[4300].state.foot_force[2]);
}
