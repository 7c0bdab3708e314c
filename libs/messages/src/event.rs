//! Events: kind, process and detector of each.

use crate::codes::{Detector, EventKind, Process, Severity};
use crate::limits::EVENT_TEXT;
use crate::message::Message;
use crate::wire_struct::wire_struct;
use zerocopy::{FromBytes, Immutable, IntoBytes};

wire_struct! {
    /// Event of the stack.
    #[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct Event {
        /// Publication time [ns].
        pub stamp_ns: u64,
        /// Tick of the event.
        pub tick: i64,
        /// Code of the [`Process`] concerned.
        pub process: u32,
        /// Code of [`EventKind`].
        pub kind: u32,
        /// Code of [`Severity`].
        pub severity: u32,
        /// Code of [`Detector`].
        pub detector: u32,
        /// Bytes of `text` that count.
        pub text_len: u32,
        /// Not used; zero.
        pub reserved: u32,
        /// Text in UTF-8.
        pub text: [u8; EVENT_TEXT],
    }
}

impl Event {
    /// Event with a text, cut at [`EVENT_TEXT`] bytes (at a character's border).
    #[must_use]
    pub fn new(tick: i64, process: Process, kind: EventKind, severity: Severity, detector: Detector, text: &str) -> Self {
        let len = text.floor_char_boundary(EVENT_TEXT);
        let mut bytes = [0; EVENT_TEXT];
        bytes[..len].copy_from_slice(&text.as_bytes()[..len]);
        Self {
            stamp_ns: 0,
            tick,
            process: process.code(),
            kind: kind.code(),
            severity: severity.code(),
            detector: detector.code(),
            text_len: len as u32,
            reserved: 0,
            text: bytes,
        }
    }

    /// The text, with U+FFFD in place of invalid UTF-8.
    #[must_use]
    pub fn text(&self) -> std::borrow::Cow<'_, str> {
        String::from_utf8_lossy(&self.text[..(self.text_len as usize).min(EVENT_TEXT)])
    }
}

impl Message for Event {
    const NAME: &str = "hapfic.Event";
}
