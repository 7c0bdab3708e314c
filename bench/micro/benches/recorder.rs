//! The recorder's writer: the ten messages of a tick encoded, accumulated and compressed, without a file.
//!
//! The result is processor time alone. At 1 kHz, 1 ms over the result is the number of legs that one core can record.

use anyhow::Result;
use criterion::{Criterion, Throughput};
use hapfic_bench_micro::record::{MESSAGES, RecorderWriter, messages, names};
use hapfic_bench_recorded::recorded_ticks;
use hapfic_config::Settings;
use hapfic_log::{Writer, WriterOptions};
use hapfic_robot::Chain;
use std::path::Path;

fn main() -> Result<()> {
    let settings = Settings::load("floor", &[])?;
    let chain = Chain::from_settings(&settings.robot)?;
    let all = recorded_ticks("floor", 1000)?;
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("recorder");
    group.throughput(Throughput::Elements(MESSAGES as u64));
    group.bench_function("messages of a tick", |b| {
        let options = WriterOptions { chunk_bytes: u64::from(settings.recorder.chunk_kib) * 1024, ..WriterOptions::default() };
        let writer = Writer::new(std::io::sink(), Path::new("nowhere"), &names(&settings, &chain), &[], &[], &options);
        let mut recorder = writer.ok().map(|writer| RecorderWriter::new(writer, &settings, &chain));
        let mut next_tick = (0..).zip(all.iter().cycle());
        let mut failed = 0;
        b.iter(|| {
            if let (Some(recorder), Some((tick, recorded))) = (recorder.as_mut(), next_tick.next()) {
                failed += messages(recorded, tick).iter().filter(|m| recorder.record(m).is_err()).count();
            }
        });
        assert!(recorder.is_some() && failed == 0, "{failed} messages could not be written");
    });
    group.finish();
    criterion.final_summary();
    Ok(())
}
