//! Decoder of LZ4 frames with a valid beginning only.
//!
//! The usual decoder returns nothing of a truncated block of 64 KiB. This decoder returns every byte that the valid
//! input determines: the first output depends only on the first input.

use super::bytes::FieldReader;

/// First bytes of a frame.
pub(super) const MAGIC: u32 = 0x184d_2204;
/// Bit of a block's size for an uncompressed block.
const RAW: u32 = 0x8000_0000;
/// Shortest match [bytes].
const MIN_MATCH: usize = 4;

/// Decodes into `out`, at most `limit` bytes, until the frame ends or is invalid.
pub(super) fn decode(frame: &[u8], limit: usize, out: &mut Vec<u8>) {
    out.clear();
    // The frame alone does not show whether it is complete: the caller checks the output.
    let _ = blocks(frame, limit, out);
}

fn blocks(frame: &[u8], limit: usize, out: &mut Vec<u8>) -> Option<()> {
    let mut fields = FieldReader::new(frame);
    if fields.u32()? != MAGIC {
        return None;
    }
    let flags = fields.u8()?;
    fields.u8()?;
    if flags & 0x08 != 0 {
        // Content size.
        fields.u64()?;
    }
    if flags & 0x01 != 0 {
        // Dictionary.
        fields.u32()?;
    }
    // Checksum of the header.
    fields.u8()?;
    loop {
        let size = fields.u32()?;
        if size == 0 {
            return Some(());
        }
        let length = (size & !RAW) as usize;
        let block = fields.take_up_to(length);
        if size & RAW != 0 {
            let free = limit.saturating_sub(out.len());
            out.extend_from_slice(block.get(..free).unwrap_or(block));
        } else {
            sequences(block, limit, out)?;
        }
        if block.len() < length {
            return None;
        }
        if flags & 0x10 != 0 {
            // Checksum of the block.
            fields.u32()?;
        }
    }
}

/// Decodes one block: literals, then a copy of earlier output, and so on. Blocks may copy from earlier blocks.
fn sequences(block: &[u8], limit: usize, out: &mut Vec<u8>) -> Option<()> {
    let mut fields = FieldReader::new(block);
    while !fields.is_empty() {
        let token = fields.u8()?;
        let literals = length(token >> 4, &mut fields)?;
        let bytes = fields.take_up_to(literals.min(limit.saturating_sub(out.len())));
        out.extend_from_slice(bytes);
        if bytes.len() < literals {
            return None;
        }
        if fields.is_empty() {
            // The last sequence has no copy.
            break;
        }
        let distance = usize::from(fields.u16()?);
        let count = length(token & 0x0f, &mut fields)?.checked_add(MIN_MATCH)?;
        let start = out.len().checked_sub(distance)?;
        if distance == 0 || count > limit.saturating_sub(out.len()) {
            return None;
        }
        // Byte by byte: a copy may overlap its own output.
        for index in start..start + count {
            let byte = out[index];
            out.push(byte);
        }
    }
    Some(())
}

/// Reads a length of four bits, with further bytes if all four are set.
fn length(bits: u8, fields: &mut FieldReader<'_>) -> Option<usize> {
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
        frame.extend_from_slice(b"after the end");
        frame
    }

    fn decoded(frame: &[u8], limit: usize) -> Vec<u8> {
        let mut out = Vec::new();
        decode(frame, limit, &mut out);
        out
    }

    #[test]
    fn decode_whole_frame_ends_at_end_mark() {
        assert_eq!(decoded(&frame(), 1000), b"abcdabcdabcd!??");
    }

    #[test]
    fn decode_truncated_frame_gives_beginning() {
        let whole = decoded(&frame(), 1000);
        for length in 0..frame().len() {
            let part = decoded(&frame()[..length], 1000);
            assert!(whole.starts_with(&part), "cut off at {length}");
        }
        assert_eq!(decoded(&frame()[..15], 1000), b"abc", "literals before the cut");
    }

    #[test]
    fn decode_output_stays_within_limit() {
        for limit in 0..20 {
            assert!(decoded(&frame(), limit).len() <= limit);
        }
    }

    #[test]
    fn decode_copy_from_before_start_ends() {
        let mut altered = frame();
        altered[16] = 5;
        assert_eq!(decoded(&altered, 1000), b"abcd");
    }
}
