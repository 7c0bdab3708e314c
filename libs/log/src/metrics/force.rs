//! Metrics of the force error F - F_d: while a force is held, and its recovery after a change.

use super::sample::{ParameterSample, ReferenceSample, StateSample};
use super::sum::Sum;
use super::summary::ForceSummary;

/// Time without a change after which the force counts as settled [ticks].
const SETTLING_TICKS: u64 = 500;
/// F_d counts as reached within this share of it.
const REACHED_SHARE: f64 = 0.01;
/// F_d counts as recovered after this time within reach [ticks].
const RECOVERY_TICKS: u64 = 100;

/// Speed across the axis above which a foot has broken away from static friction [m/s].
const SLIDING_M_PER_S: f64 = 0.01;
/// Time of sliding after which the transient of breaking away counts as over [ticks].
const BREAKAWAY_TICKS: u64 = 50;

/// Sums of the three axes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ForceSums {
    axes: [ForceAxisSums; 3],
    /// Tick since which the reference has been at rest on all axes.
    rest_since: Option<i64>,
}

/// Sums of an axis.
#[derive(Clone, Copy, Debug, Default)]
struct ForceAxisSums {
    target: Option<ForceTarget>,
    desired: Option<f64>,
    settled: Sum,
    settled_relative: Sum,
    /// While the reference moves across the axis.
    sliding_relative: Sum,
    /// While the foot slides, too, after breaking away.
    steady_sliding_relative: Sum,
    sliding_since: Option<i64>,
    /// Present hold if its count is not zero: consecutive settled ticks with the same target.
    hold: Sum,
    hold_force: f64,
    holds: u64,
    last_hold: Option<f64>,
    /// Error and F_d of the worst hold.
    worst_hold: Option<(f64, f64)>,
    overshoot: Option<f64>,
    recoveries: u64,
    unrecovered: u64,
    slowest: Option<u64>,
    not_reached: u64,
    /// Mean error of the worst segment in which F_d was not reached.
    not_reached_error: Option<f64>,
}

/// F_d on an axis, and the gains that hold it.
#[derive(Clone, Copy, Debug)]
struct ForceTarget {
    force: f64,
    gains: [f64; 3],
    since: i64,
    /// Reached since `since`.
    reached: bool,
    /// Reached since F_d was set, perhaps with other gains.
    matched: bool,
    /// Whether the axis had contact.
    touched: bool,
    /// First of the consecutive ticks within reach.
    within_since: Option<i64>,
    recovered: bool,
    /// Sum of the error after the settling time, and its ticks.
    error: (f64, u64),
}

impl ForceTarget {
    fn new(tick: i64, force: f64, gains: [f64; 3]) -> Self {
        Self {
            force,
            gains,
            since: tick,
            reached: false,
            matched: false,
            touched: false,
            within_since: None,
            recovered: false,
            error: (0.0, 0),
        }
    }

    /// Whether the axis had contact without recovery.
    fn is_unrecovered(&self) -> bool {
        self.force != 0.0 && self.touched && !self.recovered
    }

    /// Mean error of a segment that had the time to reach F_d and did not.
    fn missed_by(&self) -> Option<f64> {
        let (sum, count) = self.error;
        (self.force != 0.0 && !self.reached && count > 0).then(|| sum / count as f64)
    }
}

impl ForceSums {
    /// Adds the reference of a tick.
    pub(super) fn reference(&mut self, tick: i64, reference: &ReferenceSample) {
        self.rest_since = if reference.at_rest() { self.rest_since.or(Some(tick)) } else { None };
    }

    /// Adds a tick with state, reference and parameters.
    pub(super) fn tick(&mut self, tick: i64, state: &StateSample, reference: &ReferenceSample, set: &ParameterSample) {
        let rested = self.rest_since.is_some_and(|since| tick.abs_diff(since) >= SETTLING_TICKS);
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let gains = [set.stiffness[i], set.max_force[i], set.position_bound[i]];
            axis.set_target(tick, set.desired_force[i], gains);
            let conditions = TickConditions {
                tick,
                across: reference.moves_across(i),
                slides: state.speed_across(i) > SLIDING_M_PER_S,
                rested,
                resolution: set.force_resolution,
            };
            axis.add(conditions, state.force[i]);
        }
    }

    /// Ends all holds before an unknown tick.
    pub(super) fn gap(&mut self) {
        self.axes.iter_mut().for_each(ForceAxisSums::close_hold);
    }

    /// Ends all holds and restarts the targets: no force is commanded.
    pub(super) fn inactive(&mut self, tick: i64) {
        self.rest_since = None;
        for axis in &mut self.axes {
            axis.close_hold();
            axis.close_target();
            axis.target = axis.target.map(|target| ForceTarget::new(tick, target.force, target.gains));
        }
    }

    pub(super) fn summary(&self) -> ForceSummary {
        let axes = self.axes.map(|mut axis| {
            axis.close_hold();
            axis.close_target();
            axis.unrecovered += u64::from(axis.target.is_some_and(|target| target.is_unrecovered()));
            axis
        });
        let percent = |sum: Sum| sum.rms().map(|share| 100.0 * share);
        ForceSummary {
            desired_n: axes.map(|axis| axis.desired),
            settled_rms_n: axes.map(|axis| axis.settled.rms()),
            settled_rms_percent: axes.map(|axis| percent(axis.settled_relative)),
            settled_ticks: axes.map(|axis| axis.settled.count),
            holds: axes.map(|axis| axis.holds),
            worst_hold_rms_percent: axes.map(|axis| axis.worst_hold.map(|(share, _)| 100.0 * share)),
            worst_hold_desired_n: axes.map(|axis| axis.worst_hold.map(|(_, force)| force)),
            last_hold_rms_percent: axes.map(|axis| axis.last_hold.map(|share| 100.0 * share)),
            sliding_rms_percent: axes.map(|axis| percent(axis.sliding_relative)),
            sliding_ticks: axes.map(|axis| axis.sliding_relative.count),
            steady_sliding_rms_percent: axes.map(|axis| percent(axis.steady_sliding_relative)),
            steady_sliding_ticks: axes.map(|axis| axis.steady_sliding_relative.count),
            overshoot_n: axes.map(|axis| axis.overshoot),
            recoveries: axes.map(|axis| axis.recoveries),
            unrecovered: axes.map(|axis| axis.unrecovered),
            slowest_recovery_ticks: axes.map(|axis| axis.slowest),
            not_reached: axes.map(|axis| axis.not_reached),
            not_reached_error_n: axes.map(|axis| axis.not_reached_error),
        }
    }
}

/// Conditions of a tick for an axis.
#[derive(Clone, Copy)]
struct TickConditions {
    tick: i64,
    /// The reference moves across the axis.
    across: bool,
    /// The foot moves across the axis.
    slides: bool,
    rested: bool,
    resolution: f64,
}

impl ForceAxisSums {
    /// Updates the target if F_d or a gain changed.
    fn set_target(&mut self, tick: i64, force: f64, gains: [f64; 3]) {
        let new = ForceTarget::new(tick, force, gains);
        match self.target {
            None => self.target = Some(new),
            Some(old) if old.force != force || old.gains != gains => {
                self.unrecovered += u64::from(old.is_unrecovered());
                self.close_hold();
                self.close_target();
                self.target = Some(ForceTarget { matched: old.matched && old.force == force, ..new });
            }
            Some(_) => {}
        }
    }

    fn add(&mut self, conditions: TickConditions, measured: f64) {
        let Some(target) = &mut self.target else { return };
        let force = target.force;
        if force == 0.0 {
            return;
        }
        let error = measured - force;
        self.desired = Some(force);
        let within = error.abs() <= (REACHED_SHARE * force.abs()).max(conditions.resolution);
        target.touched |= measured.abs() > conditions.resolution;
        target.reached |= within;
        target.matched |= within;
        target.within_since = if within { target.within_since.or(Some(conditions.tick)) } else { None };
        if let Some(since) = target.within_since
            && !target.recovered
            && conditions.tick.abs_diff(since) >= RECOVERY_TICKS
        {
            target.recovered = true;
            self.recoveries += 1;
            self.slowest = self.slowest.max(Some(since.abs_diff(target.since)));
        }
        if target.matched {
            self.overshoot = Some(self.overshoot.unwrap_or(0.0).max(error * force.signum()));
        }
        let settled = conditions.tick.abs_diff(target.since) >= SETTLING_TICKS;
        if settled {
            // Clamped as in `Sum`.
            target.error = ((target.error.0 + error).clamp(-f64::MAX, f64::MAX), target.error.1 + 1);
        }
        let held = target.reached && settled;
        let slides = conditions.across && conditions.slides;
        self.sliding_since = if slides { self.sliding_since.or(Some(conditions.tick)) } else { None };
        if held && conditions.across {
            self.sliding_relative.add(error / force);
            if self.sliding_since.is_some_and(|since| conditions.tick.abs_diff(since) >= BREAKAWAY_TICKS) {
                self.steady_sliding_relative.add(error / force);
            }
        }
        if held && conditions.rested {
            self.settled.add(error);
            self.settled_relative.add(error / force);
            self.hold.add(error / force);
            self.hold_force = force;
        } else {
            self.close_hold();
        }
    }

    /// Counts the present segment if F_d was not reached in it. The caller replaces the target, or reads the sums.
    fn close_target(&mut self) {
        let Some(error) = self.target.and_then(|target| target.missed_by()) else { return };
        self.not_reached += 1;
        if self.not_reached_error.is_none_or(|worst| error.abs() > worst.abs()) {
            self.not_reached_error = Some(error);
        }
    }

    fn close_hold(&mut self) {
        let Some(share) = std::mem::take(&mut self.hold).rms() else { return };
        self.holds += 1;
        self.last_hold = Some(share);
        if self.worst_hold.is_none_or(|(worst, _)| share > worst) {
            self.worst_hold = Some((share, self.hold_force));
        }
    }
}
