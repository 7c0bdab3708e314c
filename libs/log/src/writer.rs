//! Writer of a log.

mod counting;
mod file;
mod rolling;

use crate::attachment::Attachment;
use crate::error::LogError;
use crate::names::Names;
use crate::parts::part_path;
use crate::time_of;
use crate::topic::Topic;
use counting::CountingWriter;
pub use file::LogFile;
use file::create_part;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use prost::Message;
use rolling::{Parts, number_part, totals};
use std::borrow::Cow;
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Largest chunk [bytes]: its buffer is allocated as a whole.
const MAX_CHUNK_BYTES: u64 = 16 << 20;
/// Buffer of a file [bytes].
const BUFFER: usize = 64 * 1024;

/// Options of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriterOptions {
    /// Time of tick 0 [ns since the Unix epoch]. Zero in lockstep, so that a log is a function of scenario and seed.
    pub start_unix_ns: u64,
    /// Uncompressed size at which a chunk is closed, at most 16 MiB [bytes]. A larger chunk compresses better, but a
    /// killed writer loses more.
    pub chunk_bytes: u64,
    /// Whether the log may get further parts: by `part_bytes`, or since another writer continues it. Its part is then
    /// numbered, and later parts of an earlier log of its name are removed.
    pub in_parts: bool,
    /// Size of the file from which on the next state begins a new part [bytes]; `None`: no size is too large.
    pub part_bytes: Option<u64>,
    /// Size of all parts above which the oldest but the first are removed [bytes].
    pub keep_bytes: Option<u64>,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self { start_unix_ns: 0, chunk_bytes: 256 * 1024, in_parts: false, part_bytes: None, keep_bytes: None }
    }
}

/// Totals of a finished log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LogTotals {
    messages: [u64; Topic::COUNT],
    /// Size of the encoded messages, before compression [bytes].
    pub message_bytes: u64,
    /// Size of all parts that were written [bytes].
    pub file_bytes: u64,
    /// Number of parts that were written, and of those that were removed again.
    pub parts: [u32; 2],
}

impl LogTotals {
    /// Number of messages of a topic.
    #[must_use]
    pub const fn messages(&self, topic: Topic) -> u64 {
        self.messages[topic.index()]
    }
}

/// Writer of a log.
///
/// ChunkReader are compressed in memory and written as a whole: a file cut off at any byte loses only unflushed
/// messages. After an error the writer writes nothing more. Dropping it finishes the file as far as possible and never
/// panics. Writing may block as long as the disk does: never call it from a real-time thread.
pub struct Writer<W: Write = BufWriter<File>> {
    mcap: mcap::Writer<NoSeek<CountingWriter<W>>>,
    path: PathBuf,
    /// Second handle of the file, for syncing; `None` without a regular file.
    disk: Option<File>,
    names: Names,
    start_unix_ns: u64,
    channels: [u16; Topic::COUNT],
    messages: [u64; Topic::COUNT],
    message_bytes: u64,
    buffer: Vec<u8>,
    unflushed: bool,
    /// Size of the present part [bytes].
    part_bytes: Arc<AtomicU64>,
    parts: Option<Parts<W>>,
}

impl Writer<BufWriter<File>> {
    /// Creates or replaces the file `path` and writes metadata and attachments.
    ///
    /// A path or disk that is not writable fails here, before the processes start. `header` holds metadata records
    /// by name; [`Names::METADATA`] is added to them.
    ///
    /// # Errors
    /// [`LogError::Create`], [`LogError::Busy`] and [`LogError::Write`].
    pub fn create(
        path: impl AsRef<Path>,
        names: &Names,
        header: &[(String, BTreeMap<String, String>)],
        attachments: &[Attachment],
        options: &WriterOptions,
    ) -> Result<Self, LogError> {
        Self::begin(LogFile::create(path, options.in_parts)?, names, header, attachments, options)
    }

    /// As [`Writer::create`], in a file that is created already.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn begin(
        file: LogFile,
        names: &Names,
        header: &[(String, BTreeMap<String, String>)],
        attachments: &[Attachment],
        options: &WriterOptions,
    ) -> Result<Self, LogError> {
        let LogFile { path, file, regular } = file;
        let failed = |cause| LogError::Write { path: path.clone(), cause };
        let disk = if regular { Some(file.try_clone().map_err(failed)?) } else { None };
        let output = BufWriter::with_capacity(BUFFER, file);
        // A pipe or a device has no parts.
        let parts = (regular && options.in_parts).then(|| Parts {
            header: header.to_vec(),
            attachments: attachments.to_vec(),
            options: *options,
            first: path.clone(),
            open: create_part,
            number: 1,
            finished: VecDeque::new(),
            finished_bytes: 0,
            removed: 0,
            sets: VecDeque::new(),
        });
        Self::in_part(output, disk, &path, names, header, parts, (attachments, options))
    }

    /// Continues a log whose writer is lost, in a new part. `path` is that of the first part.
    ///
    /// # Errors
    /// [`LogError::Create`] and [`LogError::Write`].
    pub fn resume(
        path: &Path,
        names: &Names,
        header: &[(String, BTreeMap<String, String>)],
        attachments: &[Attachment],
        options: &WriterOptions,
    ) -> Result<Self, LogError> {
        let there = crate::parts::numbered(path);
        let number = there.last().map_or(1, |(number, _)| *number) + 1;
        let finished: VecDeque<_> =
            there.into_iter().map(|(_, path)| (std::fs::metadata(&path).map_or(0, |metadata| metadata.len()), path)).collect();
        let parts = Parts {
            header: header.to_vec(),
            attachments: attachments.to_vec(),
            options: *options,
            first: path.to_owned(),
            open: create_part,
            number,
            finished_bytes: finished.iter().map(|(size, _)| size).sum(),
            removed: (number - 1).saturating_sub(finished.len() as u32),
            finished: finished.into_iter().map(|(size, path)| (path, size)).collect(),
            sets: VecDeque::new(),
        };
        let path = part_path(path, number);
        let (output, disk) = create_part(&path)?;
        Self::in_part(output, disk, &path, names, header, Some(parts), (attachments, options)).inspect_err(|_| {
            // A part without a beginning says nothing.
            let _ = std::fs::remove_file(&path);
        })
    }

    fn in_part(
        output: BufWriter<File>,
        disk: Option<File>,
        path: &Path,
        names: &Names,
        header: &[(String, BTreeMap<String, String>)],
        parts: Option<Parts<BufWriter<File>>>,
        (attachments, options): (&[Attachment], &WriterOptions),
    ) -> Result<Self, LogError> {
        let mut header = header.to_vec();
        if let Some(parts) = &parts {
            number_part(&mut header, parts.number);
        }
        let writer = Self::new(output, path, names, &header, attachments, options)?;
        Ok(Self { parts, disk, ..writer })
    }
}

impl<W: Write> Writer<W> {
    /// Writes to any output, as [`Writer::create`]; errors name it `path`.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn new(
        output: W,
        path: &Path,
        names: &Names,
        header: &[(String, BTreeMap<String, String>)],
        attachments: &[Attachment],
        options: &WriterOptions,
    ) -> Result<Self, LogError> {
        let failed = |error| LogError::write(path, error);
        let part_bytes = Arc::new(AtomicU64::new(0));
        let mut mcap = mcap::WriteOptions::new()
            .compression(Some(mcap::Compression::Lz4))
            .profile("")
            .library(concat!("hapfic ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(options.chunk_bytes.min(MAX_CHUNK_BYTES)))
            // ChunkReader are assembled in memory: otherwise the file would hold an unfinished chunk most of the time.
            .disable_seeking(true)
            .create(NoSeek::new(CountingWriter { inner: output, bytes: Arc::clone(&part_bytes) }))
            .map_err(failed)?;
        let name_record = (Names::METADATA.to_owned(), names.to_metadata());
        for (name, metadata) in header.iter().chain([&name_record]) {
            mcap.write_metadata(&Metadata { name: name.clone(), metadata: metadata.clone() }).map_err(failed)?;
        }
        for attachment in attachments {
            let size = attachment.bytes.len();
            if size > Attachment::LARGEST {
                let what = format!("{} has {size} bytes, expected at most {}", attachment.name, Attachment::LARGEST);
                return Err(LogError::Write { path: path.to_owned(), cause: io::Error::new(io::ErrorKind::InvalidInput, what) });
            }
            mcap.attach(&mcap::Attachment {
                log_time: options.start_unix_ns,
                create_time: options.start_unix_ns,
                name: attachment.name.clone(),
                media_type: attachment.media_type.clone(),
                data: Cow::Borrowed(&attachment.bytes),
            })
            .map_err(failed)?;
        }
        mcap.flush().map_err(failed)?;
        let mut channels = [0; Topic::COUNT];
        for topic in Topic::ALL {
            let schema = mcap.add_schema(topic.schema_name(), "protobuf", &topic.schema()).map_err(failed)?;
            channels[topic.index()] = mcap.add_channel(schema, topic.name(), "protobuf", &BTreeMap::new()).map_err(failed)?;
        }
        Ok(Self {
            mcap,
            path: path.to_owned(),
            disk: None,
            names: names.clone(),
            start_unix_ns: options.start_unix_ns,
            channels,
            messages: [0; Topic::COUNT],
            message_bytes: 0,
            buffer: Vec::with_capacity(4096),
            unflushed: false,
            part_bytes,
            parts: None,
        })
    }

    /// Time of a tick in this log [ns].
    #[must_use]
    pub fn time_of(&self, tick: i64) -> u64 {
        time_of(self.start_unix_ns, tick)
    }

    /// Number of messages written to a topic so far.
    #[must_use]
    pub fn messages(&self, topic: Topic) -> u64 {
        self.messages[topic.index()]
    }

    /// Names in this log.
    #[must_use]
    pub fn names(&self) -> &Names {
        &self.names
    }

    /// Size of all messages written so far, before compression [bytes].
    #[must_use]
    pub fn message_bytes(&self) -> u64 {
        self.message_bytes
    }

    /// Size of all parts written so far [bytes]; number of parts, and of those that were removed again.
    #[must_use]
    pub fn written(&self) -> (u64, [u32; 2]) {
        totals(self.parts.as_ref(), &self.part_bytes)
    }

    /// Number of the present part, and its size so far [bytes].
    #[must_use]
    pub fn part(&self) -> (u32, u64) {
        (self.parts.as_ref().map_or(1, |parts| parts.number), self.part_bytes.load(Ordering::Relaxed))
    }

    /// Closes the chunk and passes it to the operating system: all messages so far survive a killed writer.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn flush(&mut self) -> Result<(), LogError> {
        // Avoids an empty chunk, which is legal but useless.
        if self.unflushed {
            self.mcap.flush().map_err(|error| LogError::write(&self.path, error))?;
            self.unflushed = false;
        }
        Ok(())
    }

    /// Flushes as [`Writer::flush`] and waits for the disk: all messages so far survive a power failure, too.
    ///
    /// A pipe, a device or an output of [`Writer::new`] is only flushed.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn sync(&mut self) -> Result<(), LogError> {
        self.flush()?;
        match self.disk.as_ref().map_or(Ok(()), File::sync_data) {
            // File systems without a disk.
            Err(cause) if matches!(cause.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => Ok(()),
            Err(cause) => Err(LogError::Write { path: self.path.clone(), cause }),
            Ok(()) => Ok(()),
        }
    }

    /// Writes summary and index and closes the log.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn finish(self) -> Result<LogTotals, LogError> {
        let Self { mcap, path, messages, message_bytes, part_bytes, parts, .. } = self;
        close(mcap, &path)?;
        let (file_bytes, parts) = totals(parts.as_ref(), &part_bytes);
        Ok(LogTotals { messages, message_bytes, file_bytes, parts })
    }

    /// Writes a message with its number and times.
    pub(crate) fn put(&mut self, topic: Topic, tick: i64, log_time: u64, message: &impl Message) -> Result<(), LogError> {
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        message
            .encode(&mut buffer)
            .map_err(|error| LogError::Write { path: self.path.clone(), cause: io::Error::other(error) })?;
        // A tick begins with its state.
        let limit = self.parts.as_ref().and_then(|parts| parts.options.part_bytes);
        if topic == Topic::State && limit.is_some_and(|limit| self.part_bytes.load(Ordering::Relaxed) >= limit) {
            self.next_part()?;
        }
        self.write(topic, tick, log_time, &buffer)?;
        if let (Topic::Operator, Some(parts)) = (topic, &mut self.parts) {
            parts.sets.push_back((tick, buffer.clone()));
            if parts.sets.len() > 2 {
                parts.sets.pop_front();
            }
        }
        self.messages[topic.index()] += 1;
        self.message_bytes += buffer.len() as u64;
        self.buffer = buffer;
        Ok(())
    }

    /// Writes an encoded message.
    fn write(&mut self, topic: Topic, tick: i64, log_time: u64, encoded: &[u8]) -> Result<(), LogError> {
        let header = MessageHeader {
            channel_id: self.channels[topic.index()],
            // Cut to 32 bits: wraps after 49 days.
            sequence: tick as u32,
            log_time,
            publish_time: log_time,
        };
        // Set before the write: after a failure a flush must fail, too.
        self.unflushed = true;
        self.mcap.write_to_known_channel(&header, encoded).map_err(|error| LogError::write(&self.path, error))
    }
}

/// Writes summary and index.
fn close<W: Write>(mut mcap: mcap::Writer<NoSeek<CountingWriter<W>>>, path: &Path) -> Result<(), LogError> {
    mcap.finish().map_err(|error| LogError::write(path, error))?;
    let mut output = mcap.into_inner().into_inner();
    output.flush().map_err(|cause| LogError::Write { path: path.to_owned(), cause })
}

impl<W: Write> fmt::Debug for Writer<W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Writer").field("path", &self.path).field("messages", &self.messages).finish_non_exhaustive()
    }
}
