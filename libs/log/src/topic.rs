//! Topics of a log.

use crate::proto::DESCRIPTORS;
use foxglove::Encode;
use foxglove::messages::{FrameTransforms, Log, SceneUpdate};
use std::borrow::Cow;

/// Topic of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// Measurements of the plant.
    State,
    /// Reference of the foot.
    Reference,
    /// Requests of the process in the controller slot.
    Request,
    /// Commands of the gate to the drive.
    Command,
    /// Parameter sets of the operator.
    Operator,
    /// Events.
    Event,
    /// Wall-clock timing of each process.
    Timing,
    /// Poses of the bodies, for viewers.
    Transforms,
    /// Shapes, contact forces and targets, for viewers.
    Scene,
    /// Events as lines of text, for viewers.
    Log,
    /// Requests of the process in the standby slot. It comes last: topics are numbered in this order, and logs older
    /// than the standby keep their numbers.
    StandbyRequest,
}

impl Topic {
    /// Number of topics.
    pub const COUNT: usize = 11;

    /// All topics.
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

    /// Name in the file.
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

    /// Full name of the message.
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

    /// Returns the topic with this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
    }

    /// Returns the first topic whose message has this full name: two topics may share a message.
    #[must_use]
    pub fn from_schema_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.schema_name() == name)
    }

    /// Returns the topic with this name and message, else the first with this message: other programs use other names.
    #[must_use]
    pub fn resolve(name: &str, schema: &str) -> Option<Self> {
        Self::from_name(name).filter(|topic| topic.schema_name() == schema).or_else(|| Self::from_schema_name(schema))
    }

    /// Index in [`Topic::ALL`].
    pub(crate) const fn index(self) -> usize {
        self as usize
    }

    /// Descriptor set of the message.
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
