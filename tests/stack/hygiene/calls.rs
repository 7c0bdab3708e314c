//! System calls of a thread, from what `strace -ttt -p` writes.

use std::collections::BTreeMap;

/// A call that belongs to a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Call {
    /// Rings a doorbell.
    Wake,
    /// Sleeps until one is rung.
    Wait,
    /// Sleeps until a time.
    Sleep,
}

/// Calls that a thread may make now and then: to count its faults (once in 1000 ticks), to go on waiting after it was stopped, and
/// to look after its supervisor when nothing has come for 50 ms.
const NOW_AND_THEN: [&str; 3] = ["getrusage", "restart_syscall", "getppid"];
/// One in so many ticks is now and then.
const SELDOM: f64 = 50.0;
/// Length of a tick, s.
const PERIOD_S: f64 = 1e-3;

/// The calls of a thread over some time.
#[derive(Debug, Default)]
pub struct Calls {
    /// Those that belong to a tick, and how many.
    regular: BTreeMap<Call, u32>,
    /// By name, how many.
    other: BTreeMap<String, u32>,
    /// Ticks that went by from the first call to the last.
    pub ticks: f64,
}

impl Calls {
    /// Reads a trace.
    pub fn read(trace: &str) -> Self {
        let mut calls = Self::default();
        let mut first = None;
        for (time, text) in trace.lines().filter_map(begun) {
            calls.ticks = (time - *first.get_or_insert(time)) / PERIOD_S;
            match regular(text) {
                Some(call) => *calls.regular.entry(call).or_default() += 1,
                None => *calls.other.entry(text.split('(').next().unwrap_or(text).to_owned()).or_default() += 1,
            }
        }
        calls
    }

    /// How often a call is made in a tick, on the average.
    pub fn in_a_tick(&self, call: Call) -> f64 {
        f64::from(self.regular.get(&call).copied().unwrap_or(0)) / self.ticks
    }

    /// Calls that should not have been made, or not so often: how many and their names. Empty if there are none.
    pub fn others(&self) -> String {
        let may = |name: &str| if NOW_AND_THEN.contains(&name) { self.ticks / SELDOM } else { 0.0 };
        let bad = self.other.iter().filter(|(name, count)| f64::from(**count) > may(name));
        bad.map(|(name, count)| format!("{count} {name}")).collect::<Vec<_>>().join(", ")
    }
}

/// Time, s, and text of a line that tells of a call; none for a signal, or the thread's end.
fn begun(line: &str) -> Option<(f64, &str)> {
    let (time, text) = line.trim_start().split_once(' ')?;
    let text = text.trim_start();
    (!text.starts_with(['<', '+', '-'])).then_some((time.parse().ok()?, text))
}

fn regular(text: &str) -> Option<Call> {
    let (name, arguments) = text.split_once('(')?;
    match name {
        "futex" if arguments.contains("FUTEX_WAKE") => Some(Call::Wake),
        "futex" if arguments.contains("FUTEX_WAIT") => Some(Call::Wait),
        "clock_nanosleep" if arguments.contains("TIMER_ABSTIME") => Some(Call::Sleep),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a thread that wakes and waits once a tick: so many ticks, `more` after every tick of which the number is a multiple of
    /// `every`.
    fn trace(ticks: u32, every: u32, more: &str) -> Calls {
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
        Calls::read(&text)
    }

    #[test]
    fn calls_are_counted_by_tick() {
        let calls = trace(1000, 1000, "getrusage(RUSAGE_THREAD, {...}) = 0");
        assert!((calls.ticks - 999.0).abs() < 1.0, "{}", calls.ticks);
        for (call, expected) in [(Call::Wake, 1.0), (Call::Wait, 1.0), (Call::Sleep, 0.0)] {
            assert!((calls.in_a_tick(call) - expected).abs() < 0.01, "{call:?}: {}", calls.in_a_tick(call));
        }
        assert_eq!(calls.others(), "");
    }

    #[test]
    fn one_call_too_many_is_found_however_seldom_it_is() {
        assert_eq!(trace(1000, 1000, "brk(NULL) = 0x1000").others(), "1 brk");
        let paused = "clock_nanosleep(CLOCK_MONOTONIC, 0, {tv_sec=0, tv_nsec=1}, NULL) = 0";
        assert_eq!(trace(1000, 500, paused).others(), "2 clock_nanosleep");
        assert_eq!(trace(1000, 20, "getrusage(RUSAGE_THREAD, {...}) = 0").others(), "50 getrusage");
        let rings = trace(1000, 4, "futex(0x7f88, FUTEX_WAKE, 2147483647) = 0");
        assert!(rings.in_a_tick(Call::Wake) > 1.2, "{}", rings.in_a_tick(Call::Wake));
    }
}
