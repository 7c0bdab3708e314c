//! The recorder's whole way, from shared memory to the file, at a multiple of the rate of one leg.

use crate::corner::Corner;
use crate::record::{ACCOUNTING, MESSAGES, Message, Recorder, messages, names};
use anyhow::{Context, Result, anyhow};
use hapfic_bench_recorded::{Moment, moments};
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

/// A tick of one leg, ns.
const TICK_NS: u64 = 1_000_000;
/// Batches that may wait for the writer, as in the recorder.
const QUEUE: usize = 4096;
/// How often the file is flushed, ms, as in the recorder.
const FLUSH_MS: u64 = 50;

/// What to measure.
#[derive(Clone, Debug)]
pub struct SchedRequest {
    /// Rate, in rates of one leg.
    pub times: u32,
    /// How long, s.
    pub seconds: u32,
    /// Where the log goes; what is there is replaced.
    pub log: PathBuf,
}

/// What came of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Messages published.
    pub sent: u64,
    /// Messages written.
    pub received: u64,
    /// Of them, before compression, bytes.
    pub message_bytes: u64,
    /// The file, bytes.
    pub file_bytes: u64,
    /// From the first message to the last one, s.
    pub wall_s: f64,
    /// Processor time of the draining thread, s.
    pub drain_s: f64,
    /// Processor time of the writing thread, s.
    pub write_s: f64,
}

impl Outcome {
    /// Messages that did not get into the file.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.sent.saturating_sub(self.received)
    }
}

/// Publishes, drains and writes.
///
/// # Errors
/// If shared memory, threads or the file cannot be had.
pub fn measure(sched: &SchedRequest) -> Result<Outcome> {
    let settings = Settings::load("floor", &[])?;
    let chain = Chain::from_settings(&settings.robot)?;
    let moments = moments("floor", 1000)?;
    let corner = Corner::open()?;
    let options = WriterOptions { chunk_bytes: u64::from(settings.recorder.chunk_kib) * 1024, ..WriterOptions::default() };
    let writer = Writer::create(&sched.log, &names(&settings, &chain), &[], &[], &options)?;
    let recorder = Recorder::new(writer, &settings, &chain);
    let (sender, receiver) = sync_channel(QUEUE);
    let (ready, connected) = channel();
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let drain = scope.spawn(|| {
            let opened = Drain::open(corner.domain());
            let (told, drain) = match opened {
                Ok(drain) => (Ok(()), Some(drain)),
                Err(e) => (Err(e), None),
            };
            let _ = ready.send(told);
            drain.map_or(Ok(0.0), |mut drain| drain.run(&done, sender))
        });
        let write = scope.spawn(move || write(recorder, &receiver));
        connected.recv().context("the draining thread ended at once")??;
        let published = publish(corner.domain(), &moments, sched);
        done.store(true, Ordering::Release);
        let drain_s = drain.join().map_err(|_| anyhow!("the draining thread panicked"))??;
        let written = write.join().map_err(|_| anyhow!("the writing thread panicked"))??;
        let (sent, wall_s) = published?;
        Ok(Outcome { sent, wall_s, drain_s, ..written })
    })
}

/// Sends `times` ticks of messages each millisecond, everything on ports of its own as in the stack. Returns how many messages, and
/// how long it took, s.
fn publish(domain: &Domain, moments: &[Moment], sched: &SchedRequest) -> Result<(u64, f64)> {
    let bus = Bus::open(domain, "publisher")?;
    let mut state = bus.output(&topic::STATE)?;
    let mut reference = bus.output(&topic::REFERENCE)?;
    let mut requests = [bus.output(&topic::REQUEST)?, bus.output(&topic::REQUEST)?];
    let mut command = bus.output(&topic::COMMAND)?;
    let mut timing = ACCOUNTING.iter().map(|_| bus.output(&topic::TIMING)).collect::<Result<Vec<_>, _>>()?;
    let start = clock::now_ns();
    let mut turn = (0..).zip(moments.iter().cycle());
    let mut sent = 0;
    for millisecond in 0..u64::from(sched.seconds) * 1000 {
        clock::sleep_until(start + millisecond * TICK_NS);
        for (tick, moment) in turn.by_ref().take(sched.times as usize) {
            for message in messages(moment, tick) {
                match message {
                    Message::State(m) => send(&mut state, &m)?,
                    Message::Reference(m) => send(&mut reference, &m)?,
                    Message::Request(m) => {
                        let standby = m.controller == Process::Standby.code();
                        send(&mut requests[usize::from(standby)], &m)?;
                    }
                    Message::Command(m) => send(&mut command, &m)?,
                    Message::Timing(m) => {
                        let place = ACCOUNTING.iter().position(|process| process.code() == m.process).unwrap_or(0);
                        send(&mut timing[place], &m)?;
                    }
                }
            }
            sent += MESSAGES as u64;
        }
    }
    // What is behind schedule counts: so it is the rate that was reached.
    Ok((sent, (clock::now_ns() - start) as f64 * 1e-9))
}

fn send<T: hapfic_messages::Message>(output: &mut Output<T>, message: &T) -> Result<(), IpcError> {
    output.send(message)?;
    output.preloan();
    Ok(())
}

/// The draining thread.
struct Drain {
    state: Input<State>,
    reference: Input<Reference>,
    request: Input<Request>,
    command: Input<Command>,
    timing: Input<Timing>,
}

impl Drain {
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

    /// Until all is done and nothing is left. Returns the processor time it took, s.
    fn run(&mut self, done: &AtomicBool, sender: SyncSender<Vec<Message>>) -> Result<f64> {
        loop {
            // Read before draining: what was sent before the flag was set is then taken in.
            let last = done.load(Ordering::Acquire);
            let mut batch = Vec::new();
            take(&mut self.state, &mut batch, Message::State)?;
            take(&mut self.reference, &mut batch, Message::Reference)?;
            take(&mut self.request, &mut batch, Message::Request)?;
            take(&mut self.command, &mut batch, Message::Command)?;
            take(&mut self.timing, &mut batch, Message::Timing)?;
            let quiet = batch.is_empty();
            batch.sort_by_key(tick_of);
            if !quiet && sender.send(batch).is_err() {
                // The writer has failed, and says so itself.
                return Ok(0.0);
            }
            if last && quiet {
                return Ok(processor_time_s());
            }
            if !last {
                std::thread::sleep(Duration::from_nanos(TICK_NS));
            }
        }
    }
}

fn take<T>(input: &mut Input<T>, batch: &mut Vec<Message>, wrap: fn(T) -> Message) -> Result<(), IpcError>
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

fn tick_of(message: &Message) -> i64 {
    match message {
        Message::State(m) => m.tick,
        Message::Reference(m) => m.tick,
        Message::Request(m) => m.tick,
        Message::Command(m) => m.tick,
        Message::Timing(m) => m.tick,
    }
}

/// The writing thread.
fn write(mut recorder: Recorder<std::io::BufWriter<std::fs::File>>, receiver: &Receiver<Vec<Message>>) -> Result<Outcome> {
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
    Ok(Outcome { sent: 0, received, message_bytes, file_bytes, wall_s: 0.0, drain_s: 0.0, write_s: processor_time_s() })
}

/// Processor time of the calling thread so far, s.
fn processor_time_s() -> f64 {
    let t = clock_gettime(ClockId::ThreadCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_message_is_counted_and_what_is_missing_counts_as_lost() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("rate.mcap");
        let outcome = measure(&SchedRequest { times: 2, seconds: 1, log: log.clone() }).unwrap();
        assert_eq!(outcome.sent, 2 * 1000 * MESSAGES as u64);
        assert!(outcome.received <= outcome.sent && outcome.received > 0);
        assert_eq!(outcome.file_bytes, std::fs::metadata(&log).unwrap().len());
        assert!(outcome.wall_s > 0.9 && outcome.drain_s > 0.0 && outcome.write_s > 0.0, "{outcome:?}");
        assert_eq!(Outcome { received: outcome.sent - 3, ..outcome }.lost(), 3);
    }
}
