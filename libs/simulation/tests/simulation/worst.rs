//! Largest value of a figure, with its seed and tick.

use std::fmt;

/// Largest noted value. NaN counts as the largest of all.
#[derive(Clone, Copy, Debug)]
pub struct Worst {
    pub value: f64,
    seed: u64,
    tick: i64,
}

impl Worst {
    pub fn of(seed: u64) -> Self {
        Self { value: f64::NEG_INFINITY, seed, tick: -1 }
    }

    pub fn note(&mut self, value: f64, tick: i64) {
        if value.is_nan() || value > self.value {
            (self.value, self.tick) = (value, tick);
        }
    }

    /// The larger of two.
    pub fn or(self, other: Self) -> Self {
        if other.value.is_nan() || other.value > self.value { other } else { self }
    }

    /// Whether the value is below a limit; false for NaN.
    pub fn is_below(&self, limit: f64) -> bool {
        self.value < limit
    }
}

impl fmt::Display for Worst {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3e} (seed {}, tick {})", self.value, self.seed, self.tick)
    }
}
