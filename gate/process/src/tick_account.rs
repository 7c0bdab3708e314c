//! Page faults of a thread that runs the gate.

use hapfic_ipc::realtime;

/// Page-fault account of a thread that runs the gate.
#[derive(Debug)]
pub(super) struct TickAccount {
    /// Interval of the counts [ticks], and the first tick of the next count.
    every: i64,
    due: i64,
    /// Page faults at the last count.
    faults: u64,
}

impl TickAccount {
    /// Account of the calling thread.
    pub(super) fn new(every: i64) -> Self {
        Self { every, due: 0, faults: realtime::page_faults() }
    }

    /// Page faults of the calling thread since the last count, if the next is due; else zero.
    pub(super) fn new_faults(&mut self, tick: i64) -> u32 {
        if tick < self.due {
            return 0;
        }
        self.due = tick.saturating_add(self.every - tick % self.every);
        let before = std::mem::replace(&mut self.faults, realtime::page_faults());
        (self.faults - before) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tick_account_counts_each_fault_once_per_interval() {
        let mut account = TickAccount::new(1000);
        let _ = account.new_faults(0);
        // More than the allocator ever keeps for later: new pages.
        let pages = vec![0_u8; 64 << 20];
        let used = |pages: &mut Vec<u8>| pages.iter_mut().step_by(4096).for_each(|byte| *byte = 1);
        let mut pages = std::hint::black_box(pages);
        used(&mut pages);
        assert_eq!(account.new_faults(999), 0, "no count is due yet");
        let found = account.new_faults(1000);
        assert!(found > 0, "pages were used for the first time");
        assert_eq!(account.new_faults(i64::MAX), 0, "{found} were counted before");
    }
}
