//! The plant: time per sub-step in contact, and per tick, in each scene.
//!
//! Each benchmark replays recorded commands on a copy of the plant. `sub-step` replays the 200 consecutive ticks with
//! the most Newton iterations, and divides their time by the number of their sub-steps in contact. (A leg in the air
//! adds longer sub-steps to the time, not to the number.) `tick` replays the whole scenario, and divides its time by
//! its ticks.

use anyhow::Result;
use criterion::Criterion;
use hapfic_bench_recorded::{Replay, costliest_stretch, whole_scenario};
use std::io::Write;
use std::time::{Duration, Instant};

/// Length of the costliest stretch [ticks].
const STRETCH: usize = 200;
/// Samples of each benchmark: a whole scenario takes a second.
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
                let result = replay.run(&mut plant);
                spent += start.elapsed();
                assert!(result.is_ok(), "{scenario}: {result:?}");
            }
            Duration::from_secs_f64(spent.as_secs_f64() / over as f64)
        });
    });
    group.finish();
}

fn main() -> Result<()> {
    let mut criterion = Criterion::default().configure_from_args();
    for scenario in ["floor", "box", "ball"] {
        let stretch = costliest_stretch(scenario, STRETCH)?;
        measure(&mut criterion, "plant sub-step", scenario, &stretch, stretch.contact_substeps);
        let all = whole_scenario(scenario)?;
        measure(&mut criterion, "plant tick", scenario, &all, all.commands.len() as u64);
    }
    criterion.final_summary();
    Ok(())
}
