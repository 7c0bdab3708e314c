//! Reader of a log.

use crate::attachment::Attachment;
use crate::chunk::ChunkReader;
use crate::error::LogError;
use crate::frames::Frames;
use crate::lengths;
use crate::names::Names;
use crate::proto;
use crate::topic::Topic;
use mcap::records::{self, op};
use prost::{DecodeError, Message};
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{BufReader, Read};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

/// Message of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct LogMessage {
    /// Name of the topic.
    pub topic: Arc<str>,
    /// Tick, cut to 32 bits.
    pub sequence: u32,
    /// Time of the tick [ns].
    pub log_time_ns: u64,
    /// Content.
    pub record: Record,
}

/// Content of a message.
#[derive(Clone, Debug, PartialEq)]
pub enum Record {
    /// From `/state`.
    State(proto::State),
    /// From `/reference`.
    Reference(proto::Reference),
    /// From `/request` or `/request/standby`, depending on its `controller`.
    Request(proto::Request),
    /// From `/command`.
    Command(proto::Command),
    /// From `/operator`.
    Operator(proto::Operator),
    /// From `/event`.
    Event(proto::Event),
    /// From `/timing`.
    Timing(proto::Timing),
    /// Message of another schema, such as a message for viewers.
    Other {
        /// Full name of the message.
        schema: Arc<str>,
        /// Encoded content.
        data: Vec<u8>,
    },
}

/// Iterator over the messages of a log from start to end, with one chunk in memory.
///
/// A truncated or damaged log gives its valid messages first, then a single error.
pub struct Reader<R: Read = BufReader<File>> {
    frames: Frames<R>,
    chunks: ChunkReader,
    /// First byte of the present chunk.
    chunk: Option<u64>,
    schemas: BTreeMap<u16, Arc<str>>,
    channels: BTreeMap<u16, Channel>,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    attachments: Vec<Attachment>,
    record: Vec<u8>,
    /// Message or error found during the search for metadata and attachments.
    pending: Option<Result<LogMessage, LogError>>,
    finished: bool,
}

struct Channel {
    topic: Arc<str>,
    schema: Arc<str>,
    decoded_as: Option<Topic>,
}

impl Reader<BufReader<File>> {
    /// Opens a log and reads its metadata and attachments.
    ///
    /// # Errors
    /// [`LogError::Open`], [`LogError::Read`], [`LogError::NotMcap`], and [`LogError::Truncated`] or
    /// [`LogError::Damaged`] if its first record is incomplete. The iteration returns later errors.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, LogError> {
        let path = path.as_ref();
        let file = File::open(path).map_err(|cause| LogError::Open { path: path.to_owned(), cause })?;
        Self::new(BufReader::with_capacity(256 * 1024, file), path)
    }
}

impl<R: Read> Reader<R> {
    /// Reads a log from any source, as [`Reader::open`]; errors name it `path`.
    ///
    /// # Errors
    /// As for [`Reader::open`].
    pub fn new(source: R, path: &Path) -> Result<Self, LogError> {
        let mut reader = Self {
            frames: Frames::new(source, path)?,
            chunks: ChunkReader::new(),
            chunk: None,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            metadata: BTreeMap::new(),
            attachments: Vec::new(),
            record: Vec::new(),
            pending: None,
            finished: false,
        };
        let start = reader.frames.offset();
        let first = reader.frames.read_record(&mut reader.record)?;
        if first != Some(op::HEADER) {
            return Err(LogError::damaged(path, start, "found another record, expected the header"));
        }
        while reader.chunk.is_none() && reader.pending.is_none() && !reader.finished {
            match reader.step() {
                Ok(ControlFlow::Continue(entry)) => reader.pending = entry.map(Ok),
                Ok(ControlFlow::Break(())) => reader.finished = true,
                Err(error) => reader.pending = Some(Err(error)),
            }
        }
        Ok(reader)
    }

    /// Metadata records by name, of the part read so far; the writer puts them before all messages.
    #[must_use]
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        &self.metadata
    }

    /// Attachments of the part read so far; the writer puts them before all messages.
    #[must_use]
    pub fn attachments(&self) -> &[Attachment] {
        &self.attachments
    }

    /// Names of joints, bodies and objects; empty lists if the log has none.
    #[must_use]
    pub fn names(&self) -> Names {
        self.metadata.get(Names::METADATA).map(Names::from_metadata).unwrap_or_default()
    }

    /// Reads one record: a message, `None` for anything else, a break at the end of the log.
    fn step(&mut self) -> Result<ControlFlow<(), Option<LogMessage>>, LogError> {
        if let Some(byte) = self.chunk {
            let opcode = self.chunks.read_record(&mut self.record);
            return match opcode.map_err(|what| LogError::damaged(self.frames.path(), byte, what))? {
                None => {
                    self.chunk = None;
                    Ok(ControlFlow::Continue(None))
                }
                Some(op::CHUNK) => Err(LogError::damaged(self.frames.path(), byte, "found a chunk inside a chunk")),
                Some(opcode) => self.accept(opcode, byte).map(ControlFlow::Continue),
            };
        }
        let byte = self.frames.offset();
        match self.frames.read_record(&mut self.record)? {
            None => Ok(ControlFlow::Break(())),
            Some(op::CHUNK) => {
                let opened = self.chunks.open(&self.record);
                opened.map_err(|what| LogError::damaged(self.frames.path(), byte, what))?;
                self.chunk = Some(byte);
                Ok(ControlFlow::Continue(None))
            }
            Some(opcode) => self.accept(opcode, byte).map(ControlFlow::Continue),
        }
    }

    /// Processes the present record; the record or its chunk begins at `byte`.
    fn accept(&mut self, opcode: u8, byte: u64) -> Result<Option<LogMessage>, LogError> {
        let damaged = |what: String| LogError::damaged(self.frames.path(), byte, what);
        match opcode {
            op::SCHEMA | op::CHANNEL | op::MESSAGE | op::METADATA | op::ATTACHMENT => {}
            // Indices and the summary repeat known records.
            _ => return Ok(None),
        }
        match lengths::parse(opcode, &self.record).map_err(damaged)? {
            records::Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name.into());
            }
            records::Record::Channel(channel) => {
                let schema =
                    match channel.schema_id {
                        0 => Arc::<str>::from(""),
                        id => self.schemas.get(&id).cloned().ok_or_else(|| {
                            damaged(format!("topic {} has schema {id}, which is not in the log", channel.topic))
                        })?,
                    };
                let decoded_as =
                    if channel.message_encoding == "protobuf" { Topic::resolve(&channel.topic, &schema) } else { None };
                self.channels.insert(channel.id, Channel { topic: channel.topic.into(), schema, decoded_as });
            }
            records::Record::Message { header, data } => {
                let id = header.channel_id;
                let channel = self
                    .channels
                    .get(&id)
                    .ok_or_else(|| damaged(format!("a message has channel {id}, which is not in the log")))?;
                let record = decode(channel, &data)
                    .map_err(|error| damaged(format!("a message of {} does not decode: {error}", channel.topic)))?;
                return Ok(Some(LogMessage {
                    topic: Arc::clone(&channel.topic),
                    sequence: header.sequence,
                    log_time_ns: header.log_time,
                    record,
                }));
            }
            records::Record::Metadata(metadata) => {
                self.metadata.insert(metadata.name, metadata.metadata);
            }
            records::Record::Attachment { header, data, .. } => {
                let bytes = data.into_owned();
                self.attachments.push(Attachment { name: header.name, media_type: header.media_type, bytes });
            }
            _ => {}
        }
        Ok(None)
    }
}

impl<R: Read> Iterator for Reader<R> {
    type Item = Result<LogMessage, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(item) = self.pending.take() {
            self.finished |= item.is_err();
            return Some(item);
        }
        while !self.finished {
            match self.step() {
                Ok(ControlFlow::Continue(Some(entry))) => return Some(Ok(entry)),
                Ok(ControlFlow::Continue(None)) => {}
                Ok(ControlFlow::Break(())) => self.finished = true,
                Err(error) => {
                    self.finished = true;
                    return Some(Err(error));
                }
            }
        }
        None
    }
}

impl<R: Read> fmt::Debug for Reader<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Reader").field("path", &self.frames.path()).field("byte", &self.frames.offset()).finish_non_exhaustive()
    }
}

fn decode(channel: &Channel, data: &[u8]) -> Result<Record, DecodeError> {
    Ok(match channel.decoded_as {
        Some(Topic::State) => Record::State(proto::State::decode(data)?),
        Some(Topic::Reference) => Record::Reference(proto::Reference::decode(data)?),
        Some(Topic::Request | Topic::StandbyRequest) => Record::Request(proto::Request::decode(data)?),
        Some(Topic::Command) => Record::Command(proto::Command::decode(data)?),
        Some(Topic::Operator) => Record::Operator(proto::Operator::decode(data)?),
        Some(Topic::Event) => Record::Event(proto::Event::decode(data)?),
        Some(Topic::Timing) => Record::Timing(proto::Timing::decode(data)?),
        Some(Topic::Transforms | Topic::Scene | Topic::Log) | None => {
            Record::Other { schema: Arc::clone(&channel.schema), data: data.to_vec() }
        }
    })
}
