//! F - F_d: how well it was held, and how soon it was back after a change.

use super::sample::{ParameterSample, ReferenceSample, StateSample};
use super::sum::Sum;
use super::summary::ForceSummary;

/// How long nothing must have changed before the force counts as settled, ticks.
const SETTLING: u64 = 500;
/// F_d counts as reached within this share of it.
const REACHED: f64 = 0.01;
/// F_d counts as recovered once it has been reached for so many ticks in a row.
const RECOVERED: u64 = 100;

/// Across its axis a foot faster than this has broken away from static friction, m/s.
const GLIDING_M_PER_S: f64 = 0.01;
/// How long it has to glide before what breaking away set off counts as over, ticks.
const BROKEN_AWAY: u64 = 50;

/// Sums of the three axes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Force {
    axes: [Axis; 3],
    /// Tick since which the reference has been at rest on all axes.
    rest_since: Option<i64>,
}

/// Sums of one axis.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    wish: Option<Wish>,
    desired: Option<f64>,
    settled: Sum,
    settled_relative: Sum,
    sliding_relative: Sum,
    gliding_relative: Sum,
    gliding_since: Option<i64>,
    /// The hold that goes on, if its count is not zero: a stretch of settled ticks with one wish.
    hold: Sum,
    hold_force: f64,
    holds: u64,
    last_hold: Option<f64>,
    /// Its error, and its F_d.
    worst_hold: Option<(f64, f64)>,
    overshoot: Option<f64>,
    recoveries: u64,
    unrecovered: u64,
    slowest: Option<u64>,
}

/// F_d on one axis, and the gains it is held with.
#[derive(Clone, Copy, Debug)]
struct Wish {
    force: f64,
    gains: [f64; 3],
    since: i64,
    /// Reached since `since`.
    reached: bool,
    /// Reached since F_d was set, perhaps with other gains.
    matched: bool,
    /// Whether the axis felt a contact.
    felt: bool,
    /// Tick since which it has been within reach.
    within_since: Option<i64>,
    recovered: bool,
}

impl Wish {
    fn new(tick: i64, force: f64, gains: [f64; 3]) -> Self {
        Self { force, gains, since: tick, reached: false, matched: false, felt: false, within_since: None, recovered: false }
    }

    /// Felt, but neither reached nor kept.
    fn is_missed(&self) -> bool {
        self.force != 0.0 && self.felt && !self.recovered
    }
}

impl Force {
    /// A reference of a tick.
    pub(super) fn reference(&mut self, tick: i64, reference: &ReferenceSample) {
        self.rest_since = if reference.at_rest() { self.rest_since.or(Some(tick)) } else { None };
    }

    /// A tick with all that it takes.
    pub(super) fn tick(&mut self, tick: i64, state: &StateSample, reference: &ReferenceSample, set: &ParameterSample) {
        let rested = self.rest_since.is_some_and(|since| tick.abs_diff(since) >= SETTLING);
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let gains = [set.stiffness[i], set.max_force[i], set.position_bound[i]];
            axis.wish(tick, set.desired_force[i], gains);
            let at = At {
                tick,
                across: reference.moves_across(i),
                gliding: state.speed_across(i) > GLIDING_M_PER_S,
                rested,
                resolution: set.force_resolution,
            };
            axis.feel(at, state.force[i]);
        }
    }

    /// A tick of which nothing is known: holds end before it.
    pub(super) fn gap(&mut self) {
        self.axes.iter_mut().for_each(Axis::close_hold);
    }

    /// No force is asked for: what was reached has to be reached anew.
    pub(super) fn inactive(&mut self, tick: i64) {
        self.rest_since = None;
        for axis in &mut self.axes {
            axis.close_hold();
            axis.wish = axis.wish.map(|wish| Wish::new(tick, wish.force, wish.gains));
        }
    }

    pub(super) fn summary(&self) -> ForceSummary {
        let axes = self.axes.map(|mut axis| {
            axis.close_hold();
            axis.unrecovered += u64::from(axis.wish.is_some_and(|wish| wish.is_missed()));
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
            gliding_rms_percent: axes.map(|axis| percent(axis.gliding_relative)),
            gliding_ticks: axes.map(|axis| axis.gliding_relative.count),
            overshoot_n: axes.map(|axis| axis.overshoot),
            recoveries: axes.map(|axis| axis.recoveries),
            unrecovered: axes.map(|axis| axis.unrecovered),
            slowest_recovery_ticks: axes.map(|axis| axis.slowest),
        }
    }
}

/// What an axis needs to know of a tick.
#[derive(Clone, Copy)]
struct At {
    tick: i64,
    /// The reference moves across the axis.
    across: bool,
    /// The foot does.
    gliding: bool,
    rested: bool,
    resolution: f64,
}

impl Axis {
    /// Takes note of what is wished now.
    fn wish(&mut self, tick: i64, force: f64, gains: [f64; 3]) {
        let new = Wish::new(tick, force, gains);
        match self.wish {
            None => self.wish = Some(new),
            Some(old) if old.force != force || old.gains != gains => {
                self.unrecovered += u64::from(old.is_missed());
                self.close_hold();
                self.wish = Some(Wish { matched: old.matched && old.force == force, ..new });
            }
            Some(_) => {}
        }
    }

    fn feel(&mut self, at: At, felt: f64) {
        let Some(wish) = &mut self.wish else { return };
        let force = wish.force;
        if force == 0.0 {
            return;
        }
        let error = felt - force;
        self.desired = Some(force);
        let within = error.abs() <= (REACHED * force.abs()).max(at.resolution);
        wish.felt |= felt.abs() > at.resolution;
        wish.reached |= within;
        wish.matched |= within;
        wish.within_since = if within { wish.within_since.or(Some(at.tick)) } else { None };
        if let Some(since) = wish.within_since
            && !wish.recovered
            && at.tick.abs_diff(since) >= RECOVERED
        {
            wish.recovered = true;
            self.recoveries += 1;
            self.slowest = self.slowest.max(Some(since.abs_diff(wish.since)));
        }
        if wish.matched {
            self.overshoot = Some(self.overshoot.unwrap_or(0.0).max(error * force.signum()));
        }
        let held = wish.reached && at.tick.abs_diff(wish.since) >= SETTLING;
        let glides = at.across && at.gliding;
        self.gliding_since = if glides { self.gliding_since.or(Some(at.tick)) } else { None };
        if held && at.across {
            self.sliding_relative.add(error / force);
            if self.gliding_since.is_some_and(|since| at.tick.abs_diff(since) >= BROKEN_AWAY) {
                self.gliding_relative.add(error / force);
            }
        }
        if held && at.rested {
            self.settled.add(error);
            self.settled_relative.add(error / force);
            self.hold.add(error / force);
            self.hold_force = force;
        } else {
            self.close_hold();
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
