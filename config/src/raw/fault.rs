//! Injected faults as written.

use crate::fault::{FaultKind, FaultTarget};
use schemars::JsonSchema;
use serde::de::value::StrDeserializer;
use serde::de::{Error, IntoDeserializer, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;
use std::slice;

/// An injected fault, at one time or at several random times.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawFault {
    /// Kind of fault.
    pub(crate) kind: FaultKind,

    /// Target: a process, or a list from which each fault samples one; `controllers` are both together. Not for hog and
    /// full_disk, whose target is the machine; supervisor, gates and recorder can only be killed or halted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawTargets")]
    pub(crate) process: Option<RawTargets>,

    /// Time at which the fault begins, since the start [s], in [0, 86400], before the run's end. Excludes `random`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    pub(crate) at_s: Option<f64>,

    /// Length [ms], an integer in [1, 600000]; default 1. For drop, repeat, corrupt, nan and stale it is the number of ticks;
    /// kill, full_disk and memory_lock have none. Raising it makes the fault harder to tolerate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32")]
    pub(crate) for_ms: Option<u32>,

    /// Delay of each tick [us], an integer in [1, 100000]; for slow, which requires it. Raising it makes requests late, and
    /// useless beyond the deadline.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32")]
    pub(crate) by_us: Option<u32>,

    /// Random times, sampled with the scenario's seed. Excludes `at_s`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawRandom")]
    pub(crate) random: Option<RawRandom>,
}

/// Random times, sampled with the scenario's seed. All ticks from `from_s` to before `to_s` are equally likely.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawRandom {
    /// Number of faults, an integer in [1, 100000]. Raising it makes faults more frequent; several may fall on one tick.
    pub(crate) count: u32,

    /// Earliest time since the start [s], in [0, 86400]. Raising it leaves the start undisturbed.
    pub(crate) from_s: f64,

    /// End of the times since the start [s], in [0, 86400], at most the run's end. Raising it spreads the faults further.
    pub(crate) to_s: f64,
}

/// A process, or a list from which each fault samples one.
#[derive(Clone, Debug, JsonSchema, Serialize)]
#[serde(untagged)]
pub(crate) enum RawTargets {
    /// The same process each time.
    One(FaultTarget),
    /// A random one of these each time.
    Sampled(Vec<FaultTarget>),
}

impl RawTargets {
    pub(crate) fn as_slice(&self) -> &[FaultTarget] {
        match self {
            Self::One(target) => slice::from_ref(target),
            Self::Sampled(targets) => targets,
        }
    }
}

// By hand: the derived code of an untagged enum loses the invalid word.
impl<'de> Deserialize<'de> for RawTargets {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(TargetsVisitor)
    }
}

struct TargetsVisitor;

impl<'de> Visitor<'de> for TargetsVisitor {
    type Value = RawTargets;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a process, or a list of processes")
    }

    fn visit_str<E: Error>(self, word: &str) -> Result<RawTargets, E> {
        let word: StrDeserializer<'_, E> = word.into_deserializer();
        FaultTarget::deserialize(word).map(RawTargets::One)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<RawTargets, A::Error> {
        let mut targets = Vec::new();
        while let Some(target) = items.next_element()? {
            targets.push(target);
        }
        Ok(RawTargets::Sampled(targets))
    }
}
