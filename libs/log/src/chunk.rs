//! Records inside a chunk.
//!
//! `mcap` decompresses a chunk and checks its checksum. This module first checks what `mcap` does not: records that
//! overrun an uncompressed chunk, and sizes that no compressor can produce.

use crate::frames::MAX_RECORD_BYTES;
use crate::lengths::{describe, parse};
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// Opcode and length.
const HEAD: u64 = 9;
/// Upper bound of the compression ratio: LZ4 expands a byte to at most 255.
const MAX_RATIO: u64 = 256;
/// Upper bound of the frame around the data [bytes].
const FRAME: u64 = 1024;

/// Reads the records of consecutive chunks. Errors are texts; the caller adds the place.
pub(crate) struct ChunkReader {
    inner: LinearReader,
    /// Chunk record, with opcode and length.
    record: Vec<u8>,
    /// Bytes of `record` passed to `inner`.
    given: usize,
    /// Size of the unread records, uncompressed [bytes].
    remaining: u64,
}

impl ChunkReader {
    pub(crate) fn new() -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD_BYTES as usize);
        Self { inner: LinearReader::new_with_options(options), record: Vec::new(), given: 0, remaining: 0 }
    }

    /// Begins a chunk, given its record without opcode and length. The previous chunk must have been read to its end.
    pub(crate) fn open(&mut self, body: &[u8]) -> Result<(), String> {
        let Record::Chunk { header, data } = parse(op::CHUNK, body)? else {
            return Err("found another record, expected a chunk".into());
        };
        match header.compression.as_str() {
            "" if !is_tiled(&data) => return Err("the last record of the chunk runs over its end".into()),
            "" => self.remaining = data.len() as u64,
            "lz4" => self.remaining = header.uncompressed_size,
            other => return Err(format!("found compression `{other}`, expected `lz4` or none")),
        }
        let limit = header.compressed_size.saturating_mul(MAX_RATIO).saturating_add(FRAME).min(MAX_RECORD_BYTES);
        if self.remaining > limit {
            return Err(format!(
                "found {} bytes that decompress to {}, expected at most {limit}",
                header.compressed_size, self.remaining
            ));
        }
        self.record.clear();
        self.record.push(op::CHUNK);
        self.record.extend_from_slice(&(body.len() as u64).to_le_bytes());
        self.record.extend_from_slice(body);
        self.given = 0;
        Ok(())
    }

    /// Reads the next record into `out` and returns its opcode; `None` at the end of the chunk.
    pub(crate) fn read_record(&mut self, out: &mut Vec<u8>) -> Result<Option<u8>, String> {
        loop {
            let Some(event) = self.inner.next_event() else { return self.end() };
            match event {
                Err(error) => return Err(describe(error)),
                Ok(LinearReadEvent::Record { data, opcode }) => {
                    out.clear();
                    out.extend_from_slice(data);
                    self.remaining = self
                        .remaining
                        .checked_sub(HEAD + out.len() as u64)
                        .ok_or("the chunk is larger than its header states")?;
                    return Ok(Some(opcode));
                }
                Ok(LinearReadEvent::ReadRequest(requested)) => {
                    let rest = self.record.get(self.given..).unwrap_or_default();
                    let length = requested.min(rest.len());
                    if length == 0 {
                        return self.end();
                    }
                    self.inner.insert(length).copy_from_slice(&rest[..length]);
                    self.inner.notify_read(length);
                    self.given += length;
                }
            }
        }
    }

    fn end(&self) -> Result<Option<u8>, String> {
        if self.remaining == 0 { Ok(None) } else { Err("the chunk ends in the middle of a record".into()) }
    }
}

/// Whether records fill `data` exactly.
fn is_tiled(data: &[u8]) -> bool {
    let mut rest = data;
    while let Some((head, after)) = rest.split_first_chunk::<9>() {
        let length = head.iter().skip(1).rev().fold(0_u64, |sum, &byte| (sum << 8) | u64::from(byte));
        let Some(next) = usize::try_from(length).ok().and_then(|length| after.get(length..)) else { return false };
        rest = next;
    }
    rest.is_empty()
}
