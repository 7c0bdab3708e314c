//! Distribution of durations, over a whole measurement and in each of its ten segments.

use hdrhistogram::Histogram;
use serde::Serialize;

/// Number of segments of a measurement, equally long.
pub const SEGMENTS: usize = 10;
/// Longest duration that the histogram resolves [ns]; the maximum is kept exactly.
const LONGEST_NS: u64 = 60_000_000_000;
/// Significant digits of a quantile.
const DIGITS: u8 = 3;
const NS_PER_US: f64 = 1e3;

/// A distribution of durations.
#[derive(Clone, Debug)]
pub struct Distribution {
    histogram: Histogram<u64>,
    longest_ns: u64,
    /// Durations of each segment [ns].
    segments: [Vec<u32>; SEGMENTS],
}

/// Quantiles of a distribution [us]; `None` if there are too few durations for one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ChainQuantiles {
    /// Number of durations.
    pub count: u64,
    /// Median.
    pub p50: Option<f64>,
    /// 99th percentile.
    pub p99: Option<f64>,
    /// 99.9th percentile.
    pub p999: Option<f64>,
    /// 99.99th percentile.
    pub p9999: Option<f64>,
    /// Maximum.
    pub max: Option<f64>,
}

impl Default for Distribution {
    #[allow(clippy::expect_used, reason = "the bounds are constants, and a test builds it")]
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(1, LONGEST_NS, DIGITS).expect("constant bounds are valid");
        Self { histogram, longest_ns: 0, segments: [const { Vec::new() }; SEGMENTS] }
    }
}

impl Distribution {
    /// Adds a duration; `share` is the elapsed share of the measurement, 0 to 1.
    pub fn push(&mut self, share: f64, duration_ns: u64) {
        self.histogram.saturating_record(duration_ns);
        self.longest_ns = self.longest_ns.max(duration_ns);
        let segment = ((share * SEGMENTS as f64) as usize).min(SEGMENTS - 1);
        self.segments[segment].push(u32::try_from(duration_ns).unwrap_or(u32::MAX));
    }

    /// Number of durations.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.histogram.len()
    }

    /// Quantile [us]; `None` if there are too few durations for it.
    #[must_use]
    pub fn quantile_us(&self, quantile: f64) -> Option<f64> {
        let enough = self.count() as f64 * (1.0 - quantile) >= 1.0 - 1e-9;
        enough.then(|| self.histogram.value_at_quantile(quantile).min(self.longest_ns) as f64 / NS_PER_US)
    }

    /// Usual quantiles.
    #[must_use]
    pub fn quantiles(&self) -> ChainQuantiles {
        ChainQuantiles {
            count: self.count(),
            p50: self.quantile_us(0.5),
            p99: self.quantile_us(0.99),
            p999: self.quantile_us(0.999),
            p9999: self.quantile_us(0.9999),
            max: (self.count() > 0).then(|| self.longest_ns as f64 / NS_PER_US),
        }
    }

    /// Quantile of each segment [us]; `None` where a segment has too few durations for it.
    #[must_use]
    pub fn segments_us(&self, quantile: f64) -> [Option<f64>; SEGMENTS] {
        std::array::from_fn(|i| {
            let mut durations = self.segments[i].clone();
            if (durations.len() as f64) * (1.0 - quantile) < 1.0 - 1e-9 {
                return None;
            }
            let rank = (durations.len() as f64 * quantile).ceil() as usize;
            let (_, value, _) = durations.select_nth_unstable(rank.saturating_sub(1));
            Some(f64::from(*value) / NS_PER_US)
        })
    }

    /// Curve of durations [us] and how many of `of` durations exceed each, down to the maximum.
    #[must_use]
    pub fn longer_than(&self, of: f64) -> Vec<(f64, f64)> {
        let all = self.count();
        let per = of / all.max(1) as f64;
        let mut longer = all;
        let mut curve = Vec::new();
        for step in self.histogram.iter_recorded() {
            longer -= step.count_since_last_iteration();
            let duration = step.value_iterated_to().min(self.longest_ns) as f64 / NS_PER_US;
            curve.push((duration.max(1e-3), longer as f64 * per));
        }
        // No duration exceeds the maximum, but a logarithmic axis cannot show 0.
        if let (Some(last), true) = (curve.last_mut(), all > 0) {
            last.1 = 0.5 * per;
        }
        curve
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 to 1000 us, ascending.
    fn ramp() -> Distribution {
        let mut d = Distribution::default();
        (0..1000).for_each(|i| d.push(f64::from(i) / 1000.0, 1000 * (i as u64 + 1)));
        d
    }

    fn near(a: Option<f64>, b: f64) -> bool {
        a.is_some_and(|a| (a - b).abs() <= 2e-3 * b)
    }

    #[test]
    fn quantiles_of_ramp_match_and_lack_rare_ones() {
        let q = ramp().quantiles();
        assert!(near(q.p50, 500.0) && near(q.p99, 990.0) && near(q.p999, 999.0), "{q:?}");
        assert_eq!((q.count, q.p9999, q.max), (1000, None, Some(1000.0)));
        assert_eq!(Distribution::default().quantiles(), ChainQuantiles::default());
    }

    #[test]
    fn segments_of_ramp_have_own_medians() {
        let medians = ramp().segments_us(0.5);
        assert_eq!(medians.map(|p| p.map(f64::round)), std::array::from_fn(|i| Some(100.0 * i as f64 + 50.0)));
        assert_eq!(ramp().segments_us(0.999), [None; SEGMENTS]);
    }

    #[test]
    fn longer_than_ramp_falls_to_maximum() {
        let curve = ramp().longer_than(100_000.0);
        assert!(curve.windows(2).all(|w| w[0].0 < w[1].0 && w[0].1 > w[1].1));
        let median = curve.iter().find(|p| p.0 >= 500.0).map(|p| p.1);
        assert!(near(median, 50_000.0), "{median:?}");
        assert!(curve.last().is_some_and(|p| p.0 >= 1000.0 && p.1 == 50.0));
        assert!(Distribution::default().longer_than(1.0).is_empty());
    }

    #[test]
    fn push_duration_beyond_histogram_saturates() {
        let mut d = Distribution::default();
        d.push(0.0, u64::MAX / 2);
        d.push(7.0, 0);
        assert_eq!(d.quantiles().count, 2);
        assert!(d.quantiles().max.is_some_and(|max| max > 1e12));
    }
}
