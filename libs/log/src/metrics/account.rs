//! Sums over ticks, which arrive in order.

use super::contacts::ContactSums;
use super::force::ForceSums;
use super::force_command::ForceCommandSums;
use super::integration::IntegrationSums;
use super::moments::{IntegrationSummary, MomentsSummary};
use super::objects::ObjectMotions;
use super::posture::{AirSums, JointSums};
use super::sample::{CommandSample, ParameterSample, StateSample};
use super::summary::{ForceCommandSummary, ForceSummary, TickSummary, TrackingSummary};
use super::tracking::TrackingSums;
use super::window::{TickSamples, WINDOW};

/// Most parameter sets in memory: ticks are summed up to [`WINDOW`] ticks late, and sets are at least 5 ticks apart.
const MAX_SETS: usize = WINDOW as usize / 5 + 8;

/// Sums over the ticks that have left the window.
#[derive(Clone, Debug, Default)]
pub(super) struct MetricSums {
    /// The set in force and the later sets, by effective tick and version.
    sets: Vec<ParameterSample>,
    tracking: TrackingSums,
    force: ForceSums,
    force_command: ForceCommandSums,
    objects: ObjectMotions,
    contacts: ContactSums,
    joints: JointSums,
    air: AirSums,
    integration: IntegrationSums,
    was_active: bool,
    missed: u64,
    braked: u64,
    first: Option<i64>,
    last: Option<i64>,
    states: u64,
    /// Commands since the first state.
    commands: u64,
    last_command: Option<i64>,
}

impl MetricSums {
    /// Adds a parameter set, in force from its effective tick on.
    pub(super) fn add_set(&mut self, set: ParameterSample) {
        let key = |set: &ParameterSample| (set.effective_tick, set.version);
        let index = self.sets.partition_point(|other| key(other) <= key(&set));
        self.sets.insert(index, set);
        if self.sets.len() > MAX_SETS {
            self.sets.remove(0);
        }
    }

    /// Adds the next tick.
    pub(super) fn tick(&mut self, slot: &TickSamples) {
        let set = self.in_force(slot.tick);
        if let Some(reference) = &slot.reference {
            self.force.reference(slot.tick, reference);
        }
        if let Some(state) = &slot.state {
            self.states += 1;
            self.first.get_or_insert(slot.tick);
            self.last = Some(slot.tick);
            self.on_state(state, slot.command.as_ref(), set.as_ref());
        }
        if let (Some(state), Some(reference)) = (&slot.state, &slot.reference) {
            self.tracking.tick(state, reference, slot.command.as_ref(), set.as_ref());
            match &set {
                Some(set) => self.force.tick(slot.tick, state, reference, set),
                None => self.force.gap(),
            }
        } else {
            self.force.gap();
        }
        if let Some(command) = &slot.command {
            self.on_command(slot.tick, command, set.as_ref());
        }
    }

    fn in_force(&mut self, tick: i64) -> Option<ParameterSample> {
        let begun = self.sets.partition_point(|set| set.effective_tick <= tick);
        self.sets.drain(..begun.saturating_sub(1));
        self.sets.first().filter(|_| begun > 0).copied()
    }

    /// Updates the metrics of the scene.
    fn on_state(&mut self, state: &StateSample, command: Option<&CommandSample>, set: Option<&ParameterSample>) {
        let resolution = set.map_or(0.0, |set| set.force_resolution);
        let foot_free = state.force.iter().all(|force| force.abs() <= resolution);
        self.objects.tick(&state.objects);
        self.contacts.tick(&state.contacts, foot_free);
        self.joints.tick(&state.joints);
        self.integration.tick(state.physics.as_ref(), !state.contacts.is_empty());
        if let (true, Some(command), Some(set)) = (foot_free, command.filter(|command| command.active), set) {
            self.air.tick(command, set);
        }
    }

    fn on_command(&mut self, tick: i64, command: &CommandSample, set: Option<&ParameterSample>) {
        if self.first.is_some() {
            self.commands += 1;
            self.last_command = Some(tick);
        }
        self.was_active |= command.active;
        self.missed += u64::from(self.was_active && command.missed);
        self.braked += u64::from(self.was_active && !command.active);
        if !command.active {
            self.force.inactive(tick);
        }
        // In the other modes the command repeats an older request, and its force does not act.
        if let (true, Some(set)) = (command.active, set) {
            self.force_command.tick(command, set);
        }
    }

    pub(super) fn tracking(&self) -> TrackingSummary {
        self.tracking.summary()
    }

    pub(super) fn force(&self) -> ForceSummary {
        self.force.summary()
    }

    pub(super) fn force_command(&self) -> ForceCommandSummary {
        self.force_command.summary()
    }

    pub(super) fn moments(&self) -> MomentsSummary {
        MomentsSummary {
            objects: self.objects.summary(),
            contacts: self.contacts.summary(),
            joints: self.joints.summary(),
            air: self.air.summary(),
        }
    }

    pub(super) fn integration(&self) -> IntegrationSummary {
        self.integration.summary()
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
