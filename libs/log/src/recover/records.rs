//! Records that a recovery searches for. Consistent lengths distinguish them from other bytes.

use super::bytes::{FieldReader, HEAD};
use super::lz4;
use crate::frames::MAX_RECORD_BYTES;
use mcap::records::{Metadata, Record, op};

/// Header of a chunk, before its data.
pub(super) struct ChunkHead<'a> {
    pub(super) uncompressed_size: u64,
    pub(super) checksum: u32,
    pub(super) compression: &'a str,
    pub(super) compressed_size: u64,
    /// Length of the header [bytes].
    pub(super) length: usize,
}

impl<'a> ChunkHead<'a> {
    /// Parses the beginning of a chunk's record, without opcode and length.
    pub(super) fn parse(body: &'a [u8]) -> Option<Self> {
        let mut fields = FieldReader::new(body);
        fields.take(16)?;
        let uncompressed_size = fields.u64()?;
        let checksum = fields.u32()?;
        let compression = fields.text()?;
        let compressed_size = fields.u64()?;
        Some(Self { uncompressed_size, checksum, compression, compressed_size, length: body.len() - fields.rest().len() })
    }

    /// Whether the header fits a chunk record of `length` bytes that begins with `body`.
    pub(super) fn fits(&self, length: u64, body: &[u8]) -> bool {
        let data = body.get(self.length..).unwrap_or_default();
        let starts = match self.compression {
            "" => true,
            "lz4" => lz4::MAGIC.to_le_bytes().iter().zip(data).all(|(expected, found)| expected == found),
            _ => false,
        };
        starts
            && self.uncompressed_size <= MAX_RECORD_BYTES
            && (self.length as u64).checked_add(self.compressed_size) == Some(length)
    }
}

/// Message in a chunk.
#[derive(Clone, Copy)]
pub(super) struct MessageRecord<'a> {
    pub(super) channel: u16,
    pub(super) sequence: u32,
    pub(super) log_time: u64,
    pub(super) publish_time: u64,
    pub(super) data: &'a [u8],
}

impl<'a> MessageRecord<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Option<Self> {
        let mut fields = FieldReader::new(body);
        Some(Self {
            channel: fields.u16()?,
            sequence: fields.u32()?,
            log_time: fields.u64()?,
            publish_time: fields.u64()?,
            data: fields.rest(),
        })
    }
}

/// Whether two texts fill a header record.
pub(super) fn is_header(body: &[u8]) -> bool {
    let mut fields = FieldReader::new(body);
    fields.text().and_then(|_| fields.text()).is_some() && fields.is_empty()
}

/// Whether entries of 16 bytes fill a message index.
pub(super) fn is_message_index(body: &[u8]) -> bool {
    let mut fields = FieldReader::new(body);
    let length = fields.u16().and_then(|_| fields.u32());
    length.is_some_and(|length| length as usize == fields.rest().len() && length.is_multiple_of(16))
}

/// Parses a metadata record; `None` unless pairs of texts fill it.
pub(super) fn metadata(body: &[u8]) -> Option<Metadata> {
    let mut fields = FieldReader::new(body);
    let name = fields.text()?;
    let length = fields.u32()? as usize;
    if name.is_empty() || length != fields.rest().len() {
        return None;
    }
    let mut metadata = std::collections::BTreeMap::new();
    while !fields.is_empty() {
        let key = fields.text()?;
        metadata.insert(key.to_owned(), fields.text()?.to_owned());
    }
    Some(Metadata { name: name.to_owned(), metadata })
}

/// Whether `start` is the beginning of an attachment record of `length` bytes.
pub(super) fn is_attachment(start: &[u8], length: u64) -> bool {
    const CHECKSUM: u64 = 4;
    let mut fields = FieldReader::new(start);
    let data = fields.take(16).and_then(|_| fields.text()).and_then(|_| fields.text()).and_then(|_| fields.u64());
    let before = (start.len() - fields.rest().len()) as u64;
    data.and_then(|data| data.checked_add(before + CHECKSUM)) == Some(length)
}

/// Parses an attachment; `None` unless its checksum is right.
pub(super) fn attachment(body: &[u8]) -> Option<mcap::Attachment<'_>> {
    // `mcap` does not check the lengths.
    if !is_attachment(body, body.len() as u64) {
        return None;
    }
    match crate::lengths::parse(op::ATTACHMENT, body).ok()? {
        // A checksum of zero stands for none.
        Record::Attachment { header, data, crc } if crc != 0 => Some(mcap::Attachment {
            log_time: header.log_time,
            create_time: header.create_time,
            name: header.name,
            media_type: header.media_type,
            data,
        }),
        _ => None,
    }
}

/// Parses opcode and length of a record; `None` if they are invalid.
pub(super) fn head(bytes: &[u8]) -> Option<(u8, u64)> {
    let mut fields = FieldReader::new(bytes.get(..HEAD as usize)?);
    let (opcode, length) = (fields.u8()?, fields.u64()?);
    ((op::HEADER..=op::DATA_END).contains(&opcode) && length <= MAX_RECORD_BYTES).then_some((opcode, length))
}
