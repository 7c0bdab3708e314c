//! Steal time of a core, by polling `/proc/stat`.

use hapfic_diagnostics::cause::Span;
use hapfic_ipc::clock;
use std::fs::File;
use std::os::unix::fs::FileExt;

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
        if let Some(steal_ms) = clock::steal_ms(&text, &self.line) {
            self.add(clock::now_ns(), steal_ms);
        }
    }

    fn add(&mut self, now_ns: u64, steal_ms: u64) {
        if let Some((from_ns, before)) = self.last
            && steal_ms > before
        {
            self.steals.push((Span { from_ns, to_ns: now_ns }, steal_ms - before));
        }
        self.last = Some((now_ns, steal_ms));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steal_monitor_keeps_only_rises() {
        let mut monitor = StealMonitor::new(None);
        for (now, steal) in [(10, 5), (20, 5), (30, 7), (40, 7)] {
            monitor.add(now, steal);
        }
        assert_eq!(monitor.steals, [(Span { from_ns: 20, to_ns: 30 }, 2)]);
    }
}
