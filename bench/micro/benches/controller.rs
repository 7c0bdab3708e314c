//! The controller's tick and its steps, on a thousand recorded ticks of the floor scenario.

use anyhow::Result;
use criterion::Criterion;
use hapfic_bench_recorded::{RecordedTick, recorded_ticks};
use hapfic_config::{PERIOD_S, Settings};
use hapfic_controller::control_step::{ControlInputs, ReferenceSetpoint, control_step};
use hapfic_controller::task_space::{self, TaskSpaceInput, policies};
use hapfic_controller::{Attractor, ForceProfile, HapticParameters, HapticSearch};
use hapfic_messages::Process;
use hapfic_robot::Chain;
use nalgebra::Vector3;
use std::hint::black_box;

/// Inputs of the laws at a recorded tick.
struct LawInputs {
    recorded: RecordedTick,
    input: TaskSpaceInput,
    haptic: [HapticParameters; 3],
    profile: [ForceProfile; 3],
}

fn law_inputs(recorded: RecordedTick, chain: &Chain) -> Result<LawInputs> {
    let p = *recorded.operator.at(recorded.state.tick);
    let decoded = policies(&p).ok_or_else(|| anyhow::anyhow!("tick {}: unknown policy", recorded.state.tick))?;
    let n = chain.dof();
    let kin = chain.kinematics(&recorded.state.joint_position[..n]);
    let input = TaskSpaceInput {
        position: kin.tip_position().into(),
        velocity: chain.jacobian(&kin).linear_mul(&recorded.state.joint_velocity[..n]).into(),
        reference_position: recorded.reference.position,
        reference_velocity: recorded.reference.velocity,
        contact_force: recorded.state.foot_force,
    };
    let haptic = std::array::from_fn(|axis| HapticParameters {
        stiffness: p.stiffness[axis],
        position_bound: p.position_bound[axis],
        search: decoded.search,
        reset_policy: decoded.reset_policy,
        taper: p.taper,
        search_scale: p.search_scale,
        force_resolution: p.force_resolution,
        period_s: PERIOD_S,
    });
    let profile = std::array::from_fn(|axis| ForceProfile {
        stiffness: p.stiffness[axis],
        max_force: p.max_force[axis],
        position_bound: p.position_bound[axis],
        saturation: decoded.saturation,
    });
    Ok(LawInputs { recorded, input, haptic, profile })
}

fn main() -> Result<()> {
    let settings = Settings::load("floor", &[])?;
    let chain = Chain::from_settings(&settings.robot)?;
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    let all = recorded_ticks("floor", 1000)?.into_iter().map(|m| law_inputs(m, &chain)).collect::<Result<Vec<_>>>()?;

    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("controller");
    group.bench_function("kinematics and Jacobian", |b| {
        let mut next_tick = all.iter().cycle();
        b.iter(|| {
            next_tick.next().map(|p| {
                let kin = chain.kinematics(black_box(&p.recorded.state.joint_position[..3]));
                let jacobian = chain.jacobian(&kin);
                (kin.tip_position(), jacobian.linear_mul(&p.recorded.state.joint_velocity[..3]))
            })
        });
    });
    group.bench_function("haptic search, 3 axes", |b| {
        let mut next_tick = all.iter().cycle();
        b.iter(|| {
            next_tick.next().map(|p| {
                let desired = p.recorded.operator.at(p.recorded.state.tick).desired_force;
                let step = |axis: usize| {
                    let search = HapticSearch { offset_m: p.recorded.previous.translation.offset[axis] };
                    search.step(black_box(desired[axis]), p.input.contact_force[axis], &p.haptic[axis])
                };
                [step(0), step(1), step(2)]
            })
        });
    });
    group.bench_function("attractor, 3 axes", |b| {
        let mut next_tick = all.iter().cycle();
        b.iter(|| {
            next_tick.next().map(|p| {
                let request = &p.recorded.command.request;
                let step = |axis: usize| {
                    let previous_state = &p.recorded.previous.translation;
                    let attractor =
                        Attractor { x_max_m: previous_state.x_max[axis], converging: previous_state.converging[axis] != 0 };
                    attractor.step(black_box(request.error[axis]), request.error_rate[axis], &p.profile[axis])
                };
                [step(0), step(1), step(2)]
            })
        });
    });
    group.bench_function("task-space law, all of it", |b| {
        let mut next_tick = all.iter().cycle();
        b.iter(|| {
            next_tick.next().map(|p| {
                let parameters = p.recorded.operator.at(p.recorded.state.tick);
                task_space::step(p.recorded.previous.translation, black_box(&p.input), parameters, PERIOD_S)
            })
        });
    });
    group.bench_function("torque from force", |b| {
        let jacobians: Vec<_> =
            all.iter().map(|p| chain.jacobian(&chain.kinematics(&p.recorded.state.joint_position[..3]))).collect();
        let mut next_tick = all.iter().zip(&jacobians).cycle();
        b.iter(|| {
            next_tick
                .next()
                .map(|(p, jacobian)| jacobian.linear_transpose_mul(&Vector3::from(black_box(p.recorded.command.request.force))))
        });
    });
    group.bench_function("gravity compensation", |b| {
        let kinematics: Vec<_> = all.iter().map(|p| chain.kinematics(&p.recorded.state.joint_position[..3])).collect();
        let mut next_tick = kinematics.iter().cycle();
        b.iter(|| next_tick.next().map(|kin| chain.gravity_torque(black_box(kin), &gravity)));
    });
    group.bench_function("whole tick", |b| {
        let mut next_tick = all.iter().cycle();
        b.iter(|| {
            next_tick.next().map(|p| {
                let m = &p.recorded;
                let inputs = ControlInputs {
                    state: &m.state,
                    setpoint: ReferenceSetpoint::of(&m.reference),
                    parameters: m.operator.at(m.state.tick),
                    previous: m.previous,
                };
                control_step(&chain, &gravity, black_box(&inputs), Process::Controller)
            })
        });
    });
    group.finish();
    criterion.final_summary();
    Ok(())
}
