//! The contact law: the paper's Spatial Contact Force, with its damping, transition and friction.
//!
//! With the depth d, its rate d' and the transition width w,
//!
//! ```text
//! F_n = max(0, s(d) (k d + b d')),   s = r^2 (3 - 2 r),   r = clamp(d / w, 0, 1)
//! F_t = mu(|v_t|) F_n, against the slip v_t
//! mu  = mu_s r (2 - r),                                  r = |v_t| / v_c,                 |v_t| <= v_c
//! mu  = mu_s + (mu_d - mu_s) r^2 (3 - 2 r),              r = (|v_t| - v_c) / (2 v_c),     v_c < |v_t| < 3 v_c
//! mu  = mu_d                                                                              beyond
//! ```
//!
//! A loaded contact therefore creeps, slower than v_c: the law itself demands this.

use hapfic_config::Surface;

/// Parameters of a contact between two bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactLaw {
    /// k [N/m].
    pub stiffness: f64,
    /// b [N s/m].
    pub damping: f64,
    /// w [m].
    pub transition_width: f64,
    /// mu_s.
    pub friction_static: f64,
    /// mu_d.
    pub friction_dynamic: f64,
    /// v_c [m/s].
    pub critical_speed: f64,
}

/// A value and its derivative.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ValueAndSlope {
    /// The value.
    pub value: f64,
    /// The derivative with respect to the argument.
    pub slope: f64,
}

/// A normal force and its derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NormalForce {
    /// F_n [N].
    pub force: f64,
    /// dF_n / dd [N/m].
    pub by_depth: f64,
    /// dF_n / dd' [N s/m].
    pub by_rate: f64,
}

impl ContactLaw {
    /// The law of a surface.
    #[must_use]
    pub const fn of(surface: &Surface) -> Self {
        Self {
            stiffness: surface.stiffness_n_per_m,
            damping: surface.damping_n_s_per_m,
            transition_width: surface.transition_width_m,
            friction_static: surface.friction_static,
            friction_dynamic: surface.friction_dynamic,
            critical_speed: surface.critical_speed_m_per_s,
        }
    }

    /// s(d): 0 at touch, 1 from w on, with zero slope at both ends.
    #[must_use]
    #[inline]
    pub fn transition(&self, depth: f64) -> ValueAndSlope {
        let r = depth / self.transition_width;
        if r <= 0.0 {
            ValueAndSlope { value: 0.0, slope: 0.0 }
        } else if r >= 1.0 {
            ValueAndSlope { value: 1.0, slope: 0.0 }
        } else {
            ValueAndSlope { value: r * r * (3.0 - 2.0 * r), slope: 6.0 * r * (1.0 - r) / self.transition_width }
        }
    }

    /// Normal force for a depth [m] and its rate [m/s], positive while the depth grows. Never attractive.
    #[must_use]
    #[inline]
    pub fn normal(&self, depth: f64, rate: f64) -> NormalForce {
        let s = self.transition(depth);
        let spring = self.stiffness * depth + self.damping * rate;
        let force = s.value * spring;
        if force <= 0.0 {
            return NormalForce::default();
        }
        NormalForce { force, by_depth: s.slope * spring + s.value * self.stiffness, by_rate: s.value * self.damping }
    }

    /// Coefficient of friction for a slip speed [m/s], zero or more.
    #[must_use]
    #[inline]
    pub fn friction(&self, speed: f64) -> ValueAndSlope {
        let r = speed / self.critical_speed;
        if r <= 1.0 {
            ValueAndSlope {
                value: self.friction_static * r * (2.0 - r),
                slope: self.friction_static * 2.0 * (1.0 - r) / self.critical_speed,
            }
        } else if r < 3.0 {
            let u = 0.5 * (r - 1.0);
            let fall = self.friction_dynamic - self.friction_static;
            ValueAndSlope {
                value: self.friction_static + fall * u * u * (3.0 - 2.0 * u),
                slope: fall * 6.0 * u * (1.0 - u) / (2.0 * self.critical_speed),
            }
        } else {
            ValueAndSlope { value: self.friction_dynamic, slope: 0.0 }
        }
    }

    /// mu(|v|) / |v|, which stays finite at rest [s/m].
    #[must_use]
    #[inline]
    pub fn friction_per_speed(&self, speed: f64) -> f64 {
        let r = speed / self.critical_speed;
        if r <= 1.0 { self.friction_static * (2.0 - r) / self.critical_speed } else { self.friction(speed).value / speed }
    }

    /// Elastic energy at a depth [J]: the integral of s(x) k x from 0 to the depth.
    #[must_use]
    pub fn stored(&self, depth: f64) -> f64 {
        let (k, w) = (self.stiffness, self.transition_width);
        let r = (depth / w).clamp(0.0, 1.0);
        let inside = k * w * w * r.powi(4) * (0.75 - 0.4 * r);
        if depth > w { inside + 0.5 * k * (depth * depth - w * w) } else { inside }
    }

    /// Depth at which the law carries a steady normal force [m].
    #[must_use]
    pub fn depth_at(&self, force: f64) -> f64 {
        if force <= 0.0 {
            return 0.0;
        }
        // s(d) k d rises strictly: bisection between zero and the depth without the transition, plus w.
        let (mut low, mut high) = (0.0, self.transition_width + force / self.stiffness);
        for _ in 0..200 {
            let midpoint = 0.5 * (low + high);
            if self.normal(midpoint, 0.0).force < force {
                low = midpoint;
            } else {
                high = midpoint;
            }
        }
        0.5 * (low + high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAW: ContactLaw = ContactLaw {
        stiffness: 1e6,
        damping: 1e4,
        transition_width: 1e-3,
        friction_static: 0.5,
        friction_dynamic: 0.3,
        critical_speed: 1e-3,
    };

    #[test]
    fn contact_law_derivatives_match_differences() {
        let step = 1e-9;
        for i in 1..2000 {
            let (d, rate) = (f64::from(i) * 1e-6, 0.01);
            let n = LAW.normal(d, rate);
            let by_depth = (LAW.normal(d + step, rate).force - LAW.normal(d - step, rate).force) / (2.0 * step);
            assert!((n.by_depth - by_depth).abs() <= 1e-5 * by_depth.abs().max(1e3), "{d}: {} {by_depth}", n.by_depth);
            let by_rate = (LAW.normal(d, rate + step).force - LAW.normal(d, rate - step).force) / (2.0 * step);
            assert!((n.by_rate - by_rate).abs() <= 1e-4 * by_rate.abs().max(1.0));
            let v = f64::from(i) * 2e-6 + 1e-7;
            let mu = LAW.friction(v);
            let slope = (LAW.friction(v + step).value - LAW.friction(v - step).value) / (2.0 * step);
            assert!((mu.slope - slope).abs() < 1e-3, "{v}: {} {slope}", mu.slope);
            assert!((LAW.friction_per_speed(v) * v - mu.value).abs() < 1e-12);
        }
    }

    #[test]
    fn contact_law_stored_energy_is_work() {
        let (mut sum, step) = (0.0, 1e-7);
        for i in 0..25_000 {
            let depth = (f64::from(i) + 0.5) * step;
            sum += LAW.normal(depth, 0.0).force * step;
            let stored = LAW.stored(depth + 0.5 * step);
            assert!((stored - sum).abs() <= 1e-4 * sum + 1e-12, "{depth}: {stored} against {sum}");
        }
        assert_eq!(LAW.stored(-1.0), 0.0);
    }

    #[test]
    fn contact_law_separation_never_pulls() {
        assert_eq!(LAW.normal(1e-4, -1.0), NormalForce::default());
        assert_eq!(LAW.normal(-1e-4, 1.0), NormalForce::default());
    }

    #[test]
    fn contact_law_50_n_has_published_depth() {
        assert!((LAW.depth_at(50.0) - 0.2731e-3).abs() < 1e-7);
        assert!((LAW.normal(LAW.depth_at(300.0), 0.0).force - 300.0).abs() < 1e-9);
    }
}
