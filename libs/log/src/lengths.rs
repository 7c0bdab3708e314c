//! Lengths within a record, checked before it is parsed: the parser asks for as much memory as a length says, and a damaged one may
//! say gigabytes.

use mcap::records::{Record, op};

/// Parses a record whose inner lengths fit into it.
///
/// # Errors
/// What is wrong with it, in words.
pub(crate) fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, String> {
    if !fit(opcode, body) {
        return Err("a record is shorter than the lengths in it say".to_owned());
    }
    mcap::parse_record(opcode, body).map_err(crate::chunk::describe)
}

/// Whether every length in a record's body leaves room for what it counts.
fn fit(opcode: u8, body: &[u8]) -> bool {
    let mut rest = Rest(body);
    let all = match opcode {
        op::HEADER => rest.text().and_then(|()| rest.text()),
        op::SCHEMA => rest.skip(2).and_then(|()| rest.text()).and_then(|()| rest.text()).and_then(|()| rest.text()),
        op::CHANNEL => rest.skip(4).and_then(|()| rest.text()).and_then(|()| rest.text()).and_then(|()| rest.map()),
        op::METADATA => rest.text().and_then(|()| rest.map()),
        op::CHUNK => rest.skip(28).and_then(|()| rest.text()),
        // Then the length of what is attached, and a checksum.
        op::ATTACHMENT => rest.skip(16).and_then(|()| rest.text()).and_then(|()| rest.text()).and_then(|()| rest.skip(12)),
        // Their lengths are those of fixed fields, or nobody here parses them.
        _ => Some(()),
    };
    all.is_some()
}

/// What is left of a record.
struct Rest<'a>(&'a [u8]);

impl Rest<'_> {
    fn skip(&mut self, count: usize) -> Option<()> {
        self.0 = self.0.get(count..)?;
        Some(())
    }

    fn length(&mut self) -> Option<usize> {
        let (length, rest) = self.0.split_first_chunk::<4>()?;
        self.0 = rest;
        usize::try_from(u32::from_le_bytes(*length)).ok()
    }

    /// A length of 32 bits, and as many bytes.
    fn text(&mut self) -> Option<()> {
        let length = self.length()?;
        self.skip(length)
    }

    /// A length of 32 bits, and as many bytes of pairs of texts.
    fn map(&mut self) -> Option<()> {
        let length = self.length()?;
        let mut pairs = Rest(self.0.get(..length)?);
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
    fn a_length_that_reaches_beyond_its_record_is_found_in_every_place() {
        let pair = [text("key"), text("value")].concat();
        let map = [&(pair.len() as u32).to_le_bytes()[..], &pair].concat();
        let good = [text("run"), map].concat();
        assert!(fit(op::METADATA, &good));
        // Each of the four lengths in turn says gigabytes.
        for at in [0, 7, 11, 18] {
            let mut bad = good.clone();
            bad[at + 3] = 0x80;
            assert!(!fit(op::METADATA, &bad), "length at byte {at}");
            assert!(parse(op::METADATA, &bad).is_err());
        }
        for cut in 0..good.len() {
            assert!(!fit(op::METADATA, &good[..cut]), "cut off at byte {cut}");
        }
    }
}
