//! LZ4 frames of which only the beginning is good.
//!
//! The usual decoder gives nothing of a block of 64 KiB that is cut off. This one gives every byte that can be told from those
//! that are there: what comes out first depends only on what goes in first.

use super::bytes::Fields;

/// First bytes of a frame.
pub(super) const MAGIC: u32 = 0x184d_2204;
/// Bit of a block's size that says it is not compressed.
const RAW: u32 = 0x8000_0000;
/// Shortest match, bytes.
const SHORTEST: usize = 4;

/// Decodes into `out`, at most `most` bytes, until the frame ends or makes no sense.
pub(super) fn decode(frame: &[u8], most: usize, out: &mut Vec<u8>) {
    out.clear();
    // Whether it ended well is not known from the frame alone: the caller looks at what has come out.
    let _ = blocks(frame, most, out);
}

fn blocks(frame: &[u8], most: usize, out: &mut Vec<u8>) -> Option<()> {
    let mut fields = Fields::new(frame);
    if fields.u32()? != MAGIC {
        return None;
    }
    let flags = fields.u8()?;
    fields.u8()?;
    if flags & 0x08 != 0 {
        // Size of the content.
        fields.u64()?;
    }
    if flags & 0x01 != 0 {
        // Dictionary.
        fields.u32()?;
    }
    // Sum over the header.
    fields.u8()?;
    loop {
        let size = fields.u32()?;
        if size == 0 {
            return Some(());
        }
        let length = (size & !RAW) as usize;
        let block = fields.take_up_to(length);
        if size & RAW != 0 {
            let room = most.saturating_sub(out.len());
            out.extend_from_slice(block.get(..room).unwrap_or(block));
        } else {
            sequences(block, most, out)?;
        }
        if block.len() < length {
            return None;
        }
        if flags & 0x10 != 0 {
            // Sum over the block.
            fields.u32()?;
        }
    }
}

/// Decodes one block: literals, then a copy of what has come out before, and again. Blocks may copy from those before them.
fn sequences(block: &[u8], most: usize, out: &mut Vec<u8>) -> Option<()> {
    let mut fields = Fields::new(block);
    while !fields.is_empty() {
        let token = fields.u8()?;
        let literals = length(token >> 4, &mut fields)?;
        let bytes = fields.take_up_to(literals.min(most.saturating_sub(out.len())));
        out.extend_from_slice(bytes);
        if bytes.len() < literals {
            return None;
        }
        if fields.is_empty() {
            // The last sequence has no copy.
            break;
        }
        let distance = usize::from(fields.u16()?);
        let count = length(token & 0x0f, &mut fields)?.checked_add(SHORTEST)?;
        let start = out.len().checked_sub(distance)?;
        if distance == 0 || count > most.saturating_sub(out.len()) {
            return None;
        }
        // Byte by byte: a copy may run into what it is writing.
        for place in start..start + count {
            let byte = out[place];
            out.push(byte);
        }
    }
    Some(())
}

/// A length of four bits, and more bytes if they are all set.
fn length(bits: u8, fields: &mut Fields<'_>) -> Option<usize> {
    let mut sum = usize::from(bits);
    if bits == 15 {
        loop {
            let more = fields.u8()?;
            sum = sum.checked_add(usize::from(more))?;
            if more != u8::MAX {
                break;
            }
        }
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `abcd` as literals, eight bytes copied from four back, `!` as the last literal.
    const BLOCK: [u8; 9] = [0x44, b'a', b'b', b'c', b'd', 4, 0, 0x10, b'!'];

    fn frame() -> Vec<u8> {
        let mut frame = MAGIC.to_le_bytes().to_vec();
        frame.extend_from_slice(&[0x40, 0x40, 0]);
        frame.extend_from_slice(&(BLOCK.len() as u32).to_le_bytes());
        frame.extend_from_slice(&BLOCK);
        frame.extend_from_slice(&(RAW | 2).to_le_bytes());
        frame.extend_from_slice(b"??");
        frame.extend_from_slice(&0_u32.to_le_bytes());
        frame.extend_from_slice(b"behind the end");
        frame
    }

    fn decoded(frame: &[u8], most: usize) -> Vec<u8> {
        let mut out = Vec::new();
        decode(frame, most, &mut out);
        out
    }

    #[test]
    fn a_frame_is_decoded_to_its_end() {
        assert_eq!(decoded(&frame(), 1000), b"abcdabcdabcd!??");
    }

    #[test]
    fn a_cut_off_frame_gives_its_beginning() {
        let whole = decoded(&frame(), 1000);
        for length in 0..frame().len() {
            let part = decoded(&frame()[..length], 1000);
            assert!(whole.starts_with(&part), "cut off at {length}");
        }
        assert_eq!(decoded(&frame()[..15], 1000), b"abc", "the literals that are there");
    }

    #[test]
    fn no_more_comes_out_than_is_asked_for() {
        for most in 0..20 {
            assert!(decoded(&frame(), most).len() <= most);
        }
    }

    #[test]
    fn a_copy_from_before_the_start_ends_it() {
        let mut altered = frame();
        altered[16] = 5;
        assert_eq!(decoded(&altered, 1000), b"abcd");
    }
}
