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
//! A loaded contact therefore creeps, slower than v_c: that is the law, not an error.

/// Parameters of a contact between two bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactLaw {
    /// k, N/m.
    pub stiffness: f64,
    /// b, N s/m.
    pub damping: f64,
    /// w, m.
    pub transition_width: f64,
    /// mu_s.
    pub friction_static: f64,
    /// mu_d.
    pub friction_dynamic: f64,
    /// v_c, m/s.
    pub critical_speed: f64,
}

/// A value and its derivative.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sloped {
    /// The value.
    pub value: f64,
    /// The derivative by the argument.
    pub slope: f64,
}

/// A normal force and its derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Normal {
    /// F_n, N.
    pub force: f64,
    /// dF_n / dd, N/m.
    pub by_depth: f64,
    /// dF_n / dd', N s/m.
    pub by_rate: f64,
}

impl ContactLaw {
    /// s(d): 0 at touch, 1 from the width on, level at both ends.
    #[must_use]
    #[inline]
    pub fn transition(&self, depth: f64) -> Sloped {
        let r = depth / self.transition_width;
        if r <= 0.0 {
            Sloped { value: 0.0, slope: 0.0 }
        } else if r >= 1.0 {
            Sloped { value: 1.0, slope: 0.0 }
        } else {
            Sloped { value: r * r * (3.0 - 2.0 * r), slope: 6.0 * r * (1.0 - r) / self.transition_width }
        }
    }

    /// Normal force for a depth (m) and its rate (m/s, positive while sinking in). Never attractive.
    #[must_use]
    #[inline]
    pub fn normal(&self, depth: f64, rate: f64) -> Normal {
        let s = self.transition(depth);
        let spring = self.stiffness * depth + self.damping * rate;
        let force = s.value * spring;
        if force <= 0.0 {
            return Normal::default();
        }
        Normal { force, by_depth: s.slope * spring + s.value * self.stiffness, by_rate: s.value * self.damping }
    }

    /// Coefficient of friction for a slip speed (m/s, not negative).
    #[must_use]
    #[inline]
    pub fn friction(&self, speed: f64) -> Sloped {
        let r = speed / self.critical_speed;
        if r <= 1.0 {
            Sloped {
                value: self.friction_static * r * (2.0 - r),
                slope: self.friction_static * 2.0 * (1.0 - r) / self.critical_speed,
            }
        } else if r < 3.0 {
            let u = 0.5 * (r - 1.0);
            let fall = self.friction_dynamic - self.friction_static;
            Sloped {
                value: self.friction_static + fall * u * u * (3.0 - 2.0 * u),
                slope: fall * 6.0 * u * (1.0 - u) / (2.0 * self.critical_speed),
            }
        } else {
            Sloped { value: self.friction_dynamic, slope: 0.0 }
        }
    }

    /// mu(|v|) / |v|, which stays finite at rest, s/m.
    #[must_use]
    #[inline]
    pub fn friction_per_speed(&self, speed: f64) -> f64 {
        let r = speed / self.critical_speed;
        if r <= 1.0 { self.friction_static * (2.0 - r) / self.critical_speed } else { self.friction(speed).value / speed }
    }

    /// Elastic energy of a depth, J: the integral of s(x) k x from touch to there.
    #[must_use]
    pub fn stored(&self, depth: f64) -> f64 {
        let (k, w) = (self.stiffness, self.transition_width);
        let r = (depth / w).clamp(0.0, 1.0);
        let inside = k * w * w * r.powi(4) * (0.75 - 0.4 * r);
        if depth > w { inside + 0.5 * k * (depth * depth - w * w) } else { inside }
    }

    /// Depth at which the law carries a steady normal force, m.
    #[must_use]
    pub fn depth_at(&self, force: f64) -> f64 {
        if force <= 0.0 {
            return 0.0;
        }
        // s(d) k d rises strictly: bisection, between nothing and the depth that would do without the transition.
        let (mut low, mut high) = (0.0, self.transition_width + force / self.stiffness);
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if self.normal(middle, 0.0).force < force {
                low = middle;
            } else {
                high = middle;
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
    fn derivatives_agree_with_differences() {
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
    fn what_a_contact_stores_is_the_work_of_pressing_it() {
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
    fn pulls_at_nothing() {
        assert_eq!(LAW.normal(1e-4, -1.0), Normal::default());
        assert_eq!(LAW.normal(-1e-4, 1.0), Normal::default());
    }

    #[test]
    fn fifty_newton_sink_in_by_the_published_depth() {
        assert!((LAW.depth_at(50.0) - 0.2731e-3).abs() < 1e-7);
        assert!((LAW.normal(LAW.depth_at(300.0), 0.0).force - 300.0).abs() < 1e-9);
    }
}
