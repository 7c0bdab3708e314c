//! The process of the recorder: joins a run, begins or continues the log, and leaves its result in the run's folder.

use super::RecordingOutcome;
use super::disk::Disk;
use super::drain::{DrainStart, DrainThread};
use super::incident::PostMortem;
use super::viewer_frames::ViewerFrames;
use super::write::{WriterOrder, WriterThread};
use anyhow::{Context, Result};
use hapfic_config::Settings;
use hapfic_ipc::{Domain, LogPosition, Ownership, ProcessStart, RecorderPage, RunFile, SharedStatus, realtime};
use hapfic_log::{LogFile, Metrics, Remainder, RunLog, Viewer, scene};
use hapfic_messages::Clock;
use hapfic_plant::Plant;
use hapfic_simulation::conditions::{TaskFollower, TaskWatch};
use std::fs::File;
use std::os::fd::AsFd;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

/// Batches in flight to the writer: in realtime of 10 ms each, in lockstep of up to 100 ticks.
///
/// A disk that stalls for longer stalls the draining too. In lockstep the plant then waits for its credit; in realtime
/// ticks are lost, and counted.
const QUEUE_REALTIME: usize = 512;
const QUEUE_LOCKSTEP: usize = 64;
/// Empty batches kept for reuse.
const EMPTY_BATCHES: usize = 4;

/// Records a run until its end is ordered. Standard input is the created log; a successor of a recorder that has begun it
/// continues it in a new part.
///
/// # Errors
/// If the run cannot be joined, or its messages cannot be received. An error of the log is in the result instead.
pub fn run(run: &RunFile, settings: &Settings, start: ProcessStart) -> Result<()> {
    realtime::give_up_privileges();
    rustix::thread::set_name(c"hapfic-recorder").context("cannot set the process's name")?;
    let owner = Ownership::join(run, settings.supervisor.grace_ms)?;
    hapfic_ipc::service::silence_transport_log();
    let root = Path::new(&run.root);
    let page = Arc::new(RecorderPage::open(&run.root)?);
    let outcome = record(run, settings, start.generation, &page, owner)?;
    if outcome.error.is_some() {
        page.set_log_failed();
    }
    outcome.write(root, start.generation).context("cannot leave the recorder's result")
}

fn record(
    run: &RunFile,
    settings: &Settings,
    generation: u32,
    page: &Arc<RecorderPage>,
    owner: Ownership,
) -> Result<RecordingOutcome> {
    let plant = Plant::new(settings)?;
    let log = RunLog {
        path: &run.log,
        scenario: &run.scenario,
        settings,
        clock: run.clock,
        chain: plant.chain(),
        body_names: plant.body_names(),
        start_unix_ns: run.start_unix_ns,
    };
    let domain = Domain::new(&run.prefix, &run.root)?.with_short_timeouts(run.clock);
    let (sender, receiver) = sync_channel::<WriterOrder>(match run.clock {
        Clock::Lockstep => QUEUE_LOCKSTEP,
        Clock::Realtime => QUEUE_REALTIME,
    });
    let (recycle, empty_batches) = sync_channel(EMPTY_BATCHES);
    let status = Arc::new(SharedStatus::open(&run.root)?);
    let mut drain = DrainThread::open(DrainStart {
        domain: &domain,
        clock: run.clock,
        generation,
        credit_ticks: settings.supervisor.credit_ticks,
        owner,
        page: Arc::clone(page),
        status: Arc::clone(&status),
        sender,
        empty_batches,
    })?;
    let flushed = page.flushed();
    let writer = if flushed.part == 0 {
        let file = std::io::stdin().as_fd().try_clone_to_owned().context("cannot take over the log")?;
        LogFile::of_handle(&run.log, File::from(file)).and_then(|file| hapfic_log::begin_run_log(&log, file))
    } else {
        close_last_part(run, &flushed);
        hapfic_log::resume_run_log(&log)
    };
    let writer = match writer {
        Ok(writer) => writer,
        Err(e) => return Ok(RecordingOutcome { error: Some(e.to_string()), ..RecordingOutcome::default() }),
    };
    let viewer_rate_hz = settings.recorder.viewer_rate_hz.round() as u32;
    let thread = WriterThread {
        writer,
        viewer: Viewer::new(scene::scene(settings, plant.chain()), viewer_rate_hz, run.start_unix_ns),
        chain: plant.chain().clone(),
        tasks: TaskFollower::new(TaskWatch::new(settings, plant.chain().clone())),
        page: Arc::clone(page),
        status,
        root: Path::new(&run.root).to_owned(),
        metrics: Metrics::new(),
        frames: ViewerFrames::default(),
        active: false,
        timing_log_ns: 0,
        incidents: PostMortem::new(&run.log, run.clock, generation > 0),
        disk: Disk::new(&run.log, u64::from(settings.recorder.min_free_mb) * 1_000_000),
        position: flushed,
        flushed,
        flushed_at: Instant::now(),
        told: (Vec::new(), Instant::now()),
    };
    let flush_every = Duration::from_millis(settings.recorder.flush_ms.into());
    let write = std::thread::Builder::new()
        .name("hapfic-writer".to_owned())
        .spawn(move || thread.run(&receiver, &recycle, flush_every))
        .context("cannot start the writer")?;
    let drained = drain.take_journal().and_then(|()| drain.run());
    // Closes the channel.
    drop(drain);
    let mut outcome = write.join().map_err(|_| anyhow::anyhow!("the writer's thread panicked"))?;
    if let Err(e) = drained {
        outcome.error.get_or_insert(e.to_string());
    }
    Ok(outcome)
}

/// Ends the part of a lost recorder, so that every reader takes it for whole. In lockstep the successor writes again what
/// was not flushed; in realtime the part keeps all that has reached the file.
fn close_last_part(run: &RunFile, flushed: &LogPosition) {
    let remainder = if run.clock == Clock::Lockstep { Remainder::Removed } else { Remainder::Kept };
    if let Err(e) = hapfic_log::close_last_part(&run.log, flushed.part, flushed.bytes, remainder) {
        crate::log_line(&format!("hapfic: the part of the lost recorder keeps its cut-off end: {e}. Hint: `hapfic recover`"));
    }
}
