//! Writer of a log.

mod counting;

use crate::attachment::Attachment;
use crate::error::LogError;
use crate::names::Names;
use crate::parts::{PART, RUN};
use crate::time_of;
use crate::topic::Topic;
use counting::CountingWriter;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use prost::Message;
use std::borrow::Cow;
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::fs::{File, TryLockError};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Largest chunk [bytes]: its buffer is allocated as a whole.
const MAX_CHUNK_BYTES: u64 = 16 << 20;

/// Options of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriterOptions {
    /// Time of tick 0 [ns since the Unix epoch]. Zero in lockstep, so that a log is a function of scenario and seed.
    pub start_unix_ns: u64,
    /// Uncompressed size at which a chunk is closed, at most 16 MiB [bytes]. A larger chunk compresses better, but a
    /// killed writer loses more.
    pub chunk_bytes: u64,
    /// Size of the file from which on the next state begins a new part [bytes]; `None`: the log is one file.
    pub part_bytes: Option<u64>,
    /// Size of all parts above which the oldest but the first are removed [bytes].
    pub keep_bytes: Option<u64>,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self { start_unix_ns: 0, chunk_bytes: 256 * 1024, part_bytes: None, keep_bytes: None }
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

/// Output, and a second handle of a regular file.
type OpenFile<W> = (W, Option<File>);

/// What the next part of a log needs.
struct Parts<W: Write> {
    header: Vec<(String, BTreeMap<String, String>)>,
    attachments: Vec<Attachment>,
    options: WriterOptions,
    first: PathBuf,
    /// Opens the file of a part.
    open: fn(&Path) -> Result<OpenFile<W>, LogError>,
    /// Number of the present part.
    number: u32,
    /// Finished parts that are there: path and size [bytes].
    finished: VecDeque<(PathBuf, u64)>,
    finished_bytes: u64,
    removed: u32,
    /// The last two parameter sets, with their ticks: every part begins with those that may be in force.
    sets: VecDeque<(i64, Vec<u8>)>,
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
        let path = path.as_ref();
        // Before anything is touched: all that the new log may replace has to be a log.
        let stale = if options.part_bytes.is_some() { crate::parts::replaceable(path)? } else { Vec::new() };
        let (output, disk) = create_file(path)?;
        for stale in stale {
            std::fs::remove_file(&stale).map_err(|cause| LogError::Create { path: stale, cause })?;
        }
        let mut header = header.to_vec();
        if options.part_bytes.is_some() && disk.is_some() {
            number_part(&mut header, 1);
        }
        let header = header.as_slice();
        let mut writer = Self::new(output, path, names, header, attachments, options)?;
        // A pipe or a device has no parts.
        if options.part_bytes.is_some() && disk.is_some() {
            writer.parts = Some(Parts {
                header: header.to_vec(),
                attachments: attachments.to_vec(),
                options: *options,
                first: path.to_owned(),
                open: create_file,
                number: 1,
                finished: VecDeque::new(),
                finished_bytes: 0,
                removed: 0,
                sets: VecDeque::new(),
            });
        }
        writer.disk = disk;
        Ok(writer)
    }
}

/// Writes the number of a part into the record of the run.
fn number_part(header: &mut Vec<(String, BTreeMap<String, String>)>, number: u32) {
    let pair = (PART.to_owned(), number.to_string());
    match header.iter_mut().find(|(name, _)| name == RUN) {
        Some((_, record)) => {
            record.insert(pair.0, pair.1);
        }
        None => header.push((RUN.to_owned(), BTreeMap::from([pair]))),
    }
}

/// Creates or empties a file, and locks it.
fn create_file(path: &Path) -> Result<OpenFile<BufWriter<File>>, LogError> {
    let failed = |cause| LogError::Create { path: path.to_owned(), cause };
    // Truncated only with the lock: another run may be writing the file.
    let file = open_for_writing(path).map_err(failed)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Err(LogError::Busy { path: path.to_owned() }),
        Err(TryLockError::Error(cause)) => return Err(failed(cause)),
    }
    let mut disk = None;
    if file.metadata().map_err(failed)?.is_file() {
        file.set_len(0).map_err(failed)?;
        disk = Some(file.try_clone().map_err(failed)?);
    }
    Ok((BufWriter::with_capacity(64 * 1024, file), disk))
}

/// Time that a pipe may stay without a reader.
const READER_TIMEOUT: Duration = Duration::from_secs(5);
/// Interval at which a reader is looked for.
const READER_POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Opens a file, or a pipe that has a reader; never blocks for longer than [`READER_TIMEOUT`].
fn open_for_writing(path: &Path) -> io::Result<File> {
    let is_pipe = std::fs::metadata(path).is_ok_and(|metadata| metadata.file_type().is_fifo());
    if !is_pipe {
        return File::options().write(true).create(true).truncate(false).open(path);
    }
    let begun = Instant::now();
    loop {
        // Without a reader this open fails, where another would block.
        match File::options().write(true).custom_flags(O_NONBLOCK).open(path) {
            Ok(_nonblocking) => return File::options().write(true).open(path),
            Err(e) if e.raw_os_error() == Some(ENXIO) && begun.elapsed() < READER_TIMEOUT => {
                std::thread::sleep(READER_POLL_INTERVAL);
            }
            Err(e) if e.raw_os_error() == Some(ENXIO) => {
                return Err(io::Error::other("it is a pipe, and no program has opened it for reading within 5 s"));
            }
            Err(e) => return Err(e),
        }
    }
}

/// `O_NONBLOCK` and `ENXIO` of Linux.
const O_NONBLOCK: i32 = 0o4000;
const ENXIO: i32 = 6;

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

    /// Finishes the present part and begins the next, with the parameter sets that may be in force.
    fn next_part(&mut self) -> Result<(), LogError> {
        let Some(mut parts) = self.parts.take() else { return Ok(()) };
        let done = self.roll(&mut parts);
        // Also after an error: the totals count what was written.
        self.parts = Some(parts);
        done
    }

    fn roll(&mut self, parts: &mut Parts<W>) -> Result<(), LogError> {
        let path = crate::parts::part_path(&parts.first, parts.number + 1);
        let mut header = parts.header.clone();
        number_part(&mut header, parts.number + 1);
        let (output, disk) = (parts.open)(&path)?;
        let next = Self::new(output, &path, &self.names, &header, &parts.attachments, &parts.options).inspect_err(|_| {
            // A part without a beginning says nothing.
            let _ = std::fs::remove_file(&path);
        })?;
        parts.number += 1;
        let Self { mcap, path: finished, part_bytes, .. } =
            std::mem::replace(self, Self { disk, messages: self.messages, message_bytes: self.message_bytes, ..next });
        close(mcap, &finished)?;
        let size = part_bytes.load(Ordering::Relaxed);
        parts.finished.push_back((finished, size));
        parts.finished_bytes += size;
        for (tick, set) in &parts.sets {
            let at = self.time_of(*tick);
            self.write(Topic::Operator, *tick, at, set)?;
        }
        if let Some(keep) = parts.options.keep_bytes {
            let mut there: u64 = parts.finished.iter().map(|(_, size)| size).sum();
            // The first part is the start of the run, and stays.
            while there + parts.options.part_bytes.unwrap_or(0) > keep && parts.finished.len() > 1 {
                let Some((old, size)) = parts.finished.remove(1) else { break };
                match std::fs::remove_file(&old) {
                    Err(cause) if cause.kind() != io::ErrorKind::NotFound => return Err(LogError::Write { path: old, cause }),
                    _ => {}
                }
                there -= size;
                parts.removed += 1;
            }
        }
        Ok(())
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

fn totals<W: Write>(parts: Option<&Parts<W>>, part_bytes: &AtomicU64) -> (u64, [u32; 2]) {
    let (before, counts) = parts.map_or((0, [1, 0]), |parts| (parts.finished_bytes, [parts.number, parts.removed]));
    (before + part_bytes.load(Ordering::Relaxed), counts)
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
