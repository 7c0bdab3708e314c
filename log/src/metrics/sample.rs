//! What the metrics keep of a message, checked.

use crate::proto;
use hapfic_ipc::message::{Mode, Source};

/// A damaged or foreign log may hold anything; no length, speed or force of a run comes near.
const LARGEST: f64 = 1e12;

/// Of a state.
#[derive(Clone, Copy, Debug)]
pub(super) struct StateSample {
    pub(super) position: [f64; 3],
    pub(super) force: [f64; 3],
}

impl StateSample {
    /// `None` if a vector has not 3 finite elements; so for all samples.
    pub(super) fn new(message: &proto::State) -> Option<Self> {
        Some(Self { position: vector(&message.foot_position)?, force: vector(&message.foot_force)? })
    }
}

/// Of a reference.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReferenceSample {
    pub(super) position: [f64; 3],
    pub(super) at_rest: bool,
}

impl ReferenceSample {
    pub(super) fn new(message: &proto::Reference) -> Option<Self> {
        let velocity = vector(&message.velocity)?;
        // Exactly: the planner's arcs end at rest in closed form.
        Some(Self { position: vector(&message.position)?, at_rest: velocity.iter().all(|v| *v == 0.0) })
    }
}

/// Of a command.
#[derive(Clone, Copy, Debug)]
pub(super) struct CommandSample {
    pub(super) force: [f64; 3],
    pub(super) active: bool,
    /// No valid request of its tick stands behind it.
    pub(super) missed: bool,
}

impl CommandSample {
    pub(super) fn new(message: &proto::Command) -> Option<Self> {
        Some(Self {
            force: vector(&message.force)?,
            active: message.mode == Mode::Active.name(),
            missed: ![Source::Fresh, Source::Withheld].iter().any(|s| message.source == s.name()),
        })
    }
}

/// Of a parameter set.
#[derive(Clone, Copy, Debug)]
pub(super) struct ParameterSample {
    pub(super) version: u64,
    pub(super) effective_tick: i64,
    pub(super) desired_force: [f64; 3],
    pub(super) max_force: [f64; 3],
    pub(super) position_bound: [f64; 3],
    pub(super) force_resolution: f64,
}

impl ParameterSample {
    pub(super) fn new(message: &proto::Operator) -> Option<Self> {
        Some(Self {
            version: message.version,
            effective_tick: message.effective_tick,
            desired_force: vector(&message.desired_force)?,
            max_force: vector(&message.max_force)?,
            position_bound: vector(&message.position_bound)?,
            force_resolution: believable(message.force_resolution).then_some(message.force_resolution)?,
        })
    }
}

fn vector(values: &[f64]) -> Option<[f64; 3]> {
    let vector: [f64; 3] = values.try_into().ok()?;
    vector.into_iter().all(believable).then_some(vector)
}

fn believable(value: f64) -> bool {
    value.abs() < LARGEST
}
