//! Making a log that was cut off or damaged readable again.
//!
//! What is promised, for a log of [`Writer`](crate::Writer) with damage in one or many places:
//!
//! - The original is opened for reading alone and stays as it is. A log that is whole is not copied.
//! - Every message of a chunk that is whole, before or behind the damage, is kept bit for bit, in the order of the file and
//!   with its times. Whole means that the checksum of the chunk is right; the length of its record may be wrong.
//! - Of a chunk that was hit, every message is kept whose bytes lie before the damaged byte, as far as its compression lets
//!   them be told: LZ4 is decoded up to the byte at which the chunk ends or makes no sense. Nobody can tell by a checksum where
//!   in such a chunk the damage is, so messages behind it may be kept too as long as they decode, have the number and the time
//!   of their tick and finite values: such a message may carry a wrong value. They are counted as `unchecked`, and the record
//!   `recovery` says which ticks they are of.
//! - No message is kept twice.
//! - Attachments are kept if their checksum is right, metadata if it can be read (MCAP has no checksum for it). Schemas and
//!   channels stand in the first chunk alone: if that was hit, those of this program take their place.
//!
//! Damage is passed over by looking for the next record whose inner lengths agree with its outer one. Memory stays bounded: a
//! chunk at a time, whatever the length of the log.

mod bytes;
mod copy;
mod error;
mod found;
mod lz4;
mod output;
mod plausibility;
mod records;
mod scan;

pub use error::RecoverError;
pub use found::{Loss, Recovery, TickGaps};

use crate::error::LogError;
use crate::frames::LONGEST_RECORD;
use bytes::Source;
use copy::Carry;
use mcap::MAGIC;
use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use output::Output;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Bytes read at once while the checksums are summed up.
const READ_AT_ONCE: usize = 256 * 1024;

/// Writes what can be read of a damaged log to a new, complete log: `output`, or `NAME.recovered.mcap` beside the original.
///
/// A log that is whole gives [`Recovery::output`] `None`, and nothing is written. The new log appears under its name only when it
/// is complete and on the disk; after an error there is none.
///
/// # Errors
/// [`RecoverError`]: the log cannot be read, is still being written, is something else or holds nothing; the output exists
/// already or cannot be written.
pub fn recover(log: &Path, output: Option<&Path>) -> Result<Recovery, RecoverError> {
    let source = Source::open(log)?;
    let whole = is_whole(source.file(), log)?;
    let target = output.map_or_else(|| log.with_extension("recovered.mcap"), Path::to_owned);
    let mut carry = Carry::new(if whole { None } else { Some(Output::create(log, &target)?) });
    scan::scan(&source, &mut carry)?;
    let (output, mut found) = carry.into_parts();
    found.file_bytes = source.length();
    let Some(output) = output else { return Ok(found) };
    if found.is_empty() {
        return Err(nothing(&source)?);
    }
    if found.loss_count == 0 {
        found.lose(source.length(), 0, 0, "the summary, an index or a length does not agree with its checksum".to_owned());
    }
    output.finish(&found)?;
    found.output = Some(target);
    Ok(found)
}

/// What to say of a file in which nothing was found.
fn nothing(source: &Source) -> Result<RecoverError, LogError> {
    let mut start = Vec::new();
    source.read(0, MAGIC.len() as u64, &mut start)?;
    let path = source.path().to_owned();
    if MAGIC.starts_with(&start) {
        return Ok(RecoverError::Nothing { path });
    }
    let found = start.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ");
    Ok(LogError::NotMcap { path, found }.into())
}

/// Whether the log has all its records, and the checksums over them are there and right.
fn is_whole(mut file: &File, path: &Path) -> Result<bool, LogError> {
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_check_finishes_after_end_magic(true)
        .with_record_length_limit(LONGEST_RECORD as usize);
    let mut reader = LinearReader::new_with_options(options);
    let mut byte = 0;
    // A checksum of zero means that there is none.
    let (mut data_sum, mut summary_sum) = (false, false);
    loop {
        let Some(event) = reader.next_event() else { return Ok(data_sum && summary_sum) };
        match event {
            Err(_) => return Ok(false),
            Ok(LinearReadEvent::Record { data, opcode: op::DATA_END }) => data_sum = data.iter().any(|&b| b != 0),
            Ok(LinearReadEvent::Record { data, opcode: op::FOOTER }) => summary_sum = data.iter().skip(16).any(|&b| b != 0),
            Ok(LinearReadEvent::Record { .. }) => {}
            Ok(LinearReadEvent::ReadRequest(wanted)) => {
                let room = reader.insert(wanted.max(READ_AT_ONCE));
                let read = loop {
                    match file.read(room) {
                        Err(cause) if cause.kind() == io::ErrorKind::Interrupted => {}
                        Err(cause) => return Err(LogError::Read { path: path.to_owned(), byte, cause }),
                        Ok(read) => break read,
                    }
                };
                byte += read as u64;
                reader.notify_read(read);
            }
        }
    }
}
