//! Start of a run's log: names, header and attachments from the scenario.

use crate::error::LogError;
use crate::{Attachment, LogFile, Names, Writer, WriterOptions};
use hapfic_config::{PERIOD_S, Settings};
use hapfic_messages::Clock;
use hapfic_robot::Chain;
use std::collections::BTreeMap;
use std::os::unix::fs::FileTypeExt;
use std::path::Path;

/// Start of a run's log.
#[derive(Clone, Copy, Debug)]
pub struct RunLog<'a> {
    /// Path of the log; its folder is created if necessary.
    pub path: &'a Path,
    /// Name of the scenario.
    pub scenario: &'a str,
    /// The checked scenario.
    pub settings: &'a Settings,
    /// Clock of the run.
    pub clock: Clock,
    /// The robot.
    pub chain: &'a Chain,
    /// Names of the plant's bodies, by index.
    pub body_names: &'a [String],
    /// Time of tick 0 [ns since the Unix epoch]; zero in lockstep.
    pub start_unix_ns: u64,
}

impl Names {
    /// Collects the names of a run.
    #[must_use]
    pub fn new(settings: &Settings, chain: &Chain, body_names: &[String]) -> Self {
        Self {
            joints: chain.joints().iter().map(|j| j.name.clone()).collect(),
            bodies: body_names.to_vec(),
            objects: settings.world.objects.iter().map(|object| object.name.clone()).collect(),
        }
    }
}

/// Creates the log of a run and writes its header and attachments.
///
/// # Errors
/// [`LogError`] if the file or its folder cannot be created.
pub fn create_run_log(run: &RunLog<'_>) -> Result<Writer, LogError> {
    create_folder(run.path)?;
    let Beginning { names, header, attachments, options } = Beginning::new(run);
    Writer::create(run.path, &names, &header, &attachments, &options)
}

/// Creates the log of a run for a process that will write it by [`begin_run_log`]. The beginning is written once and
/// removed again, so that a disk that takes nothing is found now; a pipe is only opened.
///
/// # Errors
/// As [`create_run_log`].
pub fn reserve_run_log(run: &RunLog<'_>) -> Result<LogFile, LogError> {
    create_folder(run.path)?;
    let Beginning { names, header, attachments, options } = Beginning::in_parts(run);
    let mut log = LogFile::create(run.path, true)?;
    let failed = |cause| LogError::Write { path: run.path.to_owned(), cause };
    let file_type = std::fs::metadata(run.path).map_err(failed)?.file_type();
    if !file_type.is_fifo() {
        drop(Writer::new(log.handle()?, run.path, &names, &header, &attachments, &options)?);
    }
    log.empty()?;
    Ok(log)
}

/// Writes header and attachments of a run's log into its reserved file.
///
/// # Errors
/// [`LogError::Write`].
pub fn begin_run_log(run: &RunLog<'_>, log: LogFile) -> Result<Writer, LogError> {
    let Beginning { names, header, attachments, options } = Beginning::in_parts(run);
    Writer::begin(log, &names, &header, &attachments, &options)
}

/// Continues a run's log, whose writer is lost, in its next part.
///
/// # Errors
/// [`LogError::Create`] and [`LogError::Write`].
pub fn resume_run_log(run: &RunLog<'_>) -> Result<Writer, LogError> {
    let Beginning { names, header, attachments, options } = Beginning::in_parts(run);
    Writer::resume(run.path, &names, &header, &attachments, &options)
}

fn create_folder(log: &Path) -> Result<(), LogError> {
    match log.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        Some(folder) => std::fs::create_dir_all(folder).map_err(|cause| LogError::Folder { path: folder.to_owned(), cause }),
        None => Ok(()),
    }
}

/// What every part of a run's log begins with.
struct Beginning {
    names: Names,
    header: Vec<(String, BTreeMap<String, String>)>,
    attachments: [Attachment; 2],
    options: WriterOptions,
}

impl Beginning {
    fn new(run: &RunLog<'_>) -> Self {
        let settings = run.settings;
        let pairs = [
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("scenario", run.scenario.to_owned()),
            ("title", settings.title.clone()),
            ("clock", run.clock.name().to_owned()),
            ("seed", settings.seed.to_string()),
            ("period_s", PERIOD_S.to_string()),
            ("duration_ticks", settings.duration_ticks.to_string()),
            ("start_unix_ns", run.start_unix_ns.to_string()),
        ];
        let attachments = [
            Attachment {
                name: "scenario.toml".to_owned(),
                media_type: "application/toml".to_owned(),
                bytes: settings.effective_toml().into_bytes(),
            },
            Attachment {
                name: "robot.urdf".to_owned(),
                media_type: "application/xml".to_owned(),
                bytes: settings.robot.urdf.text.clone().into_bytes(),
            },
        ];
        let bytes = |megabytes: Option<u32>| megabytes.map(|megabytes| u64::from(megabytes) * 1_000_000);
        Self {
            names: Names::new(settings, run.chain, run.body_names),
            header: vec![("hapfic".to_owned(), pairs.into_iter().map(|(k, v)| (k.to_owned(), v)).collect())],
            attachments,
            options: WriterOptions {
                start_unix_ns: run.start_unix_ns,
                chunk_bytes: u64::from(settings.recorder.chunk_kib) * 1024,
                in_parts: settings.recorder.part_mb.is_some(),
                part_bytes: bytes(settings.recorder.part_mb),
                keep_bytes: bytes(settings.recorder.keep_mb),
            },
        }
    }

    /// The beginning of a log that another recorder may have to continue.
    fn in_parts(run: &RunLog<'_>) -> Self {
        let beginning = Self::new(run);
        Self { options: WriterOptions { in_parts: true, ..beginning.options }, ..beginning }
    }
}
