//! Metrics of a run, in one pass and bounded memory.
//!
//! A recorder feeds [`Metrics`] live, a report from a log. Both get the same metrics: the messages of one tick are
//! collected first, in any order of the topics, as long as these are at most [`WINDOW`] ticks apart.

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

/// Summarizes a run during the run.
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
    /// Metrics without a message.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a message of a log. Messages without a metric are ignored.
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

    /// Adds a message of `/state`.
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

    /// Adds a message of `/reference`.
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

    /// Adds a message of `/command`.
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

    /// Adds a message of `/operator`. It must arrive before its effective tick leaves the window.
    pub fn push_operator(&mut self, message: &proto::Operator) {
        match ParameterSample::new(message) {
            Some(sample) => self.account.add_set(sample),
            None => self.invalid += 1,
        }
    }

    /// Adds a message of `/timing`.
    pub fn push_timing(&mut self, message: &proto::Timing) {
        self.allocations = self.allocations.saturating_add(u64::from(message.allocations));
        if message.process == Process::Supervisor.name() && message.publish_ns != 0 && message.latency_ns != 0 {
            self.latency.record(message.latency_ns);
        }
    }

    /// Returns the metrics of all messages so far.
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
