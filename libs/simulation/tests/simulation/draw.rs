//! Random numbers: SplitMix64, so that a seed always gives the same sequence.

/// Sequence of random numbers.
pub struct Draw(u64);

impl Draw {
    pub fn new(seed: u64) -> Self {
        // Neighbouring seeds are far apart.
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x6a09_e667_f3bc_c908)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [`low`, `high`).
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        // The 53 bits that a double holds.
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Log-uniform between `low` and `high`, both above zero.
    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        self.within(low.ln(), high.ln()).exp().clamp(low, high)
    }

    /// An integer from `low` to `high`, both included.
    pub fn whole(&mut self, low: u64, high: u64) -> u64 {
        low + self.next() % (high - low + 1)
    }

    /// True with probability 1 / `n`.
    pub fn one_in(&mut self, n: u64) -> bool {
        self.whole(1, n) == 1
    }

    pub fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.whole(0, choices.len() as u64 - 1) as usize]
    }

    /// One value per axis.
    pub fn on_each_axis(&mut self, mut value: impl FnMut(&mut Self) -> f64) -> [f64; 3] {
        [value(self), value(self), value(self)]
    }
}

#[test]
fn draw_values_fill_range() {
    let mut draw = Draw::new(1);
    let (mut low, mut high, mut sum) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
    for _ in 0..10_000 {
        let value = draw.within(-1.0, 3.0);
        (low, high, sum) = (f64::min(low, value), f64::max(high, value), sum + value);
        assert!((3..=6).contains(&draw.whole(3, 6)));
        assert!((0.05..=3.0).contains(&draw.log_uniform(0.05, 3.0)));
    }
    assert!((-1.0..-0.99).contains(&low) && (2.99..3.0).contains(&high), "{low} to {high}");
    assert!((sum / 1e4 - 1.0).abs() < 0.05, "mean {}", sum / 1e4);
    assert_eq!(Draw::new(7).next(), Draw::new(7).next());
    assert_ne!(Draw::new(7).next(), Draw::new(8).next());
}
