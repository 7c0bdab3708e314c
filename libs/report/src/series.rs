//! Quantity over time, in bounded memory, with every peak.

use crate::{LATEST_TICK, is_plausible, seconds};

/// Most buckets of a series. A full series merges them in pairs.
pub const CAPACITY: usize = 2048;

/// Quantity over time as an envelope: smallest and largest value of each bucket, with their ticks.
///
/// A bucket is one tick wide at first, and twice as wide each time their number exceeds [`CAPACITY`]. A run of
/// twice as many ticks keeps every value; a run of any length keeps every peak at its tick. An empty bucket between
/// others is a gap: lost ticks, if they are wide enough to be visible.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Width of a bucket: 2^shift ticks.
    shift: u32,
    buckets: Vec<Bucket>,
    first: Option<TickValue>,
    last: Option<TickValue>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct TickValue {
    tick: i64,
    value: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Bucket {
    /// Ticks of the bucket, divided by the width.
    key: i64,
    min: TickValue,
    max: TickValue,
}

impl Bucket {
    fn merge(&mut self, min: TickValue, max: TickValue) {
        if min.value < self.min.value {
            self.min = min;
        }
        if max.value > self.max.value {
            self.max = max;
        }
    }
}

impl Series {
    /// Adds the value at a tick, in any order. Implausible values and invalid ticks are ignored.
    pub fn push(&mut self, tick: i64, value: f64) {
        if !(0..=LATEST_TICK).contains(&tick) || !is_plausible(value) {
            return;
        }
        let sample = TickValue { tick, value };
        if self.first.is_none_or(|first| tick < first.tick) {
            self.first = Some(sample);
        }
        if self.last.is_none_or(|last| tick > last.tick) {
            self.last = Some(sample);
        }
        let key = tick >> self.shift;
        let at = match self.buckets.last() {
            Some(last) if last.key < key => self.buckets.len(),
            _ => self.buckets.partition_point(|bucket| bucket.key < key),
        };
        match self.buckets.get_mut(at) {
            Some(bucket) if bucket.key == key => bucket.merge(sample, sample),
            _ => self.buckets.insert(at, Bucket { key, min: sample, max: sample }),
        }
        while self.buckets.len() > CAPACITY {
            self.halve();
        }
    }

    fn halve(&mut self) {
        self.shift += 1;
        let mut merged: Vec<Bucket> = Vec::with_capacity(CAPACITY + 1);
        for bucket in self.buckets.drain(..) {
            let key = bucket.key >> 1;
            match merged.last_mut() {
                Some(last) if last.key == key => last.merge(bucket.min, bucket.max),
                _ => merged.push(Bucket { key, ..bucket }),
            }
        }
        self.buckets = merged;
    }

    /// Whether the series has no value.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.buckets.is_empty()
    }

    /// Number of buckets in use, at most [`CAPACITY`].
    #[must_use]
    pub fn buckets(&self) -> usize {
        self.buckets.len()
    }

    /// Returns time [s] and value times `factor`, in the order of time.
    ///
    /// Of consecutive equal values only the ends are returned. A gap is one point with the value NaN.
    #[must_use]
    pub fn points(&self, factor: f64) -> Vec<(f64, f64)> {
        let mut points = Points { list: Vec::with_capacity(2 * self.buckets.len() + 2), newest: -1, factor };
        if let Some(first) = self.first {
            points.add(first);
        }
        let mut before = None;
        for bucket in &self.buckets {
            if before.is_some_and(|before: i64| bucket.key - before > 1) {
                points.gap();
            }
            before = Some(bucket.key);
            let (a, b) = (bucket.min, bucket.max);
            for sample in if a.tick <= b.tick { [a, b] } else { [b, a] } {
                points.add(sample);
            }
        }
        if let Some(last) = self.last {
            points.add(last);
        }
        points.list
    }
}

/// Points in the order of time, without those inside a constant line.
struct Points {
    list: Vec<(f64, f64)>,
    newest: i64,
    factor: f64,
}

impl Points {
    fn add(&mut self, sample: TickValue) {
        if sample.tick <= self.newest {
            return;
        }
        self.newest = sample.tick;
        let value = sample.value * self.factor;
        if let [.., (_, before), (_, last)] = self.list.as_slice()
            && *before == value
            && *last == value
        {
            self.list.pop();
        }
        self.list.push((seconds(sample.tick), value));
    }

    /// Begins a gap at the next tick.
    fn gap(&mut self) {
        self.newest += 1;
        self.list.push((seconds(self.newest), f64::NAN));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(ticks: i64, value: impl Fn(i64) -> f64) -> Series {
        let mut series = Series::default();
        for tick in 0..ticks {
            series.push(tick, value(tick));
        }
        series
    }

    #[test]
    fn series_short_run_keeps_every_tick() {
        let value = |tick: i64| (tick as f64 * 0.37).sin();
        let points = filled(2 * CAPACITY as i64, value).points(1.0);
        assert_eq!(points.len(), 2 * CAPACITY);
        for (tick, point) in points.iter().enumerate() {
            assert_eq!(*point, (tick as f64 / 1e3, value(tick as i64)));
        }
    }

    #[test]
    fn series_one_tick_peak_survives_one_hour() {
        let peak = 1_234_567;
        let series = filled(3_600_000, |tick| if tick == peak { 80.0 } else { (tick % 7) as f64 });
        assert!(series.buckets() <= CAPACITY && series.buckets() > CAPACITY / 4, "{} buckets", series.buckets());
        let points = series.points(2.0);
        assert!(points.contains(&(seconds(peak), 160.0)));
        assert_eq!(points.first(), Some(&(0.0, 0.0)));
        assert_eq!(points.last().map(|point| point.0), Some(seconds(3_599_999)));
        assert!(points.is_sorted_by(|a, b| a.0 < b.0));
    }

    #[test]
    fn series_bucket_envelope_matches_its_ticks() {
        let value = |tick: i64| ((tick * 7919) % 10_007) as f64;
        let series = filled(50_000, value);
        for bucket in &series.buckets {
            let ticks = (bucket.key << series.shift)..((bucket.key + 1) << series.shift);
            let values: Vec<_> = ticks.filter(|tick| *tick < 50_000).map(value).collect();
            assert_eq!(bucket.min.value, values.iter().copied().fold(f64::MAX, f64::min));
            assert_eq!(bucket.max.value, values.iter().copied().fold(f64::MIN, f64::max));
        }
    }

    #[test]
    fn series_constant_gives_two_points() {
        assert_eq!(filled(3000, |_| 5.0).points(1.0), [(0.0, 5.0), (2.999, 5.0)]);
    }

    #[test]
    fn series_invalid_samples_are_ignored() {
        let mut series = Series::default();
        for (tick, value) in [(-1, 1.0), (i64::MAX, 1.0), (3, f64::NAN), (3, f64::INFINITY), (3, 1e300)] {
            series.push(tick, value);
        }
        assert!(series.is_empty());
        series.push(LATEST_TICK, 1.0);
        series.push(5, 2.0);
        let points = series.points(1.0);
        assert_eq!((points[0], points[2]), ((seconds(5), 2.0), (seconds(LATEST_TICK), 1.0)));
        assert!(points.len() == 3 && points[1].1.is_nan());
    }

    #[test]
    fn series_lost_ticks_are_gap() {
        let gaps = |series: &Series| {
            let points = series.points(1.0);
            assert!(points.is_sorted_by(|a, b| a.0 < b.0));
            points.iter().filter(|point| point.1.is_nan()).map(|point| point.0).collect::<Vec<_>>()
        };
        let mut short = filled(100, |_| 1.0);
        for tick in (101..200).chain(300..400) {
            short.push(tick, 1.0);
        }
        assert_eq!(gaps(&short), [seconds(100), seconds(200)]);
        assert_eq!(short.points(1.0).len(), 3 * 2 + 2, "the ends of three pieces, and two gaps");
        // A bucket is 64 ticks wide by then: one lost tick is invisible, 1000 are not.
        let mut long = filled(50_000, |tick| (tick % 2) as f64);
        for tick in (50_001..60_000).chain(61_000..100_000) {
            long.push(tick, (tick % 2) as f64);
        }
        let found = gaps(&long);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!((59.9..60.2).contains(&found[0]), "{found:?}");
    }
}
