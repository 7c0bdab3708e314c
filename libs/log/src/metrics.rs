//! A run in figures, in one pass and bounded memory.
//!
//! A recorder feeds [`Metrics`] live, a report from a log; both get the same figures, since what belongs to one tick is
//! put together first, in whatever order the topics came, as long as they are no more than [`WINDOW`] ticks apart.

mod account;
mod contacts;
mod force;
mod force_command;
mod integration;
mod label;
mod latency;
mod moments;
mod objects;
mod posture;
mod sample;
mod sum;
mod summary;
mod tracking;
mod window;

pub use label::{Label, List};
pub use latency::Latencies;
pub use moments::{AirSummary, IntegrationSummary, JointSummary, MAX_PAIRS, MomentsSummary, ObjectSummary, PairSummary};
pub use objects::angle_between;
pub use summary::{
    ForceCommandSummary, ForceSummary, MetricsSummary, OutsideSummary, Quantiles, TickSummary, TimingSummary, TrackingSummary,
};
pub use window::WINDOW;

use crate::proto;
use crate::reader::Record;
use account::Account;
use hapfic_messages::Process;
use sample::{CommandSample, ParameterSample, ReferenceSample, StateSample};
use window::Window;

/// Sums up a run while it goes on.
#[derive(Clone, Debug, Default)]
pub struct Metrics {
    window: Window,
    account: Account,
    latency: Latencies,
    wake_lateness: Latencies,
    slipped: u64,
    allocations: u64,
    invalid: u64,
}

impl Metrics {
    /// Nothing seen yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes a message of a log; those that carry no figure are ignored.
    pub fn push(&mut self, record: &Record) {
        match record {
            Record::State(message) => self.push_state(message),
            Record::Reference(message) => self.push_reference(message),
            Record::Command(message) => self.push_command(message),
            Record::Operator(message) => self.push_operator(message),
            Record::Timing(message) => self.push_timing(message),
            Record::Request(_) | Record::Event(_) | Record::Other { .. } => {}
        }
    }

    /// Takes a message of `/state`.
    pub fn push_state(&mut self, message: &proto::State) {
        let Some(sample) = StateSample::new(message) else {
            self.invalid += 1;
            return;
        };
        let account = &mut self.account;
        if let Some(slot) = self.window.slot(message.tick, |slot| account.tick(&slot))
            && slot.state.is_none()
        {
            slot.state = Some(sample);
            self.wake_lateness.record(message.wake_lateness_ns);
            self.slipped = self.slipped.max(message.slipped);
        }
    }

    /// Takes a message of `/reference`.
    pub fn push_reference(&mut self, message: &proto::Reference) {
        let Some(sample) = ReferenceSample::new(message) else {
            self.invalid += 1;
            return;
        };
        let account = &mut self.account;
        if let Some(slot) = self.window.slot(message.tick, |slot| account.tick(&slot)) {
            slot.reference.get_or_insert(sample);
        }
    }

    /// Takes a message of `/command`.
    pub fn push_command(&mut self, message: &proto::Command) {
        let Some(sample) = CommandSample::new(message) else {
            self.invalid += 1;
            return;
        };
        let account = &mut self.account;
        if let Some(slot) = self.window.slot(message.tick, |slot| account.tick(&slot)) {
            slot.command.get_or_insert(sample);
        }
    }

    /// Takes a message of `/operator`. It counts from its effective tick on, if it comes before that tick leaves the window.
    pub fn push_operator(&mut self, message: &proto::Operator) {
        match ParameterSample::new(message) {
            Some(sample) => self.account.announce(sample),
            None => self.invalid += 1,
        }
    }

    /// Takes a message of `/timing`.
    pub fn push_timing(&mut self, message: &proto::Timing) {
        self.allocations = self.allocations.saturating_add(u64::from(message.allocations));
        if message.process == Process::Supervisor.name() && message.publish_ns != 0 && message.latency_ns != 0 {
            self.latency.record(message.latency_ns);
        }
    }

    /// The figures so far, with all that has come.
    #[must_use]
    pub fn summary(&self) -> MetricsSummary {
        let mut account = self.account.clone();
        self.window.clone().drain(|slot| account.tick(&slot));
        MetricsSummary {
            tracking: account.tracking(),
            force: account.force(),
            force_command: account.force_command(),
            moments: account.moments(),
            integration: account.integration(),
            timing: TimingSummary {
                latency_us: self.latency.quantiles_us(),
                late_ticks: self.slipped,
                missed_ticks: account.missed(),
                brake_ticks: account.braked(),
                wake_lateness_us: self.wake_lateness.quantiles_us(),
                allocations: self.allocations,
            },
            ticks: account.ticks(self.invalid),
        }
    }
}
