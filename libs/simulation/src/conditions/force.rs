//! Force of an axis over the last 0.2 s.

use hapfic_messages::Parameters;

/// Ticks of the window.
pub(super) const WINDOW: usize = 200;
/// Ticks between two evaluations.
pub(super) const EVERY: i64 = 10;
/// Crossings of the mean in the window that make an oscillation: two periods, 10 Hz.
const CROSSINGS: usize = 4;

/// Forces of one axis.
#[derive(Clone, Debug)]
pub(super) struct ForceWindow {
    forces: [f64; WINDOW],
    next: usize,
    /// Gains and F_d of the axis: K0, F_max, x_b, F_d.
    set: [f64; 4],
    /// Ticks since the set changed.
    pub(super) constant: i64,
}

impl Default for ForceWindow {
    fn default() -> Self {
        Self { forces: [0.0; WINDOW], next: 0, set: [0.0; 4], constant: 0 }
    }
}

/// Figures of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ForceFigures {
    /// Mean force [N].
    pub(super) mean: f64,
    /// Root mean square about the mean [N]; zero if the force does not oscillate.
    pub(super) oscillation: f64,
}

impl ForceWindow {
    pub(super) fn push(&mut self, force: f64, axis: usize, p: &Parameters) {
        let set = [p.stiffness[axis], p.max_force[axis], p.position_bound[axis], p.desired_force[axis]];
        self.constant = if set == self.set { self.constant + 1 } else { 0 };
        self.set = set;
        self.forces[self.next] = force;
        self.next = (self.next + 1) % WINDOW;
    }

    pub(super) fn figures(&self) -> ForceFigures {
        let mean = self.forces.iter().sum::<f64>() / WINDOW as f64;
        let square = self.forces.iter().map(|force| (force - mean) * (force - mean)).sum::<f64>() / WINDOW as f64;
        let ordered = self.forces[self.next..].iter().chain(&self.forces[..self.next]);
        let above: Vec<bool> = ordered.map(|force| *force > mean).collect();
        let crossings = above.windows(2).filter(|pair| pair[0] != pair[1]).count();
        ForceFigures { mean, oscillation: if crossings >= CROSSINGS { square.sqrt() } else { 0.0 } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(force: impl Fn(f64) -> f64) -> ForceFigures {
        let mut window = ForceWindow::default();
        (0..WINDOW).for_each(|i| window.push(force(i as f64 * 1e-3), 2, &Parameters::default()));
        window.figures()
    }

    #[test]
    fn window_tells_oscillation_from_settling() {
        let settling = figures(|t| 50.0 + 40.0 * (-t / 0.05).exp());
        assert!(settling.oscillation == 0.0 && settling.mean > 50.0, "{settling:?}");
        let cycling = figures(|t| 50.0 + 5.0 * (t * 60.0 * core::f64::consts::TAU).sin());
        assert!((cycling.oscillation - 5.0 / 2.0_f64.sqrt()).abs() < 0.05 && (cycling.mean - 50.0).abs() < 0.1, "{cycling:?}");
    }
}
