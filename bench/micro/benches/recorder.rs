//! The recorder's writing half: the ten messages of a tick encoded, summed up and compressed; into nowhere, so that it is the
//! processor's share alone. At 1 kHz, 1 ms over the time shown is how many legs one core could record.

use anyhow::Result;
use criterion::{Criterion, Throughput};
use hapfic_bench_micro::record::{MESSAGES, Recorder, messages, names};
use hapfic_bench_recorded::moments;
use hapfic_config::Settings;
use hapfic_log::{Writer, WriterOptions};
use hapfic_robot::Chain;
use std::path::Path;

fn main() -> Result<()> {
    let settings = Settings::load("floor", &[])?;
    let chain = Chain::from_settings(&settings.robot)?;
    let all = moments("floor", 1000)?;
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("recorder");
    group.throughput(Throughput::Elements(MESSAGES as u64));
    group.bench_function("messages of a tick", |b| {
        let options = WriterOptions { chunk_bytes: u64::from(settings.recorder.chunk_kib) * 1024, ..WriterOptions::default() };
        let opened = Writer::new(std::io::sink(), Path::new("nowhere"), &names(&settings, &chain), &[], &[], &options);
        let mut recorder = opened.ok().map(|writer| Recorder::new(writer, &settings, &chain));
        let mut turn = (0..).zip(all.iter().cycle());
        let mut failed = 0;
        b.iter(|| {
            if let (Some(recorder), Some((tick, moment))) = (recorder.as_mut(), turn.next()) {
                failed += messages(moment, tick).iter().filter(|m| recorder.record(m).is_err()).count();
            }
        });
        assert!(recorder.is_some() && failed == 0, "{failed} messages could not be written");
    });
    group.finish();
    criterion.final_summary();
    Ok(())
}
