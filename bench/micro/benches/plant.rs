//! The plant: time per sub-step in contact, and per tick, in each scene, as its own integrator takes them.
//!
//! A stretch of the scenario is lived through again from a copy of the plant, under the commands it had. `sub-step`: the 200 ticks
//! in a row with the most Newton iterations; shown is their whole time over the number of their sub-steps in contact (a leg that
//! flies meanwhile adds longer sub-steps of its own to the time, not to the number). `tick`: the whole scenario, over its ticks.

use anyhow::Result;
use criterion::Criterion;
use hapfic_bench_recorded::{Replay, costliest, whole};
use std::io::Write;
use std::time::{Duration, Instant};

/// Length of the costliest stretch, ticks.
const STRETCH: usize = 200;
/// Samples of each: a whole scenario takes a second.
const SAMPLES: usize = 20;

fn measure(criterion: &mut Criterion, group: &str, scenario: &str, replay: &Replay, over: u64) {
    let Replay { substeps, contact_substeps, newton_iterations, .. } = replay;
    let _ = writeln!(
        std::io::stdout(),
        "{group}, {scenario}: {} ticks, {substeps} sub-steps, {contact_substeps} of them in contact, {newton_iterations} Newton iterations",
        replay.commands.len(),
    );
    let mut group = criterion.benchmark_group(group);
    group.sample_size(SAMPLES);
    group.bench_function(scenario, |b| {
        b.iter_custom(|times| {
            let mut spent = Duration::ZERO;
            for _ in 0..times {
                let mut plant = replay.plant.clone();
                let start = Instant::now();
                let done = replay.run(&mut plant);
                spent += start.elapsed();
                assert!(done.is_ok(), "{scenario}: {done:?}");
            }
            Duration::from_secs_f64(spent.as_secs_f64() / over as f64)
        });
    });
    group.finish();
}

fn main() -> Result<()> {
    let mut criterion = Criterion::default().configure_from_args();
    for scenario in ["floor", "box", "ball"] {
        let stretch = costliest(scenario, STRETCH)?;
        measure(&mut criterion, "plant sub-step", scenario, &stretch, stretch.contact_substeps);
        let all = whole(scenario)?;
        measure(&mut criterion, "plant tick", scenario, &all, all.commands.len() as u64);
    }
    criterion.final_summary();
    Ok(())
}
