//! The largest value of something, and where it was.

use std::fmt;

/// The largest value noted. Not a number counts as largest of all.
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

    /// The worse of two.
    pub fn or(self, other: Self) -> Self {
        if other.value.is_nan() || other.value > self.value { other } else { self }
    }

    /// Whether it stays below a limit. Not a number does not.
    pub fn is_below(&self, limit: f64) -> bool {
        self.value < limit
    }
}

impl fmt::Display for Worst {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3e} (seed {}, tick {})", self.value, self.seed, self.tick)
    }
}
