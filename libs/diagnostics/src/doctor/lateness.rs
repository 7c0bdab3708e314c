//! Counts of the lateness of a timer.

use hapfic_log::metrics::Latencies;
use hapfic_messages::PERIOD_NS;

/// Consecutive periods without a command after which a drive brakes by itself.
pub(super) const BRAKE_PERIODS: u64 = 3;

/// Lateness of a timer, and its effects on a run.
#[derive(Clone, Debug, Default)]
pub(super) struct LatenessCounts {
    pub(super) lateness: Latencies,
    pub(super) ticks: u64,
    pub(super) over_100_us: u64,
    pub(super) over_500_us: u64,
    pub(super) over_1_ms: u64,
    pub(super) late_ticks: u64,
    pub(super) brakes: u64,
}

impl LatenessCounts {
    /// Adds a tick with its lateness [ns], and returns by how many periods the timebase slips.
    ///
    /// Like the plant, the timer skips lost periods; it never catches up.
    pub(super) fn record(&mut self, lateness_ns: u64) -> u64 {
        self.lateness.record(lateness_ns);
        self.ticks += 1;
        self.over_100_us += u64::from(lateness_ns > 100_000);
        self.over_500_us += u64::from(lateness_ns > 500_000);
        self.over_1_ms += u64::from(lateness_ns > 1_000_000);
        let slipped = lateness_ns / PERIOD_NS;
        self.late_ticks += slipped;
        self.brakes += u64::from(slipped >= BRAKE_PERIODS);
        slipped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn record_each_lateness_counts_in_its_classes() {
        let mut counts = LatenessCounts::default();
        let slipped: Vec<u64> = [0, 100_000, 100_001, 500_001, 999_999, 1_000_000, 1_000_001, 2_999_999, 3_000_000, 25_400_000]
            .into_iter()
            .map(|lateness| counts.record(lateness))
            .collect();
        assert_eq!(slipped, [0, 0, 0, 0, 0, 1, 1, 2, 3, 25]);
        assert_eq!((counts.ticks, counts.over_100_us, counts.over_500_us, counts.over_1_ms), (10, 8, 7, 4));
        assert_eq!((counts.late_ticks, counts.brakes), (32, 2));
    }
}
