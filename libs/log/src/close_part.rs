//! End of a part whose writer was killed.

use crate::parts::{numbered, part_path};
use mcap::MAGIC;
use mcap::records::op;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Length of the opcode and of the size of a record [bytes].
const RECORD_HEAD: u64 = 9;

/// Size above which a part is taken to hold messages [bytes]: more than scenario and robot need.
const LONGEST_BEGINNING: u64 = 8 << 20;

/// What of a killed writer's part stays behind its last completed flush.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remainder {
    /// All whole records.
    Kept,
    /// Nothing: a successor writes it again.
    Removed,
}

/// Ends the part of a killed writer: cuts it off behind its last whole record, and marks its end. The part has no index
/// then; readers go through it from the start, as they do while a log is written. Parts that the writer has begun behind its
/// last flush are removed with [`Remainder::Removed`], else ended, too. `log` is the path of the first part, `part` the number of the part at the last
/// flush, `flushed` its size then.
///
/// # Errors
/// If the file cannot be read or written.
pub fn close_last_part(log: &Path, part: u32, flushed: u64, remainder: Remainder) -> io::Result<()> {
    let beginning = MAGIC.len() as u64;
    for (_, path) in numbered(log).into_iter().filter(|(number, _)| *number > part.max(1)) {
        let too_short = std::fs::metadata(&path).is_ok_and(|metadata| metadata.len() < beginning);
        if too_short || remainder == Remainder::Removed {
            std::fs::remove_file(path)?;
        } else {
            close_part(&path, beginning, remainder)?;
        }
    }
    let path = part_path(log, part);
    if part > 1 {
        // A part without a message makes room, and the next writer of it may have died at its beginning.
        match std::fs::metadata(&path) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(()),
            Ok(metadata) if metadata.len() < flushed => return std::fs::remove_file(&path),
            _ => {}
        }
    }
    close_part(&path, flushed.max(beginning), remainder)?;
    if part > 1 && holds_no_message(&path)? {
        std::fs::remove_file(&path)?;
    }
    Ok(())
}

/// Whether a part holds nothing but its beginning.
fn holds_no_message(path: &Path) -> io::Result<bool> {
    let mut file = File::open(path)?;
    if file.metadata()?.len() > LONGEST_BEGINNING {
        return Ok(false);
    }
    let mut content = Vec::new();
    file.read_to_end(&mut content)?;
    let mut rest = content.get(MAGIC.len()..).unwrap_or_default();
    while let Some(([op, size @ ..], after)) = rest.split_first_chunk::<{ RECORD_HEAD as usize }>() {
        let size = usize::try_from(u64::from_le_bytes(*size)).unwrap_or(usize::MAX);
        let (&op, Some(next)) = (op, after.get(size..)) else { break };
        if matches!(op, op::CHUNK | op::MESSAGE) {
            return Ok(false);
        }
        rest = next;
    }
    Ok(true)
}

/// Ends the part of a killed writer: cuts it off behind its last whole record, and marks its end. The part has no index
/// then; readers go through it from the start, as they do while a log is written. A part that has an end stays as it is.
///
/// `flushed` is its size after the last completed flush [bytes].
///
/// # Errors
/// If the file cannot be read or written.
fn close_part(path: &Path, flushed: u64, remainder: Remainder) -> io::Result<()> {
    let mut file = File::options().read(true).write(true).open(path)?;
    let length = file.metadata()?.len();
    let mut end = flushed;
    if remainder == Remainder::Kept {
        while end + RECORD_HEAD <= length {
            let mut head = [0; RECORD_HEAD as usize];
            file.seek(SeekFrom::Start(end))?;
            file.read_exact(&mut head)?;
            let [op, size @ ..] = head;
            let size = u64::from_le_bytes(size);
            if op == op::DATA_END {
                return Ok(());
            }
            match end.checked_add(RECORD_HEAD).and_then(|content| content.checked_add(size)) {
                Some(next) if next <= length && op != 0 => end = next,
                _ => break,
            }
        }
    }
    if end > length {
        // Shorter than its writer said: another has changed it.
        return Err(io::Error::new(io::ErrorKind::InvalidData, "the part is shorter than what was flushed"));
    }
    file.set_len(end)?;
    file.seek(SeekFrom::Start(end))?;
    let mut tail = vec![op::DATA_END];
    tail.extend_from_slice(&4_u64.to_le_bytes());
    // No checksum.
    tail.extend_from_slice(&0_u32.to_le_bytes());
    tail.push(op::FOOTER);
    tail.extend_from_slice(&20_u64.to_le_bytes());
    // No summary, no checksum.
    tail.extend_from_slice(&[0; 20]);
    tail.extend_from_slice(MAGIC);
    file.write_all(&tail)
}
