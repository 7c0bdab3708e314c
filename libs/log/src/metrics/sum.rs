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
        // Clamped: values of another program may overflow, and every metric is finite.
        let size = value.abs().min(f64::MAX);
        self.squares = (self.squares + size * size).min(f64::MAX);
        self.largest = self.largest.max(size);
        self.count += 1;
    }

    /// Root mean square; `None` if nothing was added.
    pub(super) fn rms(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.squares / self.count as f64).sqrt())
    }
}
