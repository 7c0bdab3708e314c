//! Check of the lengths inside a record before it is parsed: the parser allocates what a length claims, and a damaged
//! length may claim gigabytes.

use mcap::McapError;
use mcap::records::{Record, op};

/// Parses a record after a check of its inner lengths.
///
/// # Errors
/// The defect of the record, as text.
pub(crate) fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, String> {
    if !fit(opcode, body) {
        return Err("a record is shorter than the lengths in it".to_owned());
    }
    mcap::parse_record(opcode, body).map_err(describe)
}

/// Returns the text of an error with its cause, which `mcap` keeps apart.
pub(crate) fn describe(error: McapError) -> String {
    match error {
        McapError::Io(cause) => cause.to_string(),
        other => other.to_string(),
    }
}

/// Whether every length in a record's body stays inside the body.
fn fit(opcode: u8, body: &[u8]) -> bool {
    let mut rest = UnreadBytes(body);
    let all = match opcode {
        op::HEADER => rest.text().and_then(|()| rest.text()),
        op::SCHEMA => rest.skip(2).and_then(|()| rest.text()).and_then(|()| rest.text()).and_then(|()| rest.text()),
        op::CHANNEL => rest.skip(4).and_then(|()| rest.text()).and_then(|()| rest.text()).and_then(|()| rest.map()),
        op::METADATA => rest.text().and_then(|()| rest.map()),
        op::CHUNK => rest.skip(28).and_then(|()| rest.text()),
        // Then the length of the attached data, and a checksum.
        op::ATTACHMENT => rest.skip(16).and_then(|()| rest.text()).and_then(|()| rest.text()).and_then(|()| rest.skip(12)),
        // Records with fixed fields only, or records that are not parsed.
        _ => Some(()),
    };
    all.is_some()
}

/// Unread rest of a record.
struct UnreadBytes<'a>(&'a [u8]);

impl UnreadBytes<'_> {
    fn skip(&mut self, count: usize) -> Option<()> {
        self.0 = self.0.get(count..)?;
        Some(())
    }

    fn length(&mut self) -> Option<usize> {
        let (length, rest) = self.0.split_first_chunk::<4>()?;
        self.0 = rest;
        usize::try_from(u32::from_le_bytes(*length)).ok()
    }

    /// Skips a length of 32 bits and as many bytes.
    fn text(&mut self) -> Option<()> {
        let length = self.length()?;
        self.skip(length)
    }

    /// Skips a length of 32 bits and as many bytes of pairs of texts.
    fn map(&mut self) -> Option<()> {
        let length = self.length()?;
        let mut pairs = UnreadBytes(self.0.get(..length)?);
        while !pairs.0.is_empty() {
            pairs.text()?;
            pairs.text()?;
        }
        self.skip(length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(text: &str) -> Vec<u8> {
        [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
    }

    #[test]
    fn fit_length_beyond_record_is_detected_everywhere() {
        let pair = [text("key"), text("value")].concat();
        let map = [&(pair.len() as u32).to_le_bytes()[..], &pair].concat();
        let valid = [text("run"), map].concat();
        assert!(fit(op::METADATA, &valid));
        // Each of the four lengths in turn claims gigabytes.
        for at in [0, 7, 11, 18] {
            let mut invalid = valid.clone();
            invalid[at + 3] = 0x80;
            assert!(!fit(op::METADATA, &invalid), "length at byte {at}");
            assert!(parse(op::METADATA, &invalid).is_err());
        }
        for cut in 0..valid.len() {
            assert!(!fit(op::METADATA, &valid[..cut]), "cut off at byte {cut}");
        }
    }
}
