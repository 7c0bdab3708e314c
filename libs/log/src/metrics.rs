//! Metrics of a run, in one pass and bounded memory.
//!
//! The recorder feeds [`Metrics`] during the run, the report from a log. Both get the same metrics: [`Metrics`] first
//! collects the messages of a tick, in any order of the topics. Topics may be at most [`WINDOW`] ticks apart.

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

pub use label::{FixedList, Label};
pub use latency::Latencies;
pub use moments::{AirSummary, IntegrationSummary, JointSummary, MAX_PAIRS, MomentsSummary, ObjectSummary, PairSummary};
pub use objects::angle_between;
pub use summary::{
    ForceCommandSummary, ForceSummary, MetricsSummary, OrientationSummary, OutsideSummary, Quantiles, TickSummary, TimingSummary,
    TrackingSummary,
};
pub use window::WINDOW;

use crate::proto;
use crate::reader::Record;
use account::MetricSums;
use hapfic_messages::Process;
use sample::{CommandSample, ParameterSample, ReferenceSample, StateSample};
use window::Window;

/// Summarizes a run during the run.
#[derive(Clone, Debug, Default)]
pub struct Metrics {
    window: Window,
    sums: MetricSums,
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
        let sums = &mut self.sums;
        if let Some(slot) = self.window.slot(message.tick, |slot| sums.tick(&slot))
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
        let sums = &mut self.sums;
        if let Some(slot) = self.window.slot(message.tick, |slot| sums.tick(&slot)) {
            slot.reference.get_or_insert(sample);
        }
    }

    /// Adds a message of `/command`.
    pub fn push_command(&mut self, message: &proto::Command) {
        let Some(sample) = CommandSample::new(message) else {
            self.invalid += 1;
            return;
        };
        let sums = &mut self.sums;
        if let Some(slot) = self.window.slot(message.tick, |slot| sums.tick(&slot)) {
            slot.command.get_or_insert(sample);
        }
    }

    /// Adds a message of `/operator`. It must arrive before its effective tick leaves the window.
    pub fn push_operator(&mut self, message: &proto::Operator) {
        match ParameterSample::new(message) {
            Some(sample) => self.sums.add_set(sample),
            None => self.invalid += 1,
        }
    }

    /// Adds a message of `/timing`.
    pub fn push_timing(&mut self, message: &proto::Timing) {
        self.allocations = self.allocations.saturating_add(u64::from(message.allocations));
        if is_gate(&message.process) && message.publish_ns != 0 && message.latency_ns != 0 {
            self.latency.record(message.latency_ns);
        }
    }

    /// Returns the metrics of all messages so far.
    #[must_use]
    pub fn summary(&self) -> MetricsSummary {
        let mut sums = self.sums.clone();
        self.window.clone().drain(|slot| sums.tick(&slot));
        MetricsSummary {
            tracking: sums.tracking(),
            force: sums.force(),
            force_command: sums.force_command(),
            moments: sums.moments(),
            integration: sums.integration(),
            timing: TimingSummary {
                latency_us: self.latency.quantiles_us(),
                late_ticks: self.slipped,
                missed_ticks: sums.missed(),
                brake_ticks: sums.braked(),
                wake_lateness_us: self.wake_lateness.quantiles_us(),
                allocations: self.allocations,
            },
            ticks: sums.ticks(self.invalid),
        }
    }
}

/// Whether a timing message is the gate's. In older logs the gate was a thread of the supervisor.
fn is_gate(process: &str) -> bool {
    [Process::Gate, Process::Supervisor].iter().any(|gate| process == gate.name())
}
