//! Start of a run's log: names, header and attachments from the scenario.

use crate::error::LogError;
use crate::{Attachment, Names, Writer, WriterOptions};
use hapfic_config::{PERIOD_S, Settings};
use hapfic_messages::Clock;
use hapfic_robot::Chain;
use std::collections::BTreeMap;
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
    if let Some(folder) = run.path.parent()
        && !folder.as_os_str().is_empty()
    {
        std::fs::create_dir_all(folder).map_err(|cause| LogError::Folder { path: folder.to_owned(), cause })?;
    }
    let settings = run.settings;
    let names = Names::new(settings, run.chain, run.body_names);
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
    let header: BTreeMap<_, _> = pairs.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
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
    let options = WriterOptions {
        start_unix_ns: run.start_unix_ns,
        chunk_bytes: u64::from(settings.recorder.chunk_kib) * 1024,
        part_bytes: bytes(settings.recorder.part_mb),
        keep_bytes: bytes(settings.recorder.keep_mb),
    };
    Writer::create(run.path, &names, &[("hapfic".to_owned(), header)], &attachments, &options)
}
