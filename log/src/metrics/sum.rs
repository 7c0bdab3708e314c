//! Root mean squares and largest values, in one pass.

/// Sum of squares.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sum {
    squares: f64,
    pub(super) largest: f64,
    pub(super) count: u64,
}

impl Sum {
    pub(super) fn add(&mut self, value: f64) {
        self.squares += value * value;
        self.largest = self.largest.max(value.abs());
        self.count += 1;
    }

    /// Root of the mean square; `None` if nothing was added.
    pub(super) fn rms(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.squares / self.count as f64).sqrt())
    }
}
