//! A distribution of durations.

use super::summary::Quantiles;
use hdrhistogram::Histogram;

/// Durations above are counted as this, ns; the largest is kept exactly all the same.
const LONGEST_NS: u64 = 60_000_000_000;
/// Digits that a quantile is good for.
const DIGITS: u8 = 3;
const NS_PER_US: f64 = 1e3;

/// A distribution of durations, to three digits, in a fixed 200 kB.
#[derive(Clone, Debug)]
pub(super) struct Latencies {
    histogram: Histogram<u64>,
    largest_ns: u64,
}

impl Default for Latencies {
    #[allow(clippy::expect_used, reason = "the bounds are constants, and a test builds it")]
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(1, LONGEST_NS, DIGITS).expect("constant bounds are valid");
        Self { histogram, largest_ns: 0 }
    }
}

impl Latencies {
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
