//! Evidence of the detectors: how long a process has been silent while the supervisor was watching, and whether it had a
//! processor meanwhile.
//!
//! A watching thread that does not run itself observes nothing. Its own delays therefore do not count, and a process that
//! waits for a processor is late, not lost.

use hapfic_ipc::HeartbeatPage;
use hapfic_messages::Process;
use rustix::process::Pid;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Longest gap between two observations that counts in full [ns]; an observation is due every 20 ms.
const MAX_GAP_NS: u64 = 40_000_000;
/// Time on a processor in which a process that does not hang sends a heartbeat [ns].
const MAX_RUN_NS: u64 = 100_000_000;

/// Observations of all heartbeats by one thread.
#[derive(Debug, Default)]
pub struct Evidence {
    last_ns: Option<u64>,
    /// Time under observation [ns]: the sum of the gaps, each up to [`MAX_GAP_NS`].
    observed_ns: u64,
    /// Largest gap so far [ns].
    largest_gap_ns: u64,
    heartbeats: [LastHeartbeat; Process::ALL.len()],
}

/// Last observed heartbeat of a process, and the time under observation at which it was new.
#[derive(Clone, Copy, Debug, Default)]
struct LastHeartbeat {
    stamp_ns: Option<u64>,
    observed_ns: u64,
}

impl Evidence {
    /// Observes all heartbeats at `now_ns`.
    pub fn observe(&mut self, page: &HeartbeatPage, now_ns: u64) {
        let gap = self.last_ns.replace(now_ns).map_or(0, |last| now_ns.saturating_sub(last));
        self.largest_gap_ns = self.largest_gap_ns.max(gap);
        self.observed_ns += gap.min(MAX_GAP_NS);
        for process in Process::ALL.iter().copied() {
            let stamp_ns = page.read(process).stamp_ns;
            let last = &mut self.heartbeats[process as usize];
            if stamp_ns != last.stamp_ns {
                *last = LastHeartbeat { stamp_ns, observed_ns: self.observed_ns };
            }
        }
    }

    /// Time under observation so far [ns]: a clock that stands still while the supervisor does.
    pub fn observed_ns(&self) -> u64 {
        self.observed_ns
    }

    /// Largest delay of the observing thread so far.
    pub fn largest_delay(&self) -> Duration {
        Duration::from_nanos(self.largest_gap_ns)
    }

    /// Time under observation since the last heartbeat of a process [ns]; `None` before the first.
    pub fn silence_ns(&self, process: Process) -> Option<u64> {
        let last = &self.heartbeats[process as usize];
        last.stamp_ns?;
        Some(self.observed_ns - last.observed_ns)
    }
}

/// Suspicion of a thread between half of a detector's limit and the whole.
#[derive(Clone, Debug)]
pub struct Suspicion {
    /// Folder of the thread in `/proc`.
    folder: PathBuf,
    since_ns: u64,
    since_observed_ns: u64,
    times: Option<ProcessorTimes>,
    /// Times at the first suspicion, which an excuse does not renew.
    first: Option<ProcessorTimes>,
}

impl Suspicion {
    /// Begins to suspect the main thread of a process.
    pub fn begin(pid: Pid, evidence: &Evidence) -> Self {
        Self::of(PathBuf::from(format!("/proc/{pid}")), evidence)
    }

    fn of(folder: PathBuf, evidence: &Evidence) -> Self {
        let times = ProcessorTimes::read(&folder);
        Self { folder, since_ns: evidence.last_ns.unwrap_or(0), since_observed_ns: evidence.observed_ns, times, first: times }
    }

    /// Time under observation since the suspicion, or its last excuse [ns].
    pub fn observed_ns(&self, evidence: &Evidence) -> u64 {
        evidence.observed_ns - self.since_observed_ns
    }

    /// Excuses the thread and begins again, if it has waited for a processor during most of the time since: the machine is
    /// busy then. A thread that has run for [`MAX_RUN_NS`] since the first suspicion is not excused: it loops. `false` also if
    /// the kernel does not report the times.
    pub fn excuse(&mut self, evidence: &Evidence) -> bool {
        let now_ns = evidence.last_ns.unwrap_or(0);
        let (Some(first), Some(before), Some(now)) = (self.first, self.times, ProcessorTimes::read(&self.folder)) else {
            return false;
        };
        let elapsed_ns = now_ns.saturating_sub(self.since_ns);
        let excused = !now.loops_since(&first) && now.starved_since(&before, elapsed_ns);
        if excused {
            (self.since_ns, self.since_observed_ns, self.times) = (now_ns, evidence.observed_ns, Some(now));
        }
        excused
    }
}

/// Processor times of the main thread of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct ProcessorTimes {
    /// Time on a processor [ns].
    ran_ns: u64,
    /// Completed waits for a processor [ns].
    waited_ns: u64,
    /// Whether the thread runs, or waits for a processor.
    runnable: bool,
}

impl ProcessorTimes {
    /// Reads the times; `None` if the kernel does not report them.
    fn read(folder: &Path) -> Option<Self> {
        let read = |file: &str| std::fs::read_to_string(folder.join(file)).ok();
        Self::parse(&read("schedstat")?, &read("stat")?)
    }

    fn parse(schedstat: &str, stat: &str) -> Option<Self> {
        let mut times = schedstat.split_whitespace().map_while(|word| word.parse().ok());
        let (ran_ns, waited_ns) = (times.next()?, times.next()?);
        // The name in parentheses may contain anything.
        let runnable = stat.rsplit_once(") ")?.1.starts_with('R');
        Some(Self { ran_ns, waited_ns, runnable })
    }

    /// Whether the thread has run for so long since `first` that it would have sent a heartbeat, did it not loop.
    fn loops_since(&self, first: &Self) -> bool {
        self.ran_ns.saturating_sub(first.ran_ns) >= MAX_RUN_NS
    }

    /// Whether the thread has waited for a processor during most of the `elapsed_ns` since `before`.
    fn starved_since(&self, before: &Self, elapsed_ns: u64) -> bool {
        let waited_ns = self.waited_ns.saturating_sub(before.waited_ns);
        // The kernel adds a wait to the sum when the wait ends.
        let unfinished = self.runnable && self.ran_ns.saturating_sub(before.ran_ns) < elapsed_ns / 10;
        elapsed_ns > 0 && (waited_ns >= elapsed_ns / 2 || unfinished)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_messages::Timing;

    const MS: u64 = 1_000_000;

    fn beat(page: &HeartbeatPage, now_ns: u64) {
        page.write(&Timing { process: Process::Plant.code(), ..Timing::default() }, now_ns);
    }

    #[test]
    fn silence_own_delay_does_not_count() {
        let (page, mut evidence) = (HeartbeatPage::private().unwrap(), Evidence::default());
        evidence.observe(&page, 0);
        assert_eq!(evidence.silence_ns(Process::Plant), None);
        beat(&page, 1);
        evidence.observe(&page, 20 * MS);
        // The supervisor is halted for ten seconds.
        evidence.observe(&page, 10_020 * MS);
        assert_eq!(evidence.silence_ns(Process::Plant), Some(MAX_GAP_NS));
        assert_eq!(evidence.largest_delay(), Duration::from_secs(10));
        for i in 1..=100 {
            evidence.observe(&page, 10_020 * MS + i * 20 * MS);
        }
        assert_eq!(evidence.silence_ns(Process::Plant), Some(MAX_GAP_NS + 2_000 * MS), "a real silence counts");
        beat(&page, 2);
        evidence.observe(&page, 12_040 * MS);
        assert_eq!(evidence.silence_ns(Process::Plant), Some(0));
    }

    #[test]
    fn silence_of_predecessor_does_not_count() {
        let (page, mut evidence) = (HeartbeatPage::private().unwrap(), Evidence::default());
        beat(&page, 1);
        evidence.observe(&page, 0);
        evidence.observe(&page, 20 * MS);
        assert_eq!(evidence.silence_ns(Process::Plant), Some(20 * MS));
        page.expect(Process::Plant, 1);
        evidence.observe(&page, 40 * MS);
        assert_eq!(evidence.silence_ns(Process::Plant), None);
    }

    #[test]
    fn processor_times_only_wait_for_processor_is_starvation() {
        let times = |ran_ms: u64, waited_ms: u64, state: char| {
            ProcessorTimes::parse(&format!("{} {} 7\n", ran_ms * MS, waited_ms * MS), &format!("12 (a) b) {state} 1 2")).unwrap()
        };
        let before = times(10, 5, 'S');
        assert!(times(10, 55, 'S').starved_since(&before, 100 * MS), "waits that have ended");
        assert!(times(11, 5, 'R').starved_since(&before, 100 * MS), "a wait in progress");
        assert!(!times(110, 5, 'R').starved_since(&before, 100 * MS), "an endless loop");
        assert!(!times(10, 5, 'S').starved_since(&before, 100 * MS), "a sleep");
        assert!(!times(10, 5, 'T').starved_since(&before, 100 * MS), "a halt");
        assert!(!times(10, 5, 'D').starved_since(&before, 100 * MS), "an uninterruptible system call");
        assert_eq!(ProcessorTimes::parse("0 1", "12 R"), None);
    }

    #[test]
    fn suspicion_halted_process_is_not_starved() {
        let (page, mut evidence) = (HeartbeatPage::private().unwrap(), Evidence::default());
        let mut child = std::process::Command::new("sleep").arg("100").spawn().unwrap();
        let pid = Pid::from_child(&child);
        rustix::process::kill_process(pid, rustix::process::Signal::STOP).unwrap();
        while !std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap().rsplit_once(") ").unwrap().1.starts_with('T') {
            std::thread::yield_now();
        }
        evidence.observe(&page, 0);
        let mut suspicion = Suspicion::begin(pid, &evidence);
        for i in 1..=500 {
            evidence.observe(&page, i * 20 * MS);
        }
        let starved = suspicion.excuse(&evidence);
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!starved);
    }

    #[test]
    fn processor_times_loop_shows_beside_waits() {
        let times =
            |ran_ms: u64, waited_ms: u64| ProcessorTimes { ran_ns: ran_ms * MS, waited_ns: waited_ms * MS, runnable: true };
        // A loop with a fifth of a processor: it waits most of the time, and yet it has run.
        let (first, before, now) = (times(0, 0), times(80, 320), times(100, 400));
        assert!(now.starved_since(&before, 100 * MS) && now.loops_since(&first));
        // A process that hardly ever gets the processor.
        let (before, now) = (times(20, 1980), times(21, 2079));
        assert!(now.starved_since(&before, 100 * MS) && !now.loops_since(&first));
    }
}
