//! Sums over ticks, which come in order.

use super::sample::{CommandSample, ParameterSample, ReferenceSample, StateSample};
use super::summary::{ForceCommandSummary, ForceSummary, TickSummary, TrackingSummary};
use super::window::Slot;

/// How long nothing must have changed before the force counts as settled, ticks.
const SETTLING: u64 = 500;
/// F_d counts as reached within this share of it.
const REACHED: f64 = 0.01;
/// Most parameter sets kept; the operator announces one at a time.
const MOST_SETS: usize = 64;

/// Sums over the ticks that have left the window.
#[derive(Clone, Debug, Default)]
pub(super) struct Account {
    /// The set in force and those to come, by effective tick and version.
    sets: Vec<ParameterSample>,
    axes: [Axis; 3],
    outside: u64,
    above_limit: u64,
    /// Tick since which the reference has been at rest on all axes.
    rest_since: Option<i64>,
    was_active: bool,
    missed: u64,
    braked: u64,
    first: Option<i64>,
    last: Option<i64>,
    states: u64,
    /// Commands since the first state, and the last of them.
    commands: u64,
    last_command: Option<i64>,
}

/// Sums of one axis.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    error: Sum,
    bound: f64,
    wish: Option<Wish>,
    desired: Option<f64>,
    settled: Sum,
    settled_relative: Sum,
    sliding_relative: Sum,
    command: f64,
    limit: f64,
    ratio: f64,
}

/// F_d on one axis.
#[derive(Clone, Copy, Debug)]
struct Wish {
    force: f64,
    since: i64,
    reached: bool,
}

/// Sum of squares.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    squares: f64,
    largest: f64,
    count: u64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        self.squares += value * value;
        self.largest = self.largest.max(value.abs());
        self.count += 1;
    }

    /// Root of the mean square.
    fn rms(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.squares / self.count as f64).sqrt())
    }
}

impl Account {
    /// A parameter set, in force from its effective tick on.
    pub(super) fn announce(&mut self, set: ParameterSample) {
        let key = |set: &ParameterSample| (set.effective_tick, set.version);
        let place = self.sets.partition_point(|other| key(other) <= key(&set));
        self.sets.insert(place, set);
        if self.sets.len() > MOST_SETS {
            self.sets.remove(0);
        }
    }

    /// The next tick.
    pub(super) fn tick(&mut self, slot: &Slot) {
        let set = self.in_force(slot.tick);
        if let Some(reference) = &slot.reference {
            self.rest_since = if reference.at_rest { self.rest_since.or(Some(slot.tick)) } else { None };
        }
        if slot.state.is_some() {
            self.states += 1;
            self.first.get_or_insert(slot.tick);
            self.last = Some(slot.tick);
        }
        if let (Some(state), Some(reference)) = (&slot.state, &slot.reference) {
            self.track(state, reference, set.as_ref());
            if let Some(set) = &set {
                self.feel(slot.tick, state, reference, set);
            }
        }
        if let Some(command) = &slot.command {
            self.obey(slot.tick, command, set.as_ref());
        }
    }

    fn in_force(&mut self, tick: i64) -> Option<ParameterSample> {
        let begun = self.sets.partition_point(|set| set.effective_tick <= tick);
        self.sets.drain(..begun.saturating_sub(1));
        self.sets.first().filter(|_| begun > 0).copied()
    }

    fn track(&mut self, state: &StateSample, reference: &ReferenceSample, set: Option<&ParameterSample>) {
        let mut outside = false;
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let error = state.position[i] - reference.position[i];
            axis.error.add(error);
            if let Some(set) = set {
                axis.bound = axis.bound.max(set.position_bound[i]);
                outside |= error.abs() > set.position_bound[i];
            }
        }
        self.outside += u64::from(outside);
    }

    fn feel(&mut self, tick: i64, state: &StateSample, reference: &ReferenceSample, set: &ParameterSample) {
        let rest_since = self.rest_since;
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let force = set.desired_force[i];
            let error = state.force[i] - force;
            let new = Wish { force, since: tick, reached: false };
            let wish = axis.wish.get_or_insert(new);
            if wish.force != force {
                *wish = new;
            }
            if force == 0.0 {
                continue;
            }
            axis.desired = Some(force);
            wish.reached |= error.abs() <= (REACHED * force.abs()).max(set.force_resolution);
            if !wish.reached || tick.abs_diff(wish.since) < SETTLING {
                continue;
            }
            if !reference.at_rest {
                axis.sliding_relative.add(error / force);
            } else if rest_since.is_some_and(|since| tick.abs_diff(since) >= SETTLING) {
                axis.settled.add(error);
                axis.settled_relative.add(error / force);
            }
        }
    }

    fn obey(&mut self, tick: i64, command: &CommandSample, set: Option<&ParameterSample>) {
        if self.first.is_some() {
            self.commands += 1;
            self.last_command = Some(tick);
        }
        self.was_active |= command.active;
        self.missed += u64::from(self.was_active && command.missed);
        self.braked += u64::from(self.was_active && !command.active);
        if !command.active {
            // No force is asked for: what was reached has to be reached anew.
            self.rest_since = None;
            for wish in self.axes.iter_mut().filter_map(|axis| axis.wish.as_mut()) {
                *wish = Wish { since: tick, reached: false, ..*wish };
            }
        }
        // In the other modes the content is that of an older request, and no force stands behind it.
        let (true, Some(set)) = (command.active, set) else { return };
        let mut above = false;
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let force = command.force[i].abs();
            let limit = set.max_force[i];
            axis.command = axis.command.max(force);
            axis.limit = axis.limit.max(limit);
            above |= force > limit;
            if limit > 0.0 {
                axis.ratio = axis.ratio.max(force / limit);
            }
        }
        self.above_limit += u64::from(above);
    }

    pub(super) fn tracking(&self) -> TrackingSummary {
        TrackingSummary {
            max_m: self.axes.map(|axis| axis.error.largest),
            rms_m: self.axes.map(|axis| axis.error.rms().unwrap_or(0.0)),
            bound_m: self.axes.map(|axis| axis.bound),
            outside_ticks: self.outside,
        }
    }

    pub(super) fn force(&self) -> ForceSummary {
        let percent = |sum: Sum| sum.rms().map(|share| 100.0 * share);
        ForceSummary {
            desired_n: self.axes.map(|axis| axis.desired),
            settled_rms_n: self.axes.map(|axis| axis.settled.rms()),
            settled_rms_percent: self.axes.map(|axis| percent(axis.settled_relative)),
            settled_ticks: self.axes.map(|axis| axis.settled.count),
            sliding_rms_percent: self.axes.map(|axis| percent(axis.sliding_relative)),
            sliding_ticks: self.axes.map(|axis| axis.sliding_relative.count),
        }
    }

    pub(super) fn force_command(&self) -> ForceCommandSummary {
        ForceCommandSummary {
            max_n: self.axes.map(|axis| axis.command),
            limit_n: self.axes.map(|axis| axis.limit),
            max_ratio: self.axes.map(|axis| axis.ratio),
            above_limit_ticks: self.above_limit,
        }
    }

    pub(super) fn missed(&self) -> u64 {
        self.missed
    }

    pub(super) fn braked(&self) -> u64 {
        self.braked
    }

    pub(super) fn ticks(&self, invalid: u64) -> TickSummary {
        let span = self.first.zip(self.last).map_or(0, |(first, last)| last.abs_diff(first));
        let missing_states = if self.states == 0 { 0 } else { span.saturating_add(1).saturating_sub(self.states) };
        let answered = self.first.zip(self.last_command).map_or(0, |(first, last)| last.abs_diff(first).saturating_add(1));
        let missing_commands = answered.saturating_sub(self.commands);
        TickSummary {
            first: self.first,
            last: self.last,
            missing_states,
            missing_commands,
            lost: missing_states.saturating_add(missing_commands),
            invalid,
        }
    }
}
