//! Process at stage 0 of a chain: sends at absolute times and waits for the answer, as the plant does.

use crate::arguments::{MeasurementPlan, list};
use crate::error::LatencyError;
use crate::link::{Kind, Link, STAGES, Seat};
use crate::measured::{ChainMeasurement, ChainSample};
use hapfic_ipc::clock;
use hapfic_ipc::realtime::{self, Prefault};
use rustix::io::{FdFlags, fcntl_setfd};
use std::io::{BufRead, BufReader};
use std::os::fd::AsRawFd;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Timeout of an answer.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(5);
/// Consecutive answers that end the warm-up, its timeout, and its period.
const WARM_UP_ANSWERS: u64 = 50;
const WARM_UP_TIMEOUT: Duration = Duration::from_secs(20);
const WARM_UP_PERIOD: Duration = Duration::from_millis(1);

/// Starts the relays, warms the chain up, calls `ready`, and measures.
///
/// `prefix` are the arguments of this program's command line before those of the protocol.
///
/// # Errors
/// [`LatencyError`] if the chain cannot be set up, or no messages are answered.
pub fn driver(
    kind: &dyn Kind,
    plan: &MeasurementPlan,
    prefix: &[&str],
    ready: impl FnOnce(),
) -> Result<ChainMeasurement, LatencyError> {
    let name = kind.name();
    let requests = plan.sched_requests().map_err(LatencyError::Arguments)?;
    let sizes = plan.sizes().map_err(LatencyError::Arguments)?;
    tie_to_parent(name)?;
    if requests[0].is_some() {
        realtime::lock_memory(Prefault::Used);
    }
    let shared = kind.prepare(&sizes).map_err(LatencyError::failed(name, "prepare the chain"))?;
    for file in &shared {
        // Relays inherit it.
        fcntl_setfd(file, FdFlags::empty()).map_err(LatencyError::failed(name, "pass a file on to the relays"))?;
    }
    let descriptors: Vec<i32> = shared.iter().map(AsRawFd::as_raw_fd).collect();
    let chain = format!("hapfic-chain-{}-{}", std::process::id(), clock::now_ns() % 1_000_000_000);
    let mut relays = Vec::new();
    for (stage, sched) in requests.iter().enumerate().skip(1) {
        let arguments = [
            ("--kind", name.to_owned()),
            ("--stage", stage.to_string()),
            ("--driver", std::process::id().to_string()),
            ("--chain", chain.clone()),
            ("--core", sched.and_then(|request| request.core).map_or("any".to_owned(), |core| core.to_string())),
            ("--priority", sched.map_or(0, |request| request.priority).to_string()),
            ("--sizes", list(&sizes)),
            ("--shared", list(&descriptors)),
        ];
        relays.push(RelayProcess::start(name, prefix, &arguments)?);
    }
    let granted = requests[0].map(realtime::apply_to_current_thread).unwrap_or_default();
    let mut link = kind.join(Seat { stage: 0, sizes, chain, shared }).map_err(LatencyError::failed(name, "join the chain"))?;
    let mut grants = vec![granted.0];
    for (i, relay) in relays.iter_mut().enumerate() {
        grants.push(relay.granted(name, i + 1)?);
    }
    let mut round_trips = RoundTrips::new(link.as_mut(), &sizes);
    round_trips.warm_up(name)?;
    ready();
    let samples = round_trips.measure(plan).map_err(LatencyError::failed(name, "measure"))?;
    Ok(ChainMeasurement { kind: name.to_owned(), hops: STAGES as u32, count: plan.count, granted: grants, samples })
}

/// Makes this process end with its parent process.
pub(crate) fn tie_to_parent(name: &str) -> Result<(), LatencyError> {
    let parent = rustix::process::getppid().map_or(0, |pid| pid.as_raw_nonzero().get());
    hapfic_ipc::tie_to_parent(parent).map_err(LatencyError::failed(name, "be tied to its parent process"))
}

/// Child process of a relay; killed when dropped.
struct RelayProcess {
    child: Child,
}

impl RelayProcess {
    fn start(name: &str, prefix: &[&str], arguments: &[(&str, String)]) -> Result<Self, LatencyError> {
        let mut command = Command::new("/proc/self/exe");
        command.args(prefix).arg("relay");
        // The command line has no empty lists.
        for (option, value) in arguments.iter().filter(|(_, value)| !value.is_empty()) {
            command.args([option, value.as_str()]);
        }
        let child = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn();
        Ok(Self { child: child.map_err(LatencyError::failed(name, "start a relay"))? })
    }

    /// Waits until the relay is ready, and returns its grants.
    fn granted(&mut self, name: &str, stage: usize) -> Result<u32, LatencyError> {
        let mut line = String::new();
        if let Some(out) = self.child.stdout.take() {
            BufReader::new(out).read_line(&mut line).map_err(LatencyError::failed(name, "read the output of a relay"))?;
        }
        let bits = line.trim().strip_prefix("ready ").and_then(|bits| bits.parse().ok());
        bits.ok_or_else(|| LatencyError::Relay { kind: name.to_owned(), stage, found: line.trim().to_owned() })
    }
}

impl Drop for RelayProcess {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Round trips of numbered messages; the number tells a late answer from the next one.
struct RoundTrips<'a> {
    link: &'a mut dyn Link,
    out: Vec<u8>,
    into: Vec<u8>,
    number: u64,
}

impl<'a> RoundTrips<'a> {
    fn new(link: &'a mut dyn Link, sizes: &[usize; STAGES]) -> Self {
        let longest = sizes.iter().copied().max().unwrap_or(0);
        Self { link, out: vec![1; sizes[0]], into: vec![0; longest], number: 0 }
    }

    /// Sends one message; returns the times before sending and of the answer [ns], 0 if no answer came.
    fn round_trip(&mut self) -> std::io::Result<(u64, u64)> {
        self.number += 1;
        let number = self.number.to_le_bytes();
        self.out[..8].copy_from_slice(&number);
        let sent = clock::now_ns();
        self.link.send(&self.out)?;
        let deadline = sent + ANSWER_TIMEOUT.as_nanos() as u64;
        let mut left = ANSWER_TIMEOUT;
        loop {
            let length = self.link.receive(&mut self.into, Some(left))?;
            let now = clock::now_ns();
            if length >= 8 && self.into[..8] == number {
                return Ok((sent, now));
            }
            if now >= deadline {
                return Ok((sent, 0));
            }
            left = Duration::from_nanos(deadline - now);
        }
    }

    fn warm_up(&mut self, name: &str) -> Result<(), LatencyError> {
        let begun = Instant::now();
        let (mut consecutive, mut answered) = (0, 0);
        while consecutive < WARM_UP_ANSWERS {
            if begun.elapsed() > WARM_UP_TIMEOUT {
                let (kind, sent, seconds) = (name.to_owned(), self.number, WARM_UP_TIMEOUT.as_secs());
                return Err(LatencyError::WarmUp { kind, answered, sent, seconds, expected: WARM_UP_ANSWERS });
            }
            let came = self.round_trip().map_err(LatencyError::failed(name, "send through the chain"))?.1 > 0;
            consecutive = if came { consecutive + 1 } else { 0 };
            answered += u64::from(came);
            std::thread::sleep(WARM_UP_PERIOD);
        }
        Ok(())
    }

    fn measure(&mut self, plan: &MeasurementPlan) -> std::io::Result<Vec<ChainSample>> {
        // Nonzero values, so that every page is mapped before the measurement.
        let mut samples = vec![ChainSample { due_ns: 1, ..ChainSample::default() }; plan.count as usize];
        for (i, sample) in samples.iter_mut().enumerate() {
            let due_ns = plan.start_ns + i as u64 * plan.period_ns;
            *sample = ChainSample { due_ns, ..ChainSample::default() };
            let mut now = clock::now_ns();
            if now > due_ns {
                // The previous round trip has outlasted this due time.
                continue;
            }
            while now < due_ns {
                clock::sleep_until(due_ns);
                now = clock::now_ns();
            }
            sample.wake_ns = now;
            (sample.sent_ns, sample.end_ns) = self.round_trip()?;
        }
        Ok(samples)
    }
}
