//! Requests of operators to a running stack, and the replies.

use crate::check::{Check, ValidationError};
use crate::message::Message;
use crate::wire_enum::wire_enum;
use crate::wire_struct::wire_struct;
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Most bytes of text in an [`OperatorRequest`].
pub const REQUEST_TEXT: usize = 2048;
/// Most bytes of text in an [`OperatorReply`].
pub const REPLY_TEXT: usize = 4096;

wire_enum! {
    /// Kind of an operator's request.
    OperatorKind {
        /// Change parameters unless that is dangerous; the text holds `key=value` pairs, separated by NUL.
        Set = 1, "set";
        /// Report the status of the run; the reply's text is JSON.
        Status = 2, "status";
        /// End the run.
        Stop = 3, "stop";
        /// Latched stop: the drive brakes until the operator re-arms.
        EmergencyStop = 4, "estop";
        /// Leave a latched stop.
        Rearm = 5, "rearm";
        /// Inject a fault; the text holds `key=value` pairs, separated by NUL.
        Inject = 6, "inject";
        /// Change parameters even if that is dangerous; the text is that of `Set`.
        SetForced = 7, "set --force";
        /// Report what a change would do, and change nothing; the text is that of `Set`.
        SetDryRun = 8, "set --dry-run";
        /// Report the parameters in force as `key = value` lines; the text holds keys, separated by NUL, or is empty.
        Get = 9, "get";
    }
}

wire_enum! {
    /// Outcome of a request.
    ReplyCode {
        /// The request is done, or will be at the tick that the reply names.
        Done = 1, "done";
        /// The request is rejected and nothing has changed; the text gives the cause.
        Rejected = 2, "rejected";
    }
}

wire_struct! {
    /// Request of an operator to a running stack.
    #[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct OperatorRequest {
        /// Code of [`OperatorKind`].
        pub kind: u32,
        /// Bytes of `text` that count.
        pub text_len: u32,
        /// Text in UTF-8.
        pub text: [u8; REQUEST_TEXT],
    }
}

wire_struct! {
    /// Reply to an operator's request.
    #[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct OperatorReply {
        /// Version of the new parameters; zero if there are none.
        pub version: u64,
        /// First tick at which they are in force; -1 if there are none.
        pub tick: i64,
        /// Tick that was due when the request arrived at the supervisor.
        pub arrived_tick: i64,
        /// Tick that was due when the gate took the request; -1 if it did not.
        pub taken_tick: i64,
        /// Code of [`ReplyCode`].
        pub code: u32,
        /// Bytes of `text` that count.
        pub text_len: u32,
        /// Text in UTF-8.
        pub text: [u8; REPLY_TEXT],
    }
}

fn length(found: usize, most: usize) -> Result<(), ValidationError> {
    if found <= most {
        Ok(())
    } else {
        Err(ValidationError::Count { field: "text_len", found: found as u64, expected: most as u64 })
    }
}

fn utf8(bytes: &[u8], len: u32) -> Result<&str, ValidationError> {
    length(len as usize, bytes.len())?;
    core::str::from_utf8(&bytes[..len as usize]).map_err(|_| ValidationError::Text { field: "text" })
}

impl OperatorRequest {
    /// Request of a kind, with a text.
    ///
    /// # Errors
    /// [`ValidationError::Count`] if the text is longer than [`REQUEST_TEXT`] bytes.
    pub fn new(kind: OperatorKind, text: &str) -> Result<Self, ValidationError> {
        length(text.len(), REQUEST_TEXT)?;
        let mut bytes = [0; REQUEST_TEXT];
        bytes[..text.len()].copy_from_slice(text.as_bytes());
        Ok(Self { kind: kind.code(), text_len: text.len() as u32, text: bytes })
    }

    /// Kind and text.
    ///
    /// # Errors
    /// Their first defect.
    pub fn parts(&self) -> Result<(OperatorKind, &str), ValidationError> {
        let kind = OperatorKind::from_code(self.kind).ok_or(ValidationError::Code { field: "kind", found: self.kind })?;
        Ok((kind, utf8(&self.text, self.text_len)?))
    }
}

impl Check for OperatorRequest {
    fn check(&self) -> Result<(), ValidationError> {
        self.parts().map(drop)
    }
}

impl OperatorReply {
    /// Reply without parameters; its text is cut at [`REPLY_TEXT`] bytes (at a character's border).
    #[must_use]
    pub fn new(code: ReplyCode, text: &str) -> Self {
        let len = text.floor_char_boundary(REPLY_TEXT);
        let mut bytes = [0; REPLY_TEXT];
        bytes[..len].copy_from_slice(&text.as_bytes()[..len]);
        Self { version: 0, tick: -1, arrived_tick: -1, taken_tick: -1, code: code.code(), text_len: len as u32, text: bytes }
    }

    /// Code and text.
    ///
    /// # Errors
    /// Their first defect.
    pub fn parts(&self) -> Result<(ReplyCode, &str), ValidationError> {
        let code = ReplyCode::from_code(self.code).ok_or(ValidationError::Code { field: "code", found: self.code })?;
        Ok((code, utf8(&self.text, self.text_len)?))
    }
}

impl Check for OperatorReply {
    fn check(&self) -> Result<(), ValidationError> {
        self.parts().map(drop)
    }
}

impl Message for OperatorRequest {
    const NAME: &str = "hapfic.OperatorRequest";
}

impl Message for OperatorReply {
    const NAME: &str = "hapfic.OperatorReply";
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::{any, prop_assert, proptest};

    #[test]
    fn request_parts_match_input() {
        let request = OperatorRequest::new(OperatorKind::Set, "stiffness.z=9000\0taper=0.1").unwrap();
        assert_eq!(request.parts(), Ok((OperatorKind::Set, "stiffness.z=9000\0taper=0.1")));
        assert!(OperatorRequest::new(OperatorKind::Set, &"x".repeat(REQUEST_TEXT)).is_ok());
        assert!(OperatorRequest::new(OperatorKind::Set, &"x".repeat(REQUEST_TEXT + 1)).is_err());
    }

    #[test]
    fn reply_long_text_cut_between_characters() {
        let reply = OperatorReply::new(ReplyCode::Done, &"é".repeat(REPLY_TEXT));
        assert_eq!(reply.check(), Ok(()));
        assert_eq!(reply.parts().unwrap().1.len(), REPLY_TEXT);
    }

    proptest! {
        #[test]
        fn request_garbage_rejected_without_panic(
            kind in any::<u32>(),
            text_len in any::<u32>(),
            bytes in proptest::collection::vec(any::<u8>(), 64),
        ) {
            let mut text = [0xff; REQUEST_TEXT];
            text[..64].copy_from_slice(&bytes);
            let checked = OperatorRequest { kind, text_len, text }.check();
            if OperatorKind::from_code(kind).is_none() || text_len > 64 {
                prop_assert!(checked.is_err());
            }
        }
    }
}
