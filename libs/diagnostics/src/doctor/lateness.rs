//! Counting how late a timer was.

use hapfic_log::metrics::Latencies;
use hapfic_messages::PERIOD_NS;

/// Periods without a command after which a drive brakes by itself.
const BRAKES_AFTER: u64 = 3;

/// How late a timer was, and what that would have cost a run.
#[derive(Clone, Debug, Default)]
pub(super) struct Tally {
    pub(super) lateness: Latencies,
    pub(super) ticks: u64,
    pub(super) over_100_us: u64,
    pub(super) over_500_us: u64,
    pub(super) over_1_ms: u64,
    pub(super) late_ticks: u64,
    pub(super) brakes: u64,
}

impl Tally {
    /// One tick that was so late, ns. Returns by how many periods time slips, as the plant's does: never a burst to catch up.
    pub(super) fn record(&mut self, lateness_ns: u64) -> u64 {
        self.lateness.record(lateness_ns);
        self.ticks += 1;
        self.over_100_us += u64::from(lateness_ns > 100_000);
        self.over_500_us += u64::from(lateness_ns > 500_000);
        self.over_1_ms += u64::from(lateness_ns > 1_000_000);
        let slipped = lateness_ns / PERIOD_NS;
        self.late_ticks += slipped;
        self.brakes += u64::from(slipped >= BRAKES_AFTER);
        slipped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tick_counts_where_it_belongs() {
        let mut tally = Tally::default();
        let slipped: Vec<u64> = [0, 100_000, 100_001, 500_001, 999_999, 1_000_000, 1_000_001, 2_999_999, 3_000_000, 25_400_000]
            .into_iter()
            .map(|lateness| tally.record(lateness))
            .collect();
        assert_eq!(slipped, [0, 0, 0, 0, 0, 1, 1, 2, 3, 25]);
        assert_eq!((tally.ticks, tally.over_100_us, tally.over_500_us, tally.over_1_ms), (10, 8, 7, 4));
        assert_eq!((tally.late_ticks, tally.brakes), (32, 2));
    }
}
