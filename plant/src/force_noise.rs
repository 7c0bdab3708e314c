//! Noise of the force sensor: normal, independent per tick and axis, a function of seed and tick alone.

/// Noise of the force sensor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ForceNoise {
    /// Standard deviation of each axis [N]; 0: no noise.
    pub(crate) deviation: f64,
    /// Seed of the scenario.
    pub(crate) seed: u64,
}

impl ForceNoise {
    /// Noise of a tick [N]. Without state, so that a resumed plant continues with the same numbers.
    pub(crate) fn at(&self, tick: i64) -> [f64; 3] {
        if self.deviation == 0.0 {
            return [0.0; 3];
        }
        core::array::from_fn(|axis| {
            // A new stream per tick and axis; the odd constant spreads neighbouring ticks.
            let stream = self.seed ^ (tick as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(axis as u64);
            let mut random = fastrand::Rng::with_seed(stream);
            // Box-Muller; 1 - u is in (0, 1].
            let radius = (-2.0 * (1.0 - random.f64()).ln()).sqrt();
            self.deviation * radius * (core::f64::consts::TAU * random.f64()).cos()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn force_noise_has_its_deviation_and_repeats() {
        let noise = ForceNoise { deviation: 0.5, seed: 7 };
        let all: Vec<f64> = (0..20_000).flat_map(|tick| noise.at(tick)).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let square = all.iter().map(|n| n * n).sum::<f64>() / all.len() as f64;
        // Successive samples of one axis are independent.
        let lag = all.windows(4).map(|w| w[0] * w[3]).sum::<f64>() / all.len() as f64;
        assert!(mean.abs() < 0.01 && (square.sqrt() - 0.5).abs() < 0.01 && lag.abs() < 0.01, "{mean} {square} {lag}");
        assert_eq!(noise.at(123), noise.at(123));
        assert_ne!(noise.at(123), ForceNoise { seed: 8, ..noise }.at(123));
        assert_eq!(ForceNoise { deviation: 0.0, ..noise }.at(5), [0.0; 3]);
    }
}
