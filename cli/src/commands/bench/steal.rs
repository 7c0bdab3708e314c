//! When the host took the processor away, seen from one look to the next.

use hapfic_diagnostics::cause::Span;
use hapfic_ipc::clock;
use std::fs::File;
use std::os::unix::fs::FileExt;

/// Milliseconds of a unit of `/proc/stat`: USER_HZ is 100 on every Linux there is.
const UNIT_MS: u64 = 10;

/// Looks at the time stolen from a core, or from all of them.
#[derive(Debug)]
pub(super) struct StealMonitor {
    /// None where the system does not tell.
    file: Option<File>,
    line: String,
    last: Option<(u64, u64)>,
    /// When time was stolen, and how much, ms.
    pub(super) stolen: Vec<(Span, u64)>,
}

impl StealMonitor {
    /// Of a core; of all together if none is given.
    pub(super) fn new(core: Option<u32>) -> Self {
        let line = core.map_or("cpu".to_owned(), |core| format!("cpu{core}"));
        Self { file: File::open("/proc/stat").ok(), line, last: None, stolen: Vec::new() }
    }

    /// To be called every 10 ms.
    pub(super) fn look(&mut self) {
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
            self.stolen.push((Span { from_ns, to_ns: now_ns }, (steal - before) * UNIT_MS));
        }
        self.last = Some((now_ns, steal));
    }
}

/// Stolen time of a line, in units.
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
    fn the_right_line_is_read() {
        assert_eq!(
            ["cpu", "cpu0", "cpu1", "cpu10", "cpu2"].map(|l| steal(STAT, l)),
            [Some(88), Some(8), Some(80), Some(70), None]
        );
        assert_eq!(steal("cpu1 1 2 3\n", "cpu1"), None);
    }

    #[test]
    fn only_rises_are_kept() {
        let mut watch = StealMonitor::new(None);
        for (now, steal) in [(10, 5), (20, 5), (30, 7), (40, 7)] {
            watch.take(now, steal);
        }
        assert_eq!(watch.stolen, [(Span { from_ns: 20, to_ns: 30 }, 20)]);
    }
}
