//! Distribution of durations.

use super::summary::Quantiles;
use hdrhistogram::Histogram;

/// Upper end of the histogram [ns]. Longer durations count there; the maximum is exact nevertheless.
const MAX_NS: u64 = 60_000_000_000;
/// Precision of a quantile [digits].
const DIGITS: u8 = 3;
const NS_PER_US: f64 = 1e3;

/// Distribution of durations, to three digits, in a fixed 200 kB.
#[derive(Clone, Debug)]
pub struct Latencies {
    histogram: Histogram<u64>,
    largest_ns: u64,
}

impl Default for Latencies {
    #[allow(clippy::expect_used, reason = "the bounds are constants, and a test builds it")]
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(1, MAX_NS, DIGITS).expect("constant bounds are valid");
        Self { histogram, largest_ns: 0 }
    }
}

impl Latencies {
    /// Counts a duration.
    pub fn record(&mut self, duration_ns: u64) {
        self.histogram.saturating_record(duration_ns);
        self.largest_ns = self.largest_ns.max(duration_ns);
    }

    /// Returns the quantiles [us]; `None` if nothing was recorded.
    #[must_use]
    pub fn quantiles_us(&self) -> Option<Quantiles> {
        let quantile = |q| self.histogram.value_at_quantile(q).min(self.largest_ns) as f64 / NS_PER_US;
        (!self.histogram.is_empty()).then(|| Quantiles {
            p50: quantile(0.5),
            p99: quantile(0.99),
            p999: quantile(0.999),
            max: self.largest_ns as f64 / NS_PER_US,
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn latencies_uniform_give_quantiles_and_exact_maximum() {
        assert_eq!(Latencies::default().quantiles_us(), None);
        let mut all = Latencies::default();
        (1..=10_000_u64).for_each(|us| all.record(us * 1000));
        let q = all.quantiles_us().unwrap();
        for (found, expected) in [(q.p50, 5000.0), (q.p99, 9900.0), (q.p999, 9990.0)] {
            assert!((found / expected - 1.0_f64).abs() < 2e-3, "{found} for {expected}");
        }
        assert_eq!(q.max, 10_000.0);
        // Above the range of the histogram.
        all.record(100 * MAX_NS);
        assert_eq!(all.quantiles_us().unwrap().max, 100.0 * MAX_NS as f64 / 1e3);
    }
}
