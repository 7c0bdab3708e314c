//! Steal time of a core, by polling `/proc/stat`.

use hapfic_diagnostics::cause::Span;
use hapfic_ipc::clock;
use std::fs::File;
use std::os::unix::fs::FileExt;

/// Unit of `/proc/stat` [ms]: USER_HZ is 100 on every Linux.
const UNIT_MS: u64 = 10;

/// Monitor of the steal time of one core, or of all together.
#[derive(Debug)]
pub(super) struct StealMonitor {
    /// `None` if the system does not report it.
    file: Option<File>,
    line: String,
    last: Option<(u64, u64)>,
    /// Spans between two polls with steal time, and that time [ms].
    pub(super) steals: Vec<(Span, u64)>,
}

impl StealMonitor {
    /// Makes the monitor of a core; of all together if none is given.
    pub(super) fn new(core: Option<u32>) -> Self {
        let line = core.map_or("cpu".to_owned(), |core| format!("cpu{core}"));
        Self { file: File::open("/proc/stat").ok(), line, last: None, steals: Vec::new() }
    }

    /// Reads the steal time; the caller does this every 10 ms.
    pub(super) fn poll(&mut self) {
        let mut text = [0; 8192];
        let read = self.file.as_ref().and_then(|file| file.read_at(&mut text, 0).ok()).unwrap_or(0);
        let text = String::from_utf8_lossy(&text[..read]);
        if let Some(steal) = steal(&text, &self.line) {
            self.take(clock::now_ns(), steal);
        }
    }

    fn take(&mut self, now_ns: u64, steal: u64) {
        if let Some((from_ns, before)) = self.last
            && steal > before
        {
            self.steals.push((Span { from_ns, to_ns: now_ns }, (steal - before) * UNIT_MS));
        }
        self.last = Some((now_ns, steal));
    }
}

/// Steal time of a line of `/proc/stat` [10 ms].
fn steal(text: &str, line: &str) -> Option<u64> {
    let found = text.lines().find_map(|l| l.strip_prefix(line)?.strip_prefix(' '))?;
    found.split_whitespace().nth(7)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAT: &str =
        "cpu  1 2 3 4 5 6 7 88 9 10\ncpu0 1 2 3 4 5 6 7 8 9 10\ncpu1 1 2 3 4 5 6 7 80 9 10\ncpu10 1 2 3 4 5 6 7 70 9 10\n";

    #[test]
    fn steal_reads_line_of_core() {
        assert_eq!(
            ["cpu", "cpu0", "cpu1", "cpu10", "cpu2"].map(|l| steal(STAT, l)),
            [Some(88), Some(8), Some(80), Some(70), None]
        );
        assert_eq!(steal("cpu1 1 2 3\n", "cpu1"), None);
    }

    #[test]
    fn steal_monitor_keeps_only_rises() {
        let mut monitor = StealMonitor::new(None);
        for (now, steal) in [(10, 5), (20, 5), (30, 7), (40, 7)] {
            monitor.take(now, steal);
        }
        assert_eq!(monitor.steals, [(Span { from_ns: 20, to_ns: 30 }, 20)]);
    }
}
