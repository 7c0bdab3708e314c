//! The planner's tick: from a state to the reference of the next tick.

use anyhow::Result;
use criterion::Criterion;
use hapfic_bench_recorded::moments;
use hapfic_planner::Plan;
use std::hint::black_box;

fn main() -> Result<()> {
    let all = moments("floor", 1000)?;
    // Under way, and where a new target is accepted at every tick.
    let mut targets = all.clone();
    for (turn, m) in targets.iter_mut().enumerate() {
        let target = &mut m.operator.next.target_position;
        target[2] += 1e-3 * (1 + turn % 7) as f64;
        m.operator.current.target_position = *target;
    }
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("planner");
    for (name, moments) in [("whole tick", &all), ("whole tick, new target", &targets)] {
        group.bench_function(name, |b| {
            let mut turn = moments.iter().cycle();
            b.iter(|| {
                turn.next().map(|m| {
                    let next = Plan::next(Some(m.plan()), black_box(&m.state), m.active, &m.operator);
                    next.reference(m.reference.parameters_version)
                })
            });
        });
    }
    group.finish();
    criterion.final_summary();
    Ok(())
}
