//! Scan of a damaged log: record by record where it is intact, with a search for the next record where it is not.

use super::bytes::{HEAD, SourceFile};
use super::copy::Copier;
use super::error::RecoverError;
use super::lz4;
use super::records::{self, ChunkHead};
use crate::chunk::ChunkReader;
use crate::frames::MAX_RECORD_BYTES;
use mcap::MAGIC;
use mcap::records::op;

/// Window of the search [bytes].
const WINDOW: u64 = 256 * 1024;
/// Beginning of a chunk or attachment that contains everything before its data [bytes].
const START: u64 = 4096;
/// Longest valid metadata record after damage [bytes].
const MAX_METADATA_BYTES: u64 = 1 << 20;
/// Length of the footer [bytes].
const FOOTER: u64 = 20;
/// Length of the record before the summary [bytes].
const DATA_END: u64 = 4;

struct Scan<'a> {
    source: &'a SourceFile,
    copier: &'a mut Copier,
    chunks: ChunkReader,
    body: Vec<u8>,
    record: Vec<u8>,
    /// Records of a chunk, uncompressed.
    records: Vec<u8>,
    /// Whether the end of the data was found.
    ended: bool,
    /// Whether the footer was found.
    closed: bool,
}

/// Passes everything readable in `source` to `copier`.
pub(super) fn scan(source: &SourceFile, copier: &mut Copier) -> Result<(), RecoverError> {
    let mut scan = Scan {
        source,
        copier,
        chunks: ChunkReader::new(),
        body: Vec::new(),
        record: Vec::new(),
        records: Vec::new(),
        ended: false,
        closed: false,
    };
    let magic = MAGIC.len() as u64;
    let mut at =
        if scan.is_magic(0)? { magic } else { scan.skip_damage(0, "found other bytes, expected the MCAP magic".to_owned())? };
    while at < source.length() {
        at = scan.step(at)?;
    }
    if !(scan.ended && scan.closed) {
        let what = "the log ends without its summary: it was cut off, or its writer was killed";
        scan.copier.found.add_loss(source.length(), 0, 0, what.to_owned());
    }
    Ok(())
}

impl Scan<'_> {
    /// Processes the record at `at`; returns the next byte to process.
    fn step(&mut self, at: u64) -> Result<u64, RecoverError> {
        self.source.read(at, HEAD, &mut self.body)?;
        let Some((opcode, length)) = records::head(&self.body) else {
            // Only the length or the opcode may be wrong.
            if self.body.first() == Some(&op::CHUNK)
                && let Some(next) = self.chunk_of_another_length(at)?
            {
                return Ok(next);
            }
            let length =
                self.body.get(1..HEAD as usize).map(|bytes| super::bytes::FieldReader::new(bytes).u64().unwrap_or(u64::MAX));
            return match length {
                Some(length) if self.is_chunk(at, length)? => self.chunk(at, length),
                _ => self.skip_damage(at, "found no record".to_owned()),
            };
        };
        let next = at + HEAD + length;
        match opcode {
            op::CHUNK => return self.chunk(at, length),
            op::METADATA => {
                self.source.read(at + HEAD, length, &mut self.body)?;
                if let Some(metadata) = records::metadata(&self.body).filter(|_| self.body.len() as u64 == length) {
                    self.copier.metadata(&metadata)?;
                    return Ok(next);
                }
            }
            op::ATTACHMENT => {
                self.source.read(at + HEAD, length, &mut self.body)?;
                if self.body.len() as u64 == length
                    && let Some(attachment) = records::attachment(&self.body)
                {
                    self.copier.attachment(&attachment)?;
                    return Ok(next);
                }
            }
            op::HEADER if at == MAGIC.len() as u64 => {
                self.source.read(at + HEAD, length, &mut self.body)?;
                if records::is_header(&self.body) && self.body.len() as u64 == length {
                    return Ok(next);
                }
            }
            op::MESSAGE_INDEX => {
                self.source.read(at + HEAD, length, &mut self.body)?;
                if records::is_message_index(&self.body) && self.body.len() as u64 == length {
                    return Ok(next);
                }
            }
            op::DATA_END if length == DATA_END && next <= self.source.length() => {
                self.ended = true;
                return Ok(next);
            }
            op::FOOTER if length == FOOTER && self.is_magic(next)? => {
                self.closed = true;
                return Ok(next + MAGIC.len() as u64);
            }
            // The new log gets its own summary.
            op::SCHEMA..=op::SUMMARY_OFFSET if self.ended && next <= self.source.length() => return Ok(next),
            _ => {}
        }
        if self.is_chunk(at, length)? {
            return self.chunk(at, length);
        }
        self.skip_damage(at, format!("a record with opcode {opcode:#04x} is damaged, cut off or out of place"))
    }

    /// Copies the chunk at `at`, or its readable part.
    fn chunk(&mut self, at: u64, length: u64) -> Result<u64, RecoverError> {
        self.source.read(at + HEAD, length, &mut self.body)?;
        let body = std::mem::take(&mut self.body);
        let result = self.chunk_of(at, length, &body);
        self.body = body;
        result
    }

    fn chunk_of(&mut self, at: u64, length: u64, body: &[u8]) -> Result<u64, RecoverError> {
        let next = at + HEAD + length;
        let Some(head) = ChunkHead::parse(body) else {
            // A wrong length may leave too few bytes for the header.
            return match self.chunk_of_another_length(at)? {
                Some(next) => Ok(next),
                None => self.skip_damage(at, "the header of a chunk is damaged".to_owned()),
            };
        };
        let complete = body.len() as u64 == length;
        let fits = head.fits(length, body);
        // A checksum of zero stands for none.
        if complete && fits && head.checksum != 0 && self.decompress(body) {
            self.copy_chunk(at, next)?;
            return Ok(next);
        }
        if !fits && let Some(next) = self.chunk_of_another_length(at)? {
            return Ok(next);
        }
        let data = body.get(head.length..).unwrap_or_default();
        let limit = MAX_RECORD_BYTES as usize;
        if head.compression.is_empty() {
            self.records.clear();
            self.records.extend_from_slice(data);
        } else {
            // For any other name: an invalid frame gives nothing.
            lz4::decode(data, limit, &mut self.records);
        }
        let copied = self.copier.chunk(&self.records, false)?;
        let end = if complete && fits && self.is_head(next)? { next } else { self.find(at + HEAD + head.length as u64)? };
        let state = if complete { "damaged" } else { "cut off" };
        let mut what = format!("a chunk is {state}");
        if let Some((first, last)) = copied.ticks {
            what += &format!("; the rescued messages are of ticks {} to {}", first as i32, last as i32);
        }
        if let Some(stopped) = copied.stopped {
            what += &format!("; then {stopped}");
        }
        self.copier.found.add_loss(at, end - at, copied.messages, what);
        Ok(end)
    }

    /// Copies the chunk at `at` by its inner lengths if its checksum is right: only the record's length is wrong then.
    ///
    /// Returns the next byte to process; `None` for any other damage.
    fn chunk_of_another_length(&mut self, at: u64) -> Result<Option<u64>, RecoverError> {
        let mut body = Vec::new();
        self.source.read(at + HEAD, START, &mut body)?;
        let Some(head) = ChunkHead::parse(&body) else { return Ok(None) };
        let length = (head.length as u64).saturating_add(head.compressed_size);
        if length > MAX_RECORD_BYTES || head.checksum == 0 || !head.fits(length, &body) {
            return Ok(None);
        }
        self.source.read(at + HEAD, length, &mut body)?;
        if (body.len() as u64) < length || !self.decompress(&body) {
            return Ok(None);
        }
        let next = at + HEAD + length;
        self.copier.found.add_loss(at, HEAD, 0, "the length of a chunk is wrong; its content is right".to_owned());
        self.copy_chunk(at, next)?;
        Ok(Some(next))
    }

    /// Copies the records of the chunk from `at` to `next`, which has a right checksum.
    fn copy_chunk(&mut self, at: u64, next: u64) -> Result<(), RecoverError> {
        let copied = self.copier.chunk(&self.records, true)?;
        if let Some(what) = copied.stopped {
            self.copier.found.add_loss(at, next - at, 0, format!("a part of a chunk is unusable: {what}"));
        }
        Ok(())
    }

    /// Decompresses a chunk into `records`; returns whether it is complete with a right checksum.
    fn decompress(&mut self, body: &[u8]) -> bool {
        self.records.clear();
        let result = self.chunks.open(body).and_then(|()| {
            while let Some(opcode) = self.chunks.read_record(&mut self.record)? {
                self.records.push(opcode);
                self.records.extend_from_slice(&(self.record.len() as u64).to_le_bytes());
                self.records.extend_from_slice(&self.record);
            }
            Ok(())
        });
        if result.is_err() {
            // The old reader stopped inside the damaged chunk.
            self.chunks = ChunkReader::new();
        }
        result.is_ok()
    }

    /// Skips damage from `at` to the next record.
    fn skip_damage(&mut self, at: u64, what: String) -> Result<u64, RecoverError> {
        let next = self.find(at + 1)?;
        self.copier.found.add_loss(at, next - at, 0, what);
        Ok(next)
    }

    /// Finds the next chunk, metadata or attachment from `from` on; the end of the file if there is none.
    fn find(&self, from: u64) -> Result<u64, RecoverError> {
        let end = self.source.length();
        let mut window = Vec::new();
        let mut start = from.min(end);
        loop {
            self.source.read(start, WINDOW, &mut window)?;
            for (offset, bytes) in window.windows(HEAD as usize).enumerate() {
                if !matches!(bytes[0], op::CHUNK | op::METADATA | op::ATTACHMENT) {
                    continue;
                }
                let at = start + offset as u64;
                if let Some((opcode, length)) = records::head(bytes)
                    && self.is_record(at, opcode, length)?
                {
                    return Ok(at);
                }
            }
            // The windows overlap by less than a head.
            let searched = (window.len() as u64).saturating_sub(HEAD - 1);
            if searched == 0 {
                return Ok(end);
            }
            start += searched;
        }
    }

    fn is_record(&self, at: u64, opcode: u8, length: u64) -> Result<bool, RecoverError> {
        let mut start = Vec::new();
        match opcode {
            op::METADATA if length <= MAX_METADATA_BYTES => {
                self.source.read(at + HEAD, length, &mut start)?;
                Ok(start.len() as u64 == length && records::metadata(&start).is_some())
            }
            op::ATTACHMENT => {
                self.source.read(at + HEAD, length.min(START), &mut start)?;
                Ok(at + HEAD + length <= self.source.length() && records::is_attachment(&start, length))
            }
            op::CHUNK => self.is_chunk(at, length),
            _ => Ok(false),
        }
    }

    /// Whether the body of the record at `at` is a chunk of this length, or the beginning of one.
    fn is_chunk(&self, at: u64, length: u64) -> Result<bool, RecoverError> {
        let mut start = Vec::new();
        if length > MAX_RECORD_BYTES {
            return Ok(false);
        }
        self.source.read(at + HEAD, length.min(START), &mut start)?;
        Ok(ChunkHead::parse(&start).is_some_and(|head| head.fits(length, &start)))
    }

    /// Whether a record, or the end of the file, is at `at`.
    fn is_head(&self, at: u64) -> Result<bool, RecoverError> {
        let mut head = Vec::new();
        self.source.read(at, HEAD, &mut head)?;
        Ok(head.is_empty() || records::head(&head).is_some())
    }

    fn is_magic(&self, at: u64) -> Result<bool, RecoverError> {
        let mut bytes = Vec::new();
        self.source.read(at, MAGIC.len() as u64, &mut bytes)?;
        Ok(bytes == MAGIC)
    }
}
