//! Latency histogram over eight decades.

/// Bins per decade.
const PER_DECADE: usize = 20;
/// Decades: 0.1 us to 10 s.
const DECADES: usize = 8;
/// Lower end of the first bin [us].
const MIN_US: f64 = 0.1;
const BINS: usize = PER_DECADE * DECADES;

/// Logarithmic histogram of durations. Values outside the range count in the nearest bin.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Histogram {
    bins: Vec<u64>,
    count: u64,
    largest_ns: u64,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { bins: vec![0; BINS], count: 0, largest_ns: 0 }
    }
}

impl Histogram {
    /// Adds a duration [ns].
    pub fn push(&mut self, ns: u64) {
        let decades = (ns as f64 * 1e-3 / MIN_US).log10();
        // Zero gives minus infinity, which the cast makes zero.
        let bin = ((decades * PER_DECADE as f64).floor() as usize).min(BINS - 1);
        self.bins[bin] += 1;
        self.count += 1;
        self.largest_ns = self.largest_ns.max(ns);
    }

    /// Number of durations.
    #[must_use]
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// Longest duration [us].
    #[must_use]
    pub fn largest_us(&self) -> f64 {
        self.largest_ns as f64 * 1e-3
    }

    /// Outline of the bins from the first to the last non-empty bin: duration [us] and count.
    ///
    /// `floor` replaces a count of zero, which a logarithmic axis cannot show.
    #[must_use]
    pub fn outline(&self, floor: f64) -> Vec<(f64, f64)> {
        let edge = |bin: usize| MIN_US * 10_f64.powf(bin as f64 / PER_DECADE as f64);
        let filled = |count: &u64| *count > 0;
        let (Some(first), Some(last)) = (self.bins.iter().position(filled), self.bins.iter().rposition(filled)) else {
            return Vec::new();
        };
        let mut points = vec![(edge(first), floor)];
        for (bin, count) in self.bins.iter().enumerate().take(last + 1).skip(first) {
            let height = if *count == 0 { floor } else { *count as f64 };
            points.push((edge(bin), height));
            points.push((edge(bin + 1), height));
        }
        points.push((edge(last + 1), floor));
        points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histogram_duration_counts_in_its_bin() {
        let mut histogram = Histogram::default();
        for ns in [55_000, 55_000, 900_000] {
            histogram.push(ns);
        }
        let outline = histogram.outline(0.5);
        let at = |us: f64| outline.windows(2).find(|w| w[0].0 <= us && us < w[1].0).map(|w| w[0].1);
        assert_eq!((at(55.0), at(200.0), at(900.0)), (Some(2.0), Some(0.5), Some(1.0)));
        assert_eq!((histogram.count(), histogram.largest_us()), (3, 900.0));
    }

    #[test]
    fn histogram_extremes_count_in_end_bins() {
        let mut histogram = Histogram::default();
        for ns in [0, 1, u64::MAX] {
            histogram.push(ns);
        }
        assert_eq!((histogram.bins[0], histogram.bins[BINS - 1]), (2, 1));
        assert!(Histogram::default().outline(1.0).is_empty());
    }
}
