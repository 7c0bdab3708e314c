//! Faults on purpose as written.

use crate::fault::{FaultKind, FaultTarget};
use schemars::JsonSchema;
use serde::de::value::StrDeserializer;
use serde::de::{Error, IntoDeserializer, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;
use std::slice;

/// A fault on purpose, at one moment or at several that are drawn.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawFault {
    /// What happens.
    pub(crate) kind: FaultKind,

    /// What it happens to: a process, or a list of which one is drawn each time; `controllers` are both at once. Not for hog
    /// and full_disk, which happen to the machine; `supervisor` can only be killed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawTargets")]
    pub(crate) process: Option<RawTargets>,

    /// When it begins, s since the start, in [0, 86400], before the run's end. Either this or `random` is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    pub(crate) at_s: Option<f64>,

    /// How long it lasts, ms, an integer in [1, 600000]; without it 1. For drop, repeat, corrupt, nan and stale that is the
    /// number of ticks; kill, full_disk and memory_lock take none. Raising it makes the fault harder to ride out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32")]
    pub(crate) for_ms: Option<u32>,

    /// By how much each tick is slowed, us, an integer in [1, 100000]; for slow, and needed there. Raising it makes requests
    /// late, beyond the deadline of no use.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32")]
    pub(crate) by_us: Option<u32>,

    /// Moments that are drawn with the scenario's seed. Either this or `at_s` is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawRandom")]
    pub(crate) random: Option<RawRandom>,
}

/// Moments that are drawn with the scenario's seed, each tick from `from_s` to before `to_s` as likely as any other.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawRandom {
    /// How many, an integer in [1, 100000]. Raising it makes faults more frequent; several may fall on one tick.
    pub(crate) count: u32,

    /// The first moment that may be drawn, s since the start, in [0, 86400]. Raising it leaves the start undisturbed.
    pub(crate) from_s: f64,

    /// The end of the moments that may be drawn, s since the start, in [0, 86400], at most the run's end. Raising it spreads
    /// the faults further.
    pub(crate) to_s: f64,
}

/// A process, or a list of which one is drawn each time.
#[derive(Clone, Debug, JsonSchema, Serialize)]
#[serde(untagged)]
pub(crate) enum RawTargets {
    /// Always this one.
    One(FaultTarget),
    /// One of these each time.
    Drawn(Vec<FaultTarget>),
}

impl RawTargets {
    pub(crate) fn as_slice(&self) -> &[FaultTarget] {
        match self {
            Self::One(target) => slice::from_ref(target),
            Self::Drawn(targets) => targets,
        }
    }
}

// By hand: what serde derives for an untagged enum forgets which word was wrong.
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
        Ok(RawTargets::Drawn(targets))
    }
}
