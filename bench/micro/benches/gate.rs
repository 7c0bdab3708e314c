//! The torque gate: filter and limit, check of a request, and the whole tick.

use anyhow::Result;
use criterion::Criterion;
use hapfic_bench_recorded::recorded_ticks;
use hapfic_config::{PERIOD_S, Settings};
use hapfic_controller::torque_filter::{LowPass, limit};
use hapfic_gate::protocol::{ControllerSlot, GateInputs, Observation};
use hapfic_gate::torque_check::TorqueCheck;
use hapfic_gate::{Gate, GateLimits};
use hapfic_messages::{MAX_JOINTS, Request, State};
use hapfic_robot::Chain;
use std::hint::black_box;

fn main() -> Result<()> {
    let settings = Settings::load("floor", &[])?;
    let chain = Chain::from_settings(&settings.robot)?;
    let all = recorded_ticks("floor", 1000)?;
    let mut peak = [0.0; MAX_JOINTS];
    for (peak, joint) in peak.iter_mut().zip(chain.joints()) {
        *peak = joint.effort;
    }
    let limits = GateLimits {
        joints: chain.dof(),
        bandwidth_hz: Some(20.0),
        peak,
        period_s: PERIOD_S,
        saturation: settings.supervisor.torque_saturation,
        ramp_rate: settings.supervisor.ramp_rate,
        torque_rate: settings.supervisor.torque_rate,
        discontinuity: settings.supervisor.discontinuity,
    };
    let check = TorqueCheck::new(chain, settings.world.gravity_m_per_s2);

    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("gate");
    group.bench_function("torque filter and limit", |b| {
        let mut next_tick = all.iter().cycle();
        let mut filter = LowPass::default();
        b.iter(|| {
            next_tick.next().map(|m| {
                filter = filter.step(black_box(&m.command.request.torque), limits.bandwidth_hz, PERIOD_S);
                limit(&filter.output, &peak)
            })
        });
    });
    group.bench_function("torque check", |b| {
        let mut next_tick = all.iter().cycle();
        b.iter(|| next_tick.next().map(|m| check.check(&m.state, black_box(&m.command.request), m.operator.at(m.state.tick))));
    });
    group.bench_function("whole tick", |b| {
        let mut gate = Gate::new(limits, check.clone());
        let mut next_tick = all.iter().cycle();
        let mut rejected = 0_u64;
        b.iter(|| {
            next_tick.next().map(|m| {
                let tick = gate.tick();
                let request = Request { tick, state_tick: tick, ..m.command.request };
                let state = State { tick, ..m.state };
                rejected += u64::from(gate.validate(black_box(&request), &state, m.operator.at(m.state.tick)).is_err());
                gate.accept(ControllerSlot::First, &request, &Observation::alone(), &GateInputs::default())
            })
        });
        assert_eq!(rejected, 0, "the gate rejected {rejected} requests that it accepted in the recording");
    });
    group.finish();
    criterion.final_summary();
    Ok(())
}
