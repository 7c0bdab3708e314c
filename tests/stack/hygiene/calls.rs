//! System calls of a thread, from the output of `strace -ttt -p`.

use std::collections::BTreeMap;

/// System call that belongs to a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SystemCall {
    /// Wakes the waiters of a doorbell.
    Wake,
    /// Sleeps until a doorbell changes.
    Wait,
    /// Sleeps until a time.
    Sleep,
}

/// Rare calls of a thread: to count its faults (once in 1000 ticks), to continue a wait after a stop, and to check its
/// supervisor after 50 ms without a message.
const RARE_CALLS: [&str; 3] = ["getrusage", "restart_syscall", "getppid"];
/// Fewest ticks between two rare calls of a name, on average.
const RARE_INTERVAL_TICKS: f64 = 50.0;
/// Length of a tick [s].
const PERIOD_S: f64 = 1e-3;

/// System calls of a thread over a trace.
#[derive(Debug, Default)]
pub struct SystemCalls {
    /// Count of each call that belongs to a tick.
    regular: BTreeMap<SystemCall, u32>,
    /// Count of each other call, by name.
    other: BTreeMap<String, u32>,
    /// Time from the first call to the last [ticks].
    pub ticks: f64,
}

impl SystemCalls {
    /// Reads a trace.
    pub fn read(trace: &str) -> Self {
        let mut calls = Self::default();
        let mut first = None;
        for (time, text) in trace.lines().filter_map(parse_line) {
            calls.ticks = (time - *first.get_or_insert(time)) / PERIOD_S;
            match regular(text) {
                Some(call) => *calls.regular.entry(call).or_default() += 1,
                None => *calls.other.entry(text.split('(').next().unwrap_or(text).to_owned()).or_default() += 1,
            }
        }
        calls
    }

    /// Mean count of a call in a tick.
    pub fn per_tick(&self, call: SystemCall) -> f64 {
        f64::from(self.regular.get(&call).copied().unwrap_or(0)) / self.ticks
    }

    /// Lists unexpected or too frequent calls, with count and name; empty if there are none.
    pub fn others(&self) -> String {
        let most = |name: &str| if RARE_CALLS.contains(&name) { self.ticks / RARE_INTERVAL_TICKS } else { 0.0 };
        let bad = self.other.iter().filter(|(name, count)| f64::from(**count) > most(name));
        bad.map(|(name, count)| format!("{count} {name}")).collect::<Vec<_>>().join(", ")
    }
}

/// Time [s] and text of a line with a call; `None` for a signal, or the end of the thread.
fn parse_line(line: &str) -> Option<(f64, &str)> {
    let (time, text) = line.trim_start().split_once(' ')?;
    let text = text.trim_start();
    (!text.starts_with(['<', '+', '-'])).then_some((time.parse().ok()?, text))
}

fn regular(text: &str) -> Option<SystemCall> {
    let (name, arguments) = text.split_once('(')?;
    match name {
        "futex" if arguments.contains("FUTEX_WAKE") => Some(SystemCall::Wake),
        "futex" if arguments.contains("FUTEX_WAIT") => Some(SystemCall::Wait),
        "clock_nanosleep" if arguments.contains("TIMER_ABSTIME") => Some(SystemCall::Sleep),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Trace of a thread that wakes and waits once a tick, with the line `more` after every tick divisible by `every`.
    fn trace(ticks: u32, every: u32, more: &str) -> SystemCalls {
        let mut text = String::from("100.0000 restart_syscall(<... resuming interrupted futex ...>) = 0\n");
        for tick in 0..ticks {
            let time = 100.0 + f64::from(tick) * PERIOD_S;
            text += &format!("{time:.6} futex(0x7f08, FUTEX_WAKE, 2147483647) = 1\n");
            text += &format!("{:.6} futex(0x7f48, FUTEX_WAIT_BITSET, 7, NULL, FUTEX_BITSET_MATCH_ANY) = 0\n", time + 1e-4);
            text += &format!("{:.6} --- SIGCHLD {{si_signo=SIGCHLD}} ---\n", time + 2e-4);
            if tick % every == 0 {
                text += &format!("{:.6} {more}\n", time + 3e-4);
            }
        }
        SystemCalls::read(&text)
    }

    #[test]
    fn calls_trace_counted_per_tick() {
        let calls = trace(1000, 1000, "getrusage(RUSAGE_THREAD, {...}) = 0");
        assert!((calls.ticks - 999.0).abs() < 1.0, "{}", calls.ticks);
        for (call, expected) in [(SystemCall::Wake, 1.0), (SystemCall::Wait, 1.0), (SystemCall::Sleep, 0.0)] {
            assert!((calls.per_tick(call) - expected).abs() < 0.01, "{call:?}: {}", calls.per_tick(call));
        }
        assert_eq!(calls.others(), "");
    }

    #[test]
    fn calls_rare_excess_reported() {
        assert_eq!(trace(1000, 1000, "brk(NULL) = 0x1000").others(), "1 brk");
        let paused = "clock_nanosleep(CLOCK_MONOTONIC, 0, {tv_sec=0, tv_nsec=1}, NULL) = 0";
        assert_eq!(trace(1000, 500, paused).others(), "2 clock_nanosleep");
        assert_eq!(trace(1000, 20, "getrusage(RUSAGE_THREAD, {...}) = 0").others(), "50 getrusage");
        let wakes = trace(1000, 4, "futex(0x7f88, FUTEX_WAKE, 2147483647) = 0");
        assert!(wakes.per_tick(SystemCall::Wake) > 1.2, "{}", wakes.per_tick(SystemCall::Wake));
    }
}
