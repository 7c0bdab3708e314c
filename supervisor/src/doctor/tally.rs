//! Counting how late a timer was.

use anyhow::{Context, Result};
use hapfic_log::metrics::Quantiles;
use hdrhistogram::Histogram;

/// The stack's period, ns.
pub(super) const PERIOD_NS: u64 = 1_000_000;
/// Periods without a command after which a drive brakes by itself.
const BRAKES_AFTER: u64 = 3;
/// Durations above are counted as this, ns; the largest is kept exactly all the same.
const LONGEST_NS: u64 = 60_000_000_000;
/// Digits that a quantile is good for.
const DIGITS: u8 = 3;
const NS_PER_US: f64 = 1e3;

/// A distribution of durations, in a fixed piece of memory.
#[derive(Clone, Debug)]
pub(super) struct Distribution {
    histogram: Histogram<u64>,
    largest_ns: u64,
}

impl Distribution {
    pub(super) fn new() -> Result<Self> {
        let histogram = Histogram::new_with_bounds(1, LONGEST_NS, DIGITS).context("cannot make a histogram")?;
        Ok(Self { histogram, largest_ns: 0 })
    }

    pub(super) fn record(&mut self, duration_ns: u64) {
        self.histogram.saturating_record(duration_ns);
        self.largest_ns = self.largest_ns.max(duration_ns);
    }

    /// In microseconds; `None` if nothing was recorded.
    pub(super) fn quantiles_us(&self) -> Option<Quantiles> {
        let quantile = |q| self.histogram.value_at_quantile(q).min(self.largest_ns) as f64 / NS_PER_US;
        (!self.histogram.is_empty()).then(|| Quantiles {
            p50: quantile(0.5),
            p99: quantile(0.99),
            p999: quantile(0.999),
            max: self.largest_ns as f64 / NS_PER_US,
        })
    }
}

/// How late a timer was, and what that would have cost a run.
#[derive(Clone, Debug)]
pub(super) struct Tally {
    pub(super) lateness: Distribution,
    pub(super) ticks: u64,
    pub(super) over_100_us: u64,
    pub(super) over_500_us: u64,
    pub(super) over_1_ms: u64,
    pub(super) late_ticks: u64,
    pub(super) brakes: u64,
}

impl Tally {
    pub(super) fn new() -> Result<Self> {
        let lateness = Distribution::new()?;
        Ok(Self { lateness, ticks: 0, over_100_us: 0, over_500_us: 0, over_1_ms: 0, late_ticks: 0, brakes: 0 })
    }

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
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_tick_counts_where_it_belongs() {
        let mut tally = Tally::new().unwrap();
        let slipped: Vec<u64> = [0, 100_000, 100_001, 500_001, 999_999, 1_000_000, 1_000_001, 2_999_999, 3_000_000, 25_400_000]
            .into_iter()
            .map(|lateness| tally.record(lateness))
            .collect();
        assert_eq!(slipped, [0, 0, 0, 0, 0, 1, 1, 2, 3, 25]);
        assert_eq!((tally.ticks, tally.over_100_us, tally.over_500_us, tally.over_1_ms), (10, 8, 7, 4));
        assert_eq!((tally.late_ticks, tally.brakes), (32, 2));
    }

    #[test]
    fn quantiles_are_in_order_and_the_largest_is_exact() {
        assert_eq!(Distribution::new().unwrap().quantiles_us(), None);
        let mut all = Distribution::new().unwrap();
        (1..=10_000_u64).for_each(|us| all.record(us * 1000));
        let q = all.quantiles_us().unwrap();
        for (found, expected) in [(q.p50, 5000.0), (q.p99, 9900.0), (q.p999, 9990.0)] {
            assert!((found / expected - 1.0_f64).abs() < 2e-3, "{found} for {expected}");
        }
        assert_eq!(q.max, 10_000.0);
        // Beyond what the histogram holds.
        all.record(100 * LONGEST_NS);
        assert_eq!(all.quantiles_us().unwrap().max, 100.0 * LONGEST_NS as f64 / 1e3);
    }
}
