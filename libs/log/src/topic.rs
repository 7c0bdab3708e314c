//! The topics of a log.

use crate::proto::DESCRIPTORS;
use foxglove::Encode;
use foxglove::messages::{FrameTransforms, Log, SceneUpdate};
use std::borrow::Cow;

/// A topic of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// What the plant measured.
    State,
    /// Where the foot should be.
    Reference,
    /// What the process in the controller's place asked for.
    Request,
    /// What the gate passed to the drive.
    Command,
    /// What the operator set.
    Operator,
    /// What happened.
    Event,
    /// What each process did by the wall clock.
    Timing,
    /// Poses of the bodies, for viewers.
    Transforms,
    /// Shapes, contact forces and targets, for viewers.
    Scene,
    /// Events as lines of text, for viewers.
    Log,
    /// What the process in the standby's place asked for. The last one: topics are numbered in this order, and a log that was
    /// written before there was a standby keeps its numbers.
    StandbyRequest,
}

impl Topic {
    /// How many there are.
    pub const COUNT: usize = 11;

    /// Every topic.
    pub const ALL: [Self; Self::COUNT] = [
        Self::State,
        Self::Reference,
        Self::Request,
        Self::Command,
        Self::Operator,
        Self::Event,
        Self::Timing,
        Self::Transforms,
        Self::Scene,
        Self::Log,
        Self::StandbyRequest,
    ];

    /// Its name in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::State => "/state",
            Self::Reference => "/reference",
            Self::Request => "/request",
            Self::Command => "/command",
            Self::Operator => "/operator",
            Self::Event => "/event",
            Self::Timing => "/timing",
            Self::Transforms => "/tf",
            Self::Scene => "/scene",
            Self::Log => "/log",
            Self::StandbyRequest => "/request/standby",
        }
    }

    /// Full name of its message.
    #[must_use]
    pub const fn schema_name(self) -> &'static str {
        match self {
            Self::State => "hapfic.State",
            Self::Reference => "hapfic.Reference",
            Self::Request | Self::StandbyRequest => "hapfic.Request",
            Self::Command => "hapfic.Command",
            Self::Operator => "hapfic.Operator",
            Self::Event => "hapfic.Event",
            Self::Timing => "hapfic.Timing",
            Self::Transforms => "foxglove.FrameTransforms",
            Self::Scene => "foxglove.SceneUpdate",
            Self::Log => "foxglove.Log",
        }
    }

    /// The topic of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
    }

    /// The first topic whose message has this full name: two topics may share a message.
    #[must_use]
    pub fn from_schema_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.schema_name() == name)
    }

    /// The topic of this name if its message is this one, else the first with this message: other programs name theirs as they like.
    #[must_use]
    pub fn resolve(name: &str, schema: &str) -> Option<Self> {
        Self::from_name(name).filter(|topic| topic.schema_name() == schema).or_else(|| Self::from_schema_name(schema))
    }

    /// Its place in [`Topic::ALL`].
    pub(crate) const fn index(self) -> usize {
        self as usize
    }

    /// Descriptor set of its message.
    #[must_use]
    pub fn schema(self) -> Cow<'static, [u8]> {
        let schema = match self {
            Self::Transforms => FrameTransforms::get_schema(),
            Self::Scene => SceneUpdate::get_schema(),
            Self::Log => Log::get_schema(),
            _ => return Cow::Borrowed(DESCRIPTORS),
        };
        schema.map(|schema| schema.data).unwrap_or_default()
    }
}
