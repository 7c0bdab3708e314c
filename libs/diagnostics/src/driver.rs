//! The process at place 0 of a chain: sends at absolute times and waits for the answer, as the plant does.

use crate::arguments::{Plan, list};
use crate::error::LatencyError;
use crate::link::{Kind, Link, PLACES, Seat};
use crate::measured::{Measured, Sample};
use hapfic_ipc::realtime::{self, Prefault};
use hapfic_ipc::{Ending, clock};
use rustix::io::{FdFlags, fcntl_setfd};
use std::io::{BufRead, BufReader};
use std::os::fd::AsRawFd;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How long an answer is waited for.
const TIMEOUT: Duration = Duration::from_millis(5);
/// Answers in a row that make a chain warm, and how long it may take to get there.
const WARM: u64 = 50;
const WARM_UP: Duration = Duration::from_secs(20);
/// From one message to the next while it warms up.
const WARM_EVERY: Duration = Duration::from_millis(1);

/// Starts the relays, warms the chain up, calls `ready`, and measures. `lead` are the words of this program's command line that
/// come before those of the protocol.
///
/// # Errors
/// [`LatencyError`] if the chain cannot be made, or nothing comes round.
pub fn driver(kind: &dyn Kind, plan: &Plan, lead: &[&str], ready: impl FnOnce()) -> Result<Measured, LatencyError> {
    let name = kind.name();
    let requests = plan.sched_requests().map_err(LatencyError::Arguments)?;
    let sizes = plan.sizes().map_err(LatencyError::Arguments)?;
    tie_to_parent(name)?;
    if requests[0].is_some() {
        realtime::lock_memory(Prefault::Used);
    }
    let shared = kind.prepare(&sizes).map_err(LatencyError::failed(name, "prepare the chain"))?;
    for file in &shared {
        // The relays inherit it.
        fcntl_setfd(file, FdFlags::empty()).map_err(LatencyError::failed(name, "hand a file over"))?;
    }
    let descriptors: Vec<i32> = shared.iter().map(AsRawFd::as_raw_fd).collect();
    let chain = format!("hapfic-chain-{}-{}", std::process::id(), clock::now_ns() % 1_000_000_000);
    let mut relays = Vec::new();
    for (place, sched) in requests.iter().enumerate().skip(1) {
        let words = [
            ("--kind", name.to_owned()),
            ("--place", place.to_string()),
            ("--driver", std::process::id().to_string()),
            ("--chain", chain.clone()),
            ("--core", sched.and_then(|w| w.core).map_or("any".to_owned(), |core| core.to_string())),
            ("--priority", sched.map_or(0, |w| w.priority).to_string()),
            ("--sizes", list(&sizes)),
            ("--shared", list(&descriptors)),
        ];
        relays.push(Relay::start(name, lead, &words)?);
    }
    let granted = requests[0].map(realtime::apply_to_current_thread).unwrap_or_default();
    let mut link = kind.join(Seat { place: 0, sizes, chain, shared }).map_err(LatencyError::failed(name, "join the chain"))?;
    let mut all = vec![granted.0];
    for (i, relay) in relays.iter_mut().enumerate() {
        all.push(relay.granted(name, i + 1)?);
    }
    let mut round = Round::new(link.as_mut(), &sizes);
    round.warm_up(name)?;
    ready();
    let samples = round.measure(plan).map_err(LatencyError::failed(name, "measure"))?;
    Ok(Measured { kind: name.to_owned(), hops: PLACES as u32, count: plan.count, granted: all, samples })
}

/// Ends this process when the one that started it ends.
pub(crate) fn tie_to_parent(name: &str) -> Result<(), LatencyError> {
    let parent = rustix::process::getppid().map_or(0, |pid| pid.as_raw_nonzero().get());
    hapfic_ipc::tie_to_supervisor(parent, Ending::Killed).map_err(LatencyError::failed(name, "be tied to who started it"))
}

/// A relay; killed when dropped.
struct Relay {
    child: Child,
}

impl Relay {
    fn start(name: &str, lead: &[&str], words: &[(&str, String)]) -> Result<Self, LatencyError> {
        let mut command = Command::new("/proc/self/exe");
        command.args(lead).arg("relay");
        // An empty list is one that is not given.
        for (word, value) in words.iter().filter(|(_, value)| !value.is_empty()) {
            command.args([word, value.as_str()]);
        }
        let child = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn();
        Ok(Self { child: child.map_err(LatencyError::failed(name, "start a relay"))? })
    }

    /// Waits until it is there; what it was granted.
    fn granted(&mut self, name: &str, place: usize) -> Result<u32, LatencyError> {
        let mut line = String::new();
        if let Some(out) = self.child.stdout.take() {
            BufReader::new(out).read_line(&mut line).map_err(LatencyError::failed(name, "hear of a relay"))?;
        }
        let bits = line.trim().strip_prefix("ready ").and_then(|bits| bits.parse().ok());
        bits.ok_or_else(|| LatencyError::Relay { kind: name.to_owned(), place, found: line.trim().to_owned() })
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Messages round the chain, each with a number, so that a late answer is not taken for the next one's.
struct Round<'a> {
    link: &'a mut dyn Link,
    out: Vec<u8>,
    into: Vec<u8>,
    number: u64,
}

impl<'a> Round<'a> {
    fn new(link: &'a mut dyn Link, sizes: &[usize; PLACES]) -> Self {
        let longest = sizes.iter().copied().max().unwrap_or(0);
        Self { link, out: vec![1; sizes[0]], into: vec![0; longest], number: 0 }
    }

    /// Just before sending, and when the answer was there; 0 if it did not come.
    fn once(&mut self) -> std::io::Result<(u64, u64)> {
        self.number += 1;
        let number = self.number.to_le_bytes();
        self.out[..8].copy_from_slice(&number);
        let sent = clock::now_ns();
        self.link.send(&self.out)?;
        let deadline = sent + TIMEOUT.as_nanos() as u64;
        let mut left = TIMEOUT;
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
        let (mut row, mut answered) = (0, 0);
        while row < WARM {
            if begun.elapsed() > WARM_UP {
                let (kind, sent, seconds) = (name.to_owned(), self.number, WARM_UP.as_secs());
                return Err(LatencyError::Cold { kind, answered, sent, seconds, wanted: WARM });
            }
            let came = self.once().map_err(LatencyError::failed(name, "send round the chain"))?.1 > 0;
            row = if came { row + 1 } else { 0 };
            answered += u64::from(came);
            std::thread::sleep(WARM_EVERY);
        }
        Ok(())
    }

    fn measure(&mut self, plan: &Plan) -> std::io::Result<Vec<Sample>> {
        // Every page of it is there before it counts.
        let mut samples = vec![Sample { due_ns: 1, ..Sample::default() }; plan.count as usize];
        for (i, sample) in samples.iter_mut().enumerate() {
            let due_ns = plan.start_ns + i as u64 * plan.period_ns;
            *sample = Sample { due_ns, ..Sample::default() };
            let mut now = clock::now_ns();
            if now > due_ns {
                // The one before took as long as that.
                continue;
            }
            while now < due_ns {
                clock::sleep_until(due_ns);
                now = clock::now_ns();
            }
            sample.wake_ns = now;
            (sample.sent_ns, sample.end_ns) = self.once()?;
        }
        Ok(samples)
    }
}
