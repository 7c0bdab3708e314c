//! New log with a temporary name until it is complete.

use super::error::RecoverError;
use super::found::Recovery;
use crate::error::LogError;
use crate::topic::Topic;
use crate::writer::WriterOptions;
use mcap::McapError;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Encoding of messages and schemas by the writer.
pub(super) const PROTOBUF: &str = "protobuf";
/// Metadata record with the losses.
const RECOVERY: &str = "recovery";

/// Writer of the new log.
pub(super) struct RecoveryWriter {
    mcap: mcap::Writer<NoSeek<BufWriter<File>>>,
    target: PathBuf,
    /// Declared last: removed after the writer is dropped.
    temporary: Temporary,
}

/// Temporary file, removed on drop unless it is kept.
struct Temporary {
    path: PathBuf,
    kept: bool,
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if !self.kept {
            // A failure here follows an error that is already reported.
            let _ = fs::remove_file(&self.path);
        }
    }
}

impl RecoveryWriter {
    /// Creates the file, in the folder of `target`.
    pub(super) fn create(original: &Path, target: &Path) -> Result<Self, RecoverError> {
        if let (Ok(original), Ok(there)) = (original.canonicalize(), target.canonicalize())
            && original == there
        {
            return Err(RecoverError::SameFile { path: target.to_owned() });
        }
        reject_existing(target)?;
        let failed = |cause| RecoverError::from(LogError::Create { path: target.to_owned(), cause });
        let Some(name) = target.file_name() else {
            return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, "it has no file name")));
        };
        let mut hidden = OsString::from(".");
        hidden.push(name);
        hidden.push(format!(".part-{}", std::process::id()));
        let path = target.with_file_name(hidden);
        let file = File::options().write(true).create_new(true).open(&path).map_err(failed)?;
        let temporary = Temporary { path, kept: false };
        let mcap = mcap::WriteOptions::new()
            .compression(Some(mcap::Compression::Lz4))
            .profile("")
            .library(concat!("hapfic ", env!("CARGO_PKG_VERSION"), " recover"))
            .chunk_size(Some(WriterOptions::default().chunk_bytes))
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::with_capacity(64 * 1024, file)))
            .map_err(|error| failed_write(target, error))?;
        Ok(Self { mcap, target: target.to_owned(), temporary })
    }

    /// Finds or adds a channel with its schema; returns its number.
    pub(super) fn channel(
        &mut self,
        topic: &str,
        encoding: &str,
        metadata: &BTreeMap<String, String>,
        schema: Option<(&str, &str, &[u8])>,
    ) -> Result<u16, RecoverError> {
        let failed = |error| failed_write(&self.target, error);
        let schema = match schema {
            Some((name, encoding, data)) => self.mcap.add_schema(name, encoding, data).map_err(failed)?,
            None => 0,
        };
        self.mcap.add_channel(schema, topic, encoding, metadata).map_err(failed)
    }

    /// Finds or adds the channel of a topic as this program writes it; returns its number.
    pub(super) fn own_channel(&mut self, topic: Topic) -> Result<u16, RecoverError> {
        let schema = topic.schema();
        self.channel(topic.name(), PROTOBUF, &BTreeMap::new(), Some((topic.schema_name(), PROTOBUF, &*schema)))
    }

    pub(super) fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), RecoverError> {
        self.mcap.write_to_known_channel(header, data).map_err(|error| failed_write(&self.target, error))
    }

    pub(super) fn attach(&mut self, attachment: &mcap::Attachment<'_>) -> Result<(), RecoverError> {
        self.mcap.attach(attachment).map_err(|error| failed_write(&self.target, error))
    }

    pub(super) fn metadata(&mut self, metadata: &Metadata) -> Result<(), RecoverError> {
        self.mcap.write_metadata(metadata).map_err(|error| failed_write(&self.target, error))
    }

    /// Writes losses, summary and index, and gives the file its name when all of it is on the disk.
    pub(super) fn finish(mut self, found: &Recovery) -> Result<(), RecoverError> {
        self.metadata(&Metadata { name: RECOVERY.to_owned(), metadata: found.to_metadata() })?;
        let Self { mut mcap, target, mut temporary } = self;
        mcap.finish().map_err(|error| failed_write(&target, error))?;
        let failed = |cause| RecoverError::Write { path: target.clone(), cause };
        let mut buffer = mcap.into_inner().into_inner();
        buffer.flush().map_err(failed)?;
        buffer.get_ref().sync_all().map_err(failed)?;
        // Another process may have created it in the meantime.
        reject_existing(&target)?;
        fs::rename(&temporary.path, &target).map_err(failed)?;
        temporary.kept = true;
        // The name must survive a power failure, too; not every file system supports this.
        let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
        Ok(())
    }
}

fn reject_existing(target: &Path) -> Result<(), RecoverError> {
    match fs::symlink_metadata(target) {
        Ok(_) => Err(RecoverError::Exists { path: target.to_owned() }),
        Err(_) => Ok(()),
    }
}

/// Converts a write error of the MCAP encoder.
fn failed_write(target: &Path, error: McapError) -> RecoverError {
    let cause = match error {
        McapError::Io(cause) => cause,
        other => io::Error::other(other.to_string()),
    };
    RecoverError::Write { path: target.to_owned(), cause }
}
