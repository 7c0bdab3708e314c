//! A message through shared memory in one thread: published, received and copied; then with its wake-up.
//!
//! The wake-up is a system call on each side, without a switch of processes. `hapfic bench latency` measures the
//! switch.

use anyhow::{Context, Result};
use criterion::{Criterion, Throughput};
use hapfic_bench_micro::corner::BenchNamespace;
use hapfic_ipc::topic::{self, Topic};
use hapfic_ipc::{Bus, Wait, wait};
use hapfic_messages::{Command, Request, State};
use std::hint::black_box;
use std::time::Duration;

fn measure<T>(criterion: &mut Criterion, bus: &Bus, topic: &Topic<T>, message: T) -> Result<()>
where
    T: hapfic_messages::Message,
{
    let mut output = bus.output(topic)?;
    let mut input = bus.input(topic, Wait::No)?;
    output.preloan();
    output.send(&message)?;
    input.newest()?.context("the first message did not arrive")?;

    let mut group = criterion.benchmark_group("message");
    group.throughput(Throughput::Bytes(size_of::<T>() as u64));
    let mut lost = 0_u64;
    group.bench_function(format!("{}: publish and receive", topic.name), |b| {
        b.iter(|| {
            output.preloan();
            let sent = output.send(black_box(&message)).is_ok();
            let received = input.next().ok().flatten();
            lost += u64::from(!sent || received.is_none());
            received
        });
    });
    drop(input);
    let mut input = bus.input(topic, Wait::Yes)?;
    output.preloan();
    output.send(&message)?;
    wait(&[&input], Duration::from_secs(1))?;
    input.newest()?;
    group.bench_function(format!("{}: publish, wake, wait and receive", topic.name), |b| {
        b.iter(|| {
            output.preloan();
            let sent = output.send(black_box(&message)).is_ok();
            let woken = wait(&[&input], Duration::from_secs(1)).unwrap_or(false);
            let received = input.next().ok().flatten();
            lost += u64::from(!sent || !woken || received.is_none());
            received
        });
    });
    group.finish();
    anyhow::ensure!(lost == 0, "{}: {lost} messages did not arrive", topic.name);
    Ok(())
}

fn main() -> Result<()> {
    let namespace = BenchNamespace::open()?;
    let mut criterion = Criterion::default().configure_from_args();
    {
        let bus = Bus::open(namespace.domain(), "bench")?;
        measure(&mut criterion, &bus, &topic::STATE, State::default())?;
        measure(&mut criterion, &bus, &topic::REQUEST, Request::default())?;
        measure(&mut criterion, &bus, &topic::COMMAND, Command::default())?;
    }
    criterion.final_summary();
    Ok(())
}
