//! Durations: how often which, over all of a measurement and in ten parts of it.

use hdrhistogram::Histogram;
use serde::Serialize;

/// Parts of a measurement, equally long.
pub const PARTS: usize = 10;
/// Durations above are counted as this, ns; the longest is kept as it is.
const LONGEST_NS: u64 = 60_000_000_000;
/// Digits that a quantile is good for.
const DIGITS: u8 = 3;
const NS_PER_US: f64 = 1e3;

/// A distribution of durations.
#[derive(Clone, Debug)]
pub struct Distribution {
    histogram: Histogram<u64>,
    longest_ns: u64,
    /// Each part's durations, ns.
    parts: [Vec<u32>; PARTS],
}

/// ChainQuantiles, us. One that is beyond the longest of that many durations is not known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ChainQuantiles {
    /// Durations.
    pub count: u64,
    /// The median.
    pub p50: Option<f64>,
    /// One in a hundred is longer.
    pub p99: Option<f64>,
    /// One in a thousand is longer.
    pub p999: Option<f64>,
    /// One in ten thousand is longer.
    pub p9999: Option<f64>,
    /// The longest.
    pub max: Option<f64>,
}

impl Default for Distribution {
    #[allow(clippy::expect_used, reason = "the bounds are constants, and a test builds it")]
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(1, LONGEST_NS, DIGITS).expect("constant bounds are valid");
        Self { histogram, longest_ns: 0, parts: [const { Vec::new() }; PARTS] }
    }
}

impl Distribution {
    /// Takes a duration; `share` is how much of the measurement had passed, 0 to 1.
    pub fn push(&mut self, share: f64, duration_ns: u64) {
        self.histogram.saturating_record(duration_ns);
        self.longest_ns = self.longest_ns.max(duration_ns);
        let part = ((share * PARTS as f64) as usize).min(PARTS - 1);
        self.parts[part].push(u32::try_from(duration_ns).unwrap_or(u32::MAX));
    }

    /// Durations taken.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.histogram.len()
    }

    /// A quantile, us; `None` if that many durations do not tell it.
    #[must_use]
    pub fn quantile_us(&self, quantile: f64) -> Option<f64> {
        let enough = self.count() as f64 * (1.0 - quantile) >= 1.0 - 1e-9;
        enough.then(|| self.histogram.value_at_quantile(quantile).min(self.longest_ns) as f64 / NS_PER_US)
    }

    /// The usual quantiles.
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

    /// A quantile of each part, us; `None` where its durations do not tell it.
    #[must_use]
    pub fn parts_us(&self, quantile: f64) -> [Option<f64>; PARTS] {
        std::array::from_fn(|i| {
            let mut part = self.parts[i].clone();
            if (part.len() as f64) * (1.0 - quantile) < 1.0 - 1e-9 {
                return None;
            }
            let rank = (part.len() as f64 * quantile).ceil() as usize;
            let (_, value, _) = part.select_nth_unstable(rank.saturating_sub(1));
            Some(f64::from(*value) / NS_PER_US)
        })
    }

    /// Duration in us, and how many of `of` durations were longer: steps down to the longest.
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
        // The longest has none beyond it, which a logarithmic axis cannot show.
        if let (Some(last), true) = (curve.last_mut(), all > 0) {
            last.1 = 0.5 * per;
        }
        curve
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 to 1000 us, in order.
    fn ramp() -> Distribution {
        let mut d = Distribution::default();
        (0..1000).for_each(|i| d.push(f64::from(i) / 1000.0, 1000 * (i as u64 + 1)));
        d
    }

    fn near(a: Option<f64>, b: f64) -> bool {
        a.is_some_and(|a| (a - b).abs() <= 2e-3 * b)
    }

    #[test]
    fn quantiles_are_where_they_should_be_and_no_more_are_told_than_known() {
        let q = ramp().quantiles();
        assert!(near(q.p50, 500.0) && near(q.p99, 990.0) && near(q.p999, 999.0), "{q:?}");
        assert_eq!((q.count, q.p9999, q.max), (1000, None, Some(1000.0)));
        assert_eq!(Distribution::default().quantiles(), ChainQuantiles::default());
    }

    #[test]
    fn parts_are_told_apart() {
        let parts = ramp().parts_us(0.5);
        assert_eq!(parts.map(|p| p.map(f64::round)), std::array::from_fn(|i| Some(100.0 * i as f64 + 50.0)));
        assert_eq!(ramp().parts_us(0.999), [None; PARTS]);
    }

    #[test]
    fn the_curve_falls_to_the_longest() {
        let curve = ramp().longer_than(100_000.0);
        assert!(curve.windows(2).all(|w| w[0].0 < w[1].0 && w[0].1 > w[1].1));
        let median = curve.iter().find(|p| p.0 >= 500.0).map(|p| p.1);
        assert!(near(median, 50_000.0), "{median:?}");
        assert!(curve.last().is_some_and(|p| p.0 >= 1000.0 && p.1 == 50.0));
        assert!(Distribution::default().longer_than(1.0).is_empty());
    }

    #[test]
    fn what_is_longer_than_can_be_counted_counts_as_the_longest() {
        let mut d = Distribution::default();
        d.push(0.0, u64::MAX / 2);
        d.push(7.0, 0);
        assert_eq!(d.quantiles().count, 2);
        assert!(d.quantiles().max.is_some_and(|max| max > 1e12));
    }
}
