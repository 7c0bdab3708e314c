//! Layouts of the messages and meanings of the codes, as data: for programs in other languages.
//!
//! They come from the declarations themselves, so they cannot differ from what the Rust code reads and writes.

use crate::{
    Command, Credit, Detector, Drive, Event, EventKind, Injection, Message, MessageFault, Mode, Operator, OperatorKind,
    OperatorReply, OperatorRequest, Phase, Process, Reference, ReplyCode, Request, ResetPolicy, Saturation, Search, Severity,
    Source, State, Task, TaskCondition, Timing,
};

/// Layout of a type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Unsigned integer of as many bytes.
    Unsigned(usize),
    /// Signed integer of as many bytes, in two's complement.
    Signed(usize),
    /// IEEE 754 number of 8 bytes.
    Float,
    /// As many in a row, without gaps.
    Array(&'static Self, usize),
    /// A structure.
    Struct(&'static StructLayout),
}

/// Layout of a structure: C's, without padding.
#[derive(Debug, PartialEq, Eq)]
pub struct StructLayout {
    /// Name.
    pub name: &'static str,
    /// Documentation.
    pub doc: &'static str,
    /// Size [bytes].
    pub size: usize,
    /// Alignment [bytes].
    pub alignment: usize,
    /// Fields in the order of their offsets.
    pub fields: &'static [Field],
}

/// A field of a structure.
#[derive(Debug, PartialEq, Eq)]
pub struct Field {
    /// Name.
    pub name: &'static str,
    /// Documentation, with the unit.
    pub doc: &'static str,
    /// Offset from the start of the structure [bytes].
    pub offset: usize,
    /// Type.
    pub kind: Kind,
}

/// An enumeration: the meaning of a code.
#[derive(Debug, PartialEq, Eq)]
pub struct EnumLayout {
    /// Name.
    pub name: &'static str,
    /// Identifier, name in logs, and code of each variant.
    pub variants: &'static [(&'static str, &'static str, u32)],
}

/// A message: its name on the wire and its layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageLayout {
    /// Name of the type on the wire.
    pub name: &'static str,
    /// Layout.
    pub layout: &'static StructLayout,
}

/// A type whose layout is described.
pub trait Described {
    /// Its layout.
    const KIND: Kind;
}

impl Described for u8 {
    const KIND: Kind = Kind::Unsigned(1);
}

impl Described for u32 {
    const KIND: Kind = Kind::Unsigned(4);
}

impl Described for u64 {
    const KIND: Kind = Kind::Unsigned(8);
}

impl Described for i64 {
    const KIND: Kind = Kind::Signed(8);
}

impl Described for f64 {
    const KIND: Kind = Kind::Float;
}

impl<T: Described, const N: usize> Described for [T; N] {
    const KIND: Kind = Kind::Array(&T::KIND, N);
}

impl Kind {
    /// Size [bytes].
    #[must_use]
    pub const fn size(&self) -> usize {
        match self {
            Self::Unsigned(bytes) | Self::Signed(bytes) => *bytes,
            Self::Float => 8,
            Self::Array(kind, count) => kind.size() * *count,
            Self::Struct(layout) => layout.size,
        }
    }
}

const fn message<T: Message + Described>() -> MessageLayout {
    match T::KIND {
        Kind::Struct(layout) => MessageLayout { name: T::NAME, layout },
        _ => panic!("a message is a structure"),
    }
}

/// All messages.
pub const MESSAGES: &[MessageLayout] = &[
    message::<State>(),
    message::<Reference>(),
    message::<Request>(),
    message::<Command>(),
    message::<Operator>(),
    message::<Event>(),
    message::<Timing>(),
    message::<Credit>(),
    message::<Injection>(),
    message::<OperatorRequest>(),
    message::<OperatorReply>(),
];

/// All enumerations whose codes stand in messages.
pub const ENUMS: &[&EnumLayout] = &[
    &Process::LAYOUT,
    &Phase::LAYOUT,
    &Mode::LAYOUT,
    &Source::LAYOUT,
    &Severity::LAYOUT,
    &Drive::LAYOUT,
    &Task::LAYOUT,
    &Search::LAYOUT,
    &Saturation::LAYOUT,
    &ResetPolicy::LAYOUT,
    &EventKind::LAYOUT,
    &Detector::LAYOUT,
    &TaskCondition::LAYOUT,
    &MessageFault::LAYOUT,
    &OperatorKind::LAYOUT,
    &ReplyCode::LAYOUT,
];

/// All structures, each after those that it contains.
#[must_use]
pub fn structs() -> Vec<&'static StructLayout> {
    fn add(layout: &'static StructLayout, all: &mut Vec<&'static StructLayout>) {
        for field in layout.fields {
            let mut kind = &field.kind;
            while let Kind::Array(of, _) = kind {
                kind = of;
            }
            if let Kind::Struct(inner) = kind {
                add(inner, all);
            }
        }
        if !all.contains(&layout) {
            all.push(layout);
        }
    }
    let mut all = Vec::new();
    for message in MESSAGES {
        add(message.layout, &mut all);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layouts_fill_their_structures_without_gaps() {
        for layout in structs() {
            let mut end = 0;
            for field in layout.fields {
                assert_eq!(field.offset, end, "{}.{}", layout.name, field.name);
                assert!(!field.doc.trim().is_empty(), "{}.{}", layout.name, field.name);
                end += field.kind.size();
            }
            assert_eq!(layout.size, end, "{}", layout.name);
        }
        let state = MESSAGES.iter().find(|message| message.name == "hapfic.State").map(|message| message.layout);
        assert_eq!(state.map(|layout| layout.size), Some(size_of::<State>()));
    }
}
