//! Fixed capacities of the messages.

/// Most joints a robot may have.
pub const MAX_JOINTS: usize = 16;
/// Most limbs a message may hold. The arrays of a message hold one limb; its count is there for those that follow.
pub const MAX_LIMBS: usize = 1;
/// Most free bodies a world may have.
pub const MAX_OBJECTS: usize = 4;
/// Most contacts a [`State`](crate::State) reports.
pub const MAX_CONTACTS: usize = 8;
/// Most bytes of text in an [`Event`](crate::Event).
pub const EVENT_TEXT: usize = 192;

/// Control period T [ns].
pub const PERIOD_NS: u64 = 1_000_000;
/// Messages that a control input and a [`TickBuffer`](crate::TickBuffer) keep: more than a topic's history.
pub const CONTROL_DEPTH: usize = 8;
