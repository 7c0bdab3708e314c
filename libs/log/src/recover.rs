//! Recovery of a log that was cut off or damaged.
//!
//! Guarantees for a log of [`Writer`](crate::Writer) with damage in one or many places:
//!
//! - The original is opened read-only and stays unchanged. A complete log is not copied.
//! - Every message of an intact chunk, before or after the damage, is kept bit for bit, with its times. The order is
//!   that of the file. Intact means that the checksum of the chunk is right; the length of its record may be wrong.
//! - Of a damaged chunk, every message before the damaged byte is kept, as far as its compression allows: LZ4 is
//!   decoded up to the byte at which the chunk ends or is invalid. A checksum does not locate the damage. So later
//!   messages are kept too if they decode, have the number and time of their tick, and finite values: such a message
//!   may carry a wrong value. They are counted as `unchecked`, and the record `recovery` lists their ticks.
//! - No message is kept twice.
//! - Attachments are kept if their checksum is right, metadata if it can be read (MCAP has no checksum for it). Only
//!   the first chunk holds schemas and channels: if it is damaged, the schemas and channels of this program replace
//!   them.
//!
//! After damage, the scan searches for the next record whose inner lengths agree with its outer length. Memory is
//! bounded to one chunk, for any length of the log.

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
pub use found::{DamagedRange, Recovery, TickGaps};

use crate::error::LogError;
use crate::frames::MAX_RECORD_BYTES;
use bytes::SourceFile;
use copy::Copier;
use mcap::MAGIC;
use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use output::RecoveryWriter;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Size of one read during the check of the checksums [bytes].
const READ_BYTES: usize = 256 * 1024;

/// Copies the readable part of a damaged log to a new log: `output`, or `NAME.recovered.mcap` beside the original.
///
/// A complete log gives [`Recovery::output`] `None`, and nothing is written. The new log appears under its name only
/// when it is complete and on the disk; an error leaves none.
///
/// # Errors
/// [`RecoverError`]: the log cannot be read, is still being written, is another kind of file or holds nothing; the
/// output exists already or cannot be written.
pub fn recover(log: &Path, output: Option<&Path>) -> Result<Recovery, RecoverError> {
    let source = SourceFile::open(log)?;
    let soundness = soundness(source.file(), log)?;
    let target = output.map_or_else(|| log.with_extension("recovered.mcap"), Path::to_owned);
    if soundness == Soundness::Unsummed {
        let mut copier = Copier::new(None);
        scan::scan(&source, &mut copier)?;
        let (_, mut found) = copier.into_parts();
        if found.loss_count == 0 {
            found.file_bytes = source.length();
            return Ok(found);
        }
    }
    let complete = soundness == Soundness::Whole;
    let mut copier = Copier::new(if complete { None } else { Some(RecoveryWriter::create(log, &target)?) });
    scan::scan(&source, &mut copier)?;
    let (output, mut found) = copier.into_parts();
    found.file_bytes = source.length();
    let Some(output) = output else { return Ok(found) };
    if found.is_empty() {
        return Err(empty_error(&source)?);
    }
    if found.loss_count == 0 {
        found.add_loss(source.length(), 0, 0, "the summary, an index or a length does not agree with its checksum".to_owned());
    }
    output.finish(&found)?;
    found.output = Some(target);
    Ok(found)
}

/// Returns the error for a file without recoverable content.
fn empty_error(source: &SourceFile) -> Result<RecoverError, LogError> {
    let mut start = Vec::new();
    source.read(0, MAGIC.len() as u64, &mut start)?;
    let path = source.path().to_owned();
    if MAGIC.starts_with(&start) {
        return Ok(RecoverError::Nothing { path });
    }
    let found = start.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ");
    Ok(LogError::NotMcap { path, found }.into())
}

/// Result of the check of a log's checksums.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Soundness {
    /// All records are there, with right checksums over them.
    Whole,
    /// All records are there. Checksums over them are not: the log is by another writer, or its writer was lost and its
    /// successor has ended the part.
    Unsummed,
    /// A record is missing, or a checksum is wrong.
    Damaged,
}

/// Checks that the log has all its records, with right checksums over them.
fn soundness(mut file: &File, path: &Path) -> Result<Soundness, LogError> {
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_check_finishes_after_end_magic(true)
        .with_record_length_limit(MAX_RECORD_BYTES as usize);
    let mut reader = LinearReader::new_with_options(options);
    let mut byte = 0;
    // A checksum of zero stands for none.
    let (mut data_sum, mut summary_sum) = (false, false);
    loop {
        let Some(event) = reader.next_event() else {
            return Ok(if data_sum && summary_sum { Soundness::Whole } else { Soundness::Unsummed });
        };
        match event {
            Err(_) => return Ok(Soundness::Damaged),
            Ok(LinearReadEvent::Record { data, opcode: op::DATA_END }) => data_sum = data.iter().any(|&b| b != 0),
            Ok(LinearReadEvent::Record { data, opcode: op::FOOTER }) => summary_sum = data.iter().skip(16).any(|&b| b != 0),
            Ok(LinearReadEvent::Record { .. }) => {}
            Ok(LinearReadEvent::ReadRequest(requested)) => {
                let buffer = reader.insert(requested.max(READ_BYTES));
                let read = loop {
                    match file.read(buffer) {
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
