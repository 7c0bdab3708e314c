//! Passivity observer of one axis.

use hapfic_controller::ForceProfile;

/// Ticks over which a fall of the observer counts.
const WINDOW: usize = 100;
/// Samples of the stored energy's integral.
const SAMPLES: u32 = 32;

/// Observer `W = E_ref - E_ctrl - U(e)` of one axis: what reference and search have put in, less what the robot has got,
/// less what the spring stores.
///
/// W never falls under a passive controller. The force is that of the torque that really acted, a tick late, so the
/// energy of the dead time shows.
#[derive(Clone, Debug)]
pub(super) struct PassivityObserver {
    /// E_ref - E_ctrl [J].
    supplied: f64,
    history: [f64; WINDOW],
    next: usize,
    filled: usize,
    before: Option<(f64, f64)>,
}

impl Default for PassivityObserver {
    fn default() -> Self {
        Self { supplied: 0.0, history: [0.0; WINDOW], next: 0, filled: 0, before: None }
    }
}

impl PassivityObserver {
    /// Begins anew, as after a change of gains, which changes U without a motion.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }

    /// Adds a tick: position x and attractor's centre x_d + dx at its state [m], and the force that acted since the state
    /// before [N]. Returns the fall of W within 100 ms [J].
    pub(super) fn push(&mut self, position: f64, centre: f64, force: f64, profile: &ForceProfile) -> f64 {
        let (x, c) = self.before.replace((position, centre)).unwrap_or((position, centre));
        self.supplied += force * ((centre - c) - (position - x));
        let value = self.supplied - stored(profile, centre - position);
        self.history[self.next] = value;
        self.next = (self.next + 1) % WINDOW;
        self.filled = (self.filled + 1).min(WINDOW);
        let highest = self.history[..self.filled].iter().fold(f64::NEG_INFINITY, |most, w| most.max(*w));
        highest - value
    }
}

/// U(e) [J]: integral of the profile.
fn stored(profile: &ForceProfile, error: f64) -> f64 {
    let step = error / f64::from(SAMPLES);
    (0..SAMPLES).map(|i| profile.force((f64::from(i) + 0.5) * step) * step).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hapfic_messages::Saturation;

    const PROFILE: ForceProfile =
        ForceProfile { stiffness: 1000.0, max_force: 100.0, position_bound: 0.1, saturation: Saturation::Softening };

    /// Largest fall of W of a spring with `damping` [N s/m] and a delay in ticks, on a mass of 1 kg [J].
    fn fall(damping: f64, delay: usize) -> f64 {
        let (mut x, mut v, mut observer, mut worst) = (0.05, 0.0, PassivityObserver::default(), 0.0_f64);
        let mut forces = vec![0.0; delay + 1];
        for _ in 0..1000 {
            let force = forces.remove(0);
            worst = worst.max(observer.push(x, 0.0, force, &PROFILE));
            forces.push(PROFILE.force(-x) - damping * v);
            v += 1e-3 * force;
            x += 1e-3 * v;
        }
        worst
    }

    #[test]
    fn observer_falls_with_delay_and_not_with_damping() {
        assert!(fall(0.0, 8) > 5.0 * fall(5.0, 0), "{} {}", fall(0.0, 8), fall(5.0, 0));
    }
}
