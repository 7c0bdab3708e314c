//! The recorder's path from shared memory to the file, at a multiple of the message rate of one leg.

use crate::corner::BenchNamespace;
use crate::record::{MESSAGES, RecordedMessage, RecorderWriter, TIMED_PROCESSES, messages, names};
use anyhow::{Context, Result, anyhow};
use hapfic_bench_recorded::{RecordedTick, recorded_ticks};
use hapfic_config::Settings;
use hapfic_ipc::{Bus, Domain, Input, IpcError, Output, clock, topic};
use hapfic_log::{Writer, WriterOptions};
use hapfic_messages::{Command, Process, Reference, Request, State, Timing};
use hapfic_robot::Chain;
use rustix::time::{ClockId, clock_gettime};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::time::Duration;

/// Length of a tick [ns].
const TICK_NS: u64 = 1_000_000;
/// Capacity of the writer's queue [batches], as in the recorder.
const QUEUE: usize = 4096;
/// Flush interval of the file [ms], as in the recorder.
const FLUSH_MS: u64 = 50;

/// Options of a measurement.
#[derive(Clone, Debug)]
pub struct RateOptions {
    /// Message rate, as a multiple of the rate of one leg.
    pub times: u32,
    /// Duration [s].
    pub seconds: u32,
    /// Path of the log; an existing file is replaced.
    pub log: PathBuf,
}

/// Result of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateResult {
    /// Messages published.
    pub sent: u64,
    /// Messages written.
    pub received: u64,
    /// Size of the written messages before compression [bytes].
    pub message_bytes: u64,
    /// Size of the file [bytes].
    pub file_bytes: u64,
    /// Time from the first to the last message [s].
    pub wall_s: f64,
    /// Processor time of the draining thread [s].
    pub drain_s: f64,
    /// Processor time of the writing thread [s].
    pub write_s: f64,
}

impl RateResult {
    /// Returns the number of messages that are not in the file.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.sent.saturating_sub(self.received)
    }
}

/// Publishes, drains and writes messages for the whole duration.
///
/// # Errors
/// If shared memory, a thread or the file is not available.
pub fn measure(options: &RateOptions) -> Result<RateResult> {
    let settings = Settings::load("floor", &[])?;
    let chain = Chain::from_settings(&settings.robot)?;
    let recorded = recorded_ticks("floor", 1000)?;
    let namespace = BenchNamespace::open()?;
    let writer_options = WriterOptions { chunk_bytes: u64::from(settings.recorder.chunk_kib) * 1024, ..WriterOptions::default() };
    let writer = Writer::create(&options.log, &names(&settings, &chain), &[], &[], &writer_options)?;
    let recorder = RecorderWriter::new(writer, &settings, &chain);
    let (sender, receiver) = sync_channel(QUEUE);
    let (ready, connected) = channel();
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let drain = scope.spawn(|| {
            let opened = RecorderInputs::open(namespace.domain());
            let (status, inputs) = match opened {
                Ok(inputs) => (Ok(()), Some(inputs)),
                Err(e) => (Err(e), None),
            };
            let _ = ready.send(status);
            inputs.map_or(Ok(0.0), |mut inputs| inputs.drain(&done, sender))
        });
        let write = scope.spawn(move || write(recorder, &receiver));
        connected.recv().context("the draining thread ended before it was ready")??;
        let published = publish(namespace.domain(), &recorded, options);
        done.store(true, Ordering::Release);
        let drain_s = drain.join().map_err(|_| anyhow!("the draining thread panicked"))??;
        let written = write.join().map_err(|_| anyhow!("the writing thread panicked"))??;
        let (sent, wall_s) = published?;
        Ok(RateResult { sent, wall_s, drain_s, ..written })
    })
}

/// Publishes `times` ticks of messages each millisecond, each message on its own port as in the stack.
///
/// Returns the number of messages, and the duration [s].
fn publish(domain: &Domain, recorded: &[RecordedTick], options: &RateOptions) -> Result<(u64, f64)> {
    let bus = Bus::open(domain, "publisher")?;
    let mut state = bus.output(&topic::STATE)?;
    let mut reference = bus.output(&topic::REFERENCE)?;
    let mut requests = [bus.output(&topic::REQUEST)?, bus.output(&topic::REQUEST)?];
    let mut command = bus.output(&topic::COMMAND)?;
    let mut timing = TIMED_PROCESSES.iter().map(|_| bus.output(&topic::TIMING)).collect::<Result<Vec<_>, _>>()?;
    let start = clock::now_ns();
    let mut ticks = (0..).zip(recorded.iter().cycle());
    let mut sent = 0;
    for millisecond in 0..u64::from(options.seconds) * 1000 {
        clock::sleep_until(start + millisecond * TICK_NS);
        for (tick, recorded) in ticks.by_ref().take(options.times as usize) {
            for message in messages(recorded, tick) {
                match message {
                    RecordedMessage::State(m) => send(&mut state, &m)?,
                    RecordedMessage::Reference(m) => send(&mut reference, &m)?,
                    RecordedMessage::Request(m) => {
                        let standby = m.controller == Process::Standby.code();
                        send(&mut requests[usize::from(standby)], &m)?;
                    }
                    RecordedMessage::Command(m) => send(&mut command, &m)?,
                    RecordedMessage::Timing(m) => {
                        let port = TIMED_PROCESSES.iter().position(|process| process.code() == m.process).unwrap_or(0);
                        send(&mut timing[port], &m)?;
                    }
                }
            }
            sent += MESSAGES as u64;
        }
    }
    // Time behind schedule counts: the result is the rate that was reached.
    Ok((sent, (clock::now_ns() - start) as f64 * 1e-9))
}

fn send<T: hapfic_messages::Message>(output: &mut Output<T>, message: &T) -> Result<(), IpcError> {
    output.send(message)?;
    output.preloan();
    Ok(())
}

/// Input ports of the draining thread.
struct RecorderInputs {
    state: Input<State>,
    reference: Input<Reference>,
    request: Input<Request>,
    command: Input<Command>,
    timing: Input<Timing>,
}

impl RecorderInputs {
    fn open(domain: &Domain) -> Result<Self, IpcError> {
        let bus = Bus::open(domain, "recorder")?;
        Ok(Self {
            state: bus.recorder_input(&topic::STATE)?,
            reference: bus.recorder_input(&topic::REFERENCE)?,
            request: bus.recorder_input(&topic::REQUEST)?,
            command: bus.recorder_input(&topic::COMMAND)?,
            timing: bus.recorder_input(&topic::TIMING)?,
        })
    }

    /// Drains until `done` is set and no message is left. Returns the processor time [s].
    fn drain(&mut self, done: &AtomicBool, sender: SyncSender<Vec<RecordedMessage>>) -> Result<f64> {
        loop {
            // Read before draining: all messages sent before the flag are then received.
            let last = done.load(Ordering::Acquire);
            let mut batch = Vec::new();
            receive_all(&mut self.state, &mut batch, RecordedMessage::State)?;
            receive_all(&mut self.reference, &mut batch, RecordedMessage::Reference)?;
            receive_all(&mut self.request, &mut batch, RecordedMessage::Request)?;
            receive_all(&mut self.command, &mut batch, RecordedMessage::Command)?;
            receive_all(&mut self.timing, &mut batch, RecordedMessage::Timing)?;
            let empty = batch.is_empty();
            batch.sort_by_key(tick_of);
            if !empty && sender.send(batch).is_err() {
                // The writer failed, and returns its own error.
                return Ok(0.0);
            }
            if last && empty {
                return Ok(processor_time_s());
            }
            if !last {
                std::thread::sleep(Duration::from_nanos(TICK_NS));
            }
        }
    }
}

fn receive_all<T>(input: &mut Input<T>, batch: &mut Vec<RecordedMessage>, wrap: fn(T) -> RecordedMessage) -> Result<(), IpcError>
where
    T: hapfic_messages::Check + hapfic_messages::Message,
{
    while let Some(message) = input.next()? {
        if message.check().is_ok() {
            batch.push(wrap(message));
        }
    }
    Ok(())
}

fn tick_of(message: &RecordedMessage) -> i64 {
    match message {
        RecordedMessage::State(m) => m.tick,
        RecordedMessage::Reference(m) => m.tick,
        RecordedMessage::Request(m) => m.tick,
        RecordedMessage::Command(m) => m.tick,
        RecordedMessage::Timing(m) => m.tick,
    }
}

/// Runs the writing thread.
fn write(
    mut recorder: RecorderWriter<std::io::BufWriter<std::fs::File>>,
    receiver: &Receiver<Vec<RecordedMessage>>,
) -> Result<RateResult> {
    let (mut received, mut flushed) = (0, clock::now_ns());
    for batch in receiver {
        for message in &batch {
            recorder.record(message)?;
        }
        received += batch.len() as u64;
        if clock::now_ns() - flushed >= FLUSH_MS * 1_000_000 {
            recorder.writer().flush()?;
            flushed = clock::now_ns();
        }
    }
    let message_bytes = recorder.writer().message_bytes();
    let (file_bytes, _) = recorder.finish()?;
    Ok(RateResult { sent: 0, received, message_bytes, file_bytes, wall_s: 0.0, drain_s: 0.0, write_s: processor_time_s() })
}

/// Returns the processor time of the calling thread [s].
fn processor_time_s() -> f64 {
    let t = clock_gettime(ClockId::ThreadCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn measure_two_legs_counts_messages_and_losses() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("rate.mcap");
        let result = measure(&RateOptions { times: 2, seconds: 1, log: log.clone() }).unwrap();
        assert_eq!(result.sent, 2 * 1000 * MESSAGES as u64);
        assert!(result.received <= result.sent && result.received > 0);
        assert_eq!(result.file_bytes, std::fs::metadata(&log).unwrap().len());
        assert!(result.wall_s > 0.9 && result.drain_s > 0.0 && result.write_s > 0.0, "{result:?}");
        assert_eq!(RateResult { received: result.sent - 3, ..result }.lost(), 3);
    }
}
