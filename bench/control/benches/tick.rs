//! The whole tick of the controller, from its inputs to the torque, beside the tick of the QP controller.
//!
//! Both cycle through the same recorded ticks, in the air and in contact: of the leg, and of the seven-joint arm. These are
//! half a megabyte, of which the controllers read a part. A thousand would be five, beyond the second-level cache: the
//! figures would be those of the machine's third level, and change with its neighbours.

use anyhow::{Context, Result};
use criterion::Criterion;
use hapfic_bench_control::{Gains, OperationalSpace, Task};
use hapfic_bench_recorded::{RecordedTick, recorded_ticks};
use hapfic_config::Settings;
use hapfic_controller::control_step::{ControlInputs, ReferenceSetpoint, control_step};
use hapfic_messages::Process;
use hapfic_robot::Chain;
use nalgebra::Vector3;
use std::hint::black_box;
use std::io::Write;

/// Number of recorded ticks.
const TICKS: u64 = 100;

fn control_inputs(m: &RecordedTick) -> ControlInputs<'_> {
    ControlInputs {
        state: &m.state,
        setpoint: ReferenceSetpoint::of(&m.reference),
        parameters: m.operator.at(m.state.tick),
        previous: m.previous,
    }
}

fn task(m: &RecordedTick) -> Task<'_> {
    Task {
        position: m.reference.position,
        velocity: m.reference.velocity,
        acceleration: m.reference_acceleration,
        parameters: m.operator.at(m.state.tick),
    }
}

/// Benchmarks both controllers on a scenario's ticks. The QP has the position alone, also where the scenario has a pose.
fn compare(criterion: &mut Criterion, scenario: &str, group: &str) -> Result<()> {
    let settings = Settings::load(scenario, &[])?;
    let chain = Chain::from_settings(&settings.robot)?;
    let gravity = settings.world.gravity_m_per_s2;
    let ticks = recorded_ticks(scenario, TICKS)?;
    let typical = ticks.iter().find(|m| m.in_contact()).with_context(|| format!("{scenario} never touches the floor"))?;
    let mut qp = OperationalSpace::new(chain.clone(), gravity, Gains::default(), &typical.state, &task(typical))?;

    // Both controllers are checked on every tick before either is timed.
    let mut iterations = 0;
    for m in &ticks {
        anyhow::ensure!(
            control_step(&chain, &gravity.into(), &control_inputs(m), Process::Controller).is_some(),
            "tick {}: found no request of the controller, expected one",
            m.state.tick
        );
        qp.step(&m.state, &task(m))?;
        iterations += qp.iterations();
    }
    let mean = f64::from(iterations) / ticks.len() as f64;
    let _ = writeln!(
        std::io::stdout(),
        "{scenario}: QP {mean:.1} iterations a tick on average over {} recorded ticks of {} bytes",
        ticks.len(),
        size_of::<RecordedTick>()
    );

    let mut group = criterion.benchmark_group(group);
    group.bench_function("hapfic", |b| {
        let gravity = Vector3::from(gravity);
        let mut next_tick = ticks.iter().cycle();
        b.iter(|| next_tick.next().map(|m| control_step(&chain, &gravity, black_box(&control_inputs(m)), Process::Controller)));
    });
    group.bench_function("qp", |b| {
        let mut next_tick = ticks.iter().cycle();
        b.iter(|| next_tick.next().map(|m| qp.step(black_box(&m.state), &task(m)).is_ok()));
    });
    group.bench_function("qp, all but the solver", |b| {
        let mut next_tick = ticks.iter().cycle();
        b.iter(|| next_tick.next().map(|m| qp.problem(black_box(&m.state), &task(m)).is_ok()));
    });
    group.finish();
    Ok(())
}

fn main() -> Result<()> {
    let mut criterion = Criterion::default().configure_from_args();
    compare(&mut criterion, "floor", "control tick")?;
    compare(&mut criterion, "arm-press", "control tick, seven joints")?;
    criterion.final_summary();
    Ok(())
}
