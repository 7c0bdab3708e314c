//! Law on one axis: haptic search and force profile press a foot against an elastic wall.
//!
//! The laws are pure functions, so a loop over ticks suffices, without process, clock, log or robot.
//!
//! ```sh
//! cargo run --release -p hapfic-examples --bin law
//! ```
#![allow(clippy::print_stdout)]

use hapfic_controller::{ForceProfile, HapticParameters, HapticSearch};
use hapfic_messages::{ResetPolicy, Saturation, Search};

/// Control tick [s].
const PERIOD_S: f64 = 1e-3;
/// Integration steps of the foot in a tick: the wall is stiff.
const SUBSTEPS: u32 = 10;
/// Duration of the press [ticks].
const TICKS: u32 = 400;

/// Desired force F_d: the reaction of the wall on the foot [N].
const DESIRED_FORCE_N: f64 = 50.0;
/// Reference x_d: 5 mm behind the wall's surface, which is at 0 [m].
const REFERENCE_M: f64 = -0.005;

/// Foot that moves along one axis, with viscous friction.
struct Foot {
    position_m: f64,
    velocity_m_per_s: f64,
}

impl Foot {
    const MASS_KG: f64 = 0.5;
    const DAMPING_N_S_PER_M: f64 = 300.0;
    const WALL_N_PER_M: f64 = 5e4;

    /// Reaction of the wall, which only pushes [N].
    fn wall_force(&self) -> f64 {
        (-Self::WALL_N_PER_M * self.position_m).max(0.0)
    }

    /// Integrates a control tick under a constant force of the controller [N], by semi-implicit Euler steps.
    fn advance(&mut self, force: f64) {
        let step_s = PERIOD_S / f64::from(SUBSTEPS);
        for _ in 0..SUBSTEPS {
            let total = force + self.wall_force() - Self::DAMPING_N_S_PER_M * self.velocity_m_per_s;
            self.velocity_m_per_s += total / Self::MASS_KG * step_s;
            self.position_m += self.velocity_m_per_s * step_s;
        }
    }
}

fn main() {
    // The linear part reaches to 0.95 K0 x_b = 95 N: enough for F_d.
    let profile = ForceProfile { stiffness: 4000.0, max_force: 150.0, position_bound: 0.025, saturation: Saturation::Continuous };
    let parameters = HapticParameters {
        stiffness: profile.stiffness,
        position_bound: profile.position_bound,
        search: Search::Tapered,
        reset_policy: ResetPolicy::ContactLoss,
        taper: 0.2,
        search_scale: 0.01,
        force_resolution: 0.01,
        period_s: PERIOD_S,
    };

    // The foot starts 10 mm before the wall, at rest; the search starts without an offset.
    let mut foot = Foot { position_m: 0.01, velocity_m_per_s: 0.0 };
    let mut search = HapticSearch::default();
    println!("  t [ms]   x [mm]  dx [mm]    F [N]");
    for tick in 0..=TICKS {
        // Measure, search (Algorithm 1), apply the profile (eq. 4) to e = x_d + dx - x.
        let measured = foot.wall_force();
        search = search.step(DESIRED_FORCE_N, measured, &parameters);
        let error = REFERENCE_M + search.offset_m - foot.position_m;
        let force = profile.force(error);
        if tick % 40 == 0 {
            println!("{tick:>8} {:>8.3} {:>8.3} {measured:>8.3}", 1e3 * foot.position_m, 1e3 * search.offset_m);
        }
        foot.advance(force);
    }
    println!("settled force {:.3} N, desired {DESIRED_FORCE_N} N", foot.wall_force());
}
