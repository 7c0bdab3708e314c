//! Comparison of a chain with another one that was measured in the same milliseconds.

use crate::distribution::Distribution;
use serde::Serialize;
use std::fmt;

/// Ratio of a quantile of two distributions, and its range over the segments of the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ratio {
    /// Ratio over the whole measurement.
    pub whole: f64,
    /// Smallest and largest ratio of a segment; `None` if a segment has too few durations.
    pub parts: Option<(f64, f64)>,
}

impl Ratio {
    /// Divides a quantile of two distributions; `None` if one of them has too few durations.
    #[must_use]
    pub fn of(quantile: f64, one: &Distribution, other: &Distribution) -> Option<Self> {
        let divide = |a: f64, b: f64| (b > 0.0).then(|| a / b);
        let whole = divide(one.quantile_us(quantile)?, other.quantile_us(quantile)?)?;
        let pairs = one.segments_us(quantile).into_iter().zip(other.segments_us(quantile));
        let ratios: Option<Vec<f64>> = pairs.map(|(a, b)| divide(a?, b?)).collect();
        let parts = ratios.map(|list| list.iter().fold((f64::MAX, f64::MIN), |r, v| (r.0.min(*v), r.1.max(*v))));
        Some(Self { whole, parts })
    }
}

impl fmt::Display for Ratio {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.2} x", self.whole)?;
        match self.parts {
            Some((least, largest)) => write!(f, " ({least:.2} to {largest:.2} over ten segments)"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn steady(ns: impl Fn(usize) -> u64) -> Distribution {
        let mut d = Distribution::default();
        (0..1000).for_each(|i| d.push(i as f64 / 1000.0, ns(i)));
        d
    }

    #[test]
    fn ratio_drifting_chains_has_range_over_segments() {
        // The machine slows down for both chains; in the last segment more for the first one.
        let drift = |i: usize| 50_000 + 20 * i as u64;
        let one = steady(|i| drift(i) * if i >= 900 { 3 } else { 2 });
        let ratio = Ratio::of(0.5, &one, &steady(drift)).unwrap();
        assert!((ratio.whole - 2.0).abs() < 0.01, "{ratio:?}");
        let (least, largest) = ratio.parts.unwrap();
        assert!((least - 2.0).abs() < 0.01 && (largest - 3.0).abs() < 0.01, "{ratio:?}");
        assert_eq!(ratio.to_string(), "2.00 x (2.00 to 3.00 over ten segments)");
    }

    #[test]
    fn ratio_too_few_durations_is_none() {
        let few = steady(|_| 1000);
        let ratio = Ratio::of(0.999, &few, &few).unwrap();
        assert_eq!((ratio.whole, ratio.parts, ratio.to_string()), (1.0, None, "1.00 x".to_owned()));
        assert_eq!(Ratio::of(0.9999, &few, &few), None);
        assert_eq!(Ratio::of(0.5, &few, &Distribution::default()), None);
        assert_eq!(Ratio::of(0.5, &few, &steady(|_| 0)), None);
    }
}
