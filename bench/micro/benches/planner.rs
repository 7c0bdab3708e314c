//! The planner's tick: from a state to the reference of the next tick.

use anyhow::Result;
use criterion::Criterion;
use hapfic_bench_recorded::recorded_ticks;
use hapfic_planner::TickPlan;
use std::hint::black_box;

fn main() -> Result<()> {
    let all = recorded_ticks("floor", 1000)?;
    // The same ticks with a new target in each.
    let mut targets = all.clone();
    for (index, m) in targets.iter_mut().enumerate() {
        let target = &mut m.operator.next.target_position;
        target[2] += 1e-3 * (1 + index % 7) as f64;
        m.operator.current.target_position = *target;
    }
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("planner");
    for (name, ticks) in [("whole tick", &all), ("whole tick, new target", &targets)] {
        group.bench_function(name, |b| {
            let mut next_tick = ticks.iter().cycle();
            b.iter(|| {
                next_tick.next().map(|m| {
                    let next = TickPlan::next(Some(m.plan()), black_box(&m.state), m.active, &m.operator);
                    next.reference(m.reference.parameters_version)
                })
            });
        });
    }
    group.finish();
    criterion.final_summary();
    Ok(())
}
