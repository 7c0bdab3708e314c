//! Where a run lives: a prefix and a folder of its own in shared memory, and a registration that others can find.
//!
//! The registration is locked as long as its supervisor lives; one that can be locked by somebody else belongs to a dead run,
//! whose remains are then removed.

use anyhow::{Context, Result};
use hapfic_ipc::Domain;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{FlockOperation, flock};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use serde::{Deserialize, Serialize};
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How long a killed process may take to end.
const END_PATIENCE_NS: u64 = 1_000_000_000;
/// Where POSIX shared memory is.
const SHM: &str = "/dev/shm";
/// How long a lock may outlive its supervisor, and how often it is looked at.
const LOCK_PATIENCE: Duration = Duration::from_secs(1);
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// What others may know of a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Registration {
    /// Name of the run: prefix of its shared memory without the trailing `_`.
    pub run: String,
    /// Process id of its supervisor.
    pub pid: u32,
    /// Name of the scenario.
    pub scenario: String,
    /// The log it writes, from the root.
    pub log: PathBuf,
}

impl Registration {
    /// The run's corner of the machine.
    ///
    /// # Errors
    /// If its name is none that a run can have.
    pub fn domain(&self) -> Result<Domain> {
        Ok(Domain::new(&format!("{}_", self.run), &format!("{SHM}/{}", self.run))?)
    }
}

/// All runs of this user that are alive, by name.
///
/// # Errors
/// If the place where they are registered, or a registration, cannot be read.
pub fn running() -> Result<Vec<Registration>> {
    let folder = folder_path();
    if !is_ours(&folder)? {
        return Ok(Vec::new());
    }
    let _turn = Turn::take(&folder)?;
    let entries =
        fs::read_dir(&folder).with_context(|| format!("cannot read {}, where runs are registered", folder.display()))?;
    let mut runs = Vec::new();
    for path in entries.flatten().map(|e| e.path()) {
        if !is_alive(&path) {
            continue;
        }
        match fs::read_to_string(&path).map_err(anyhow::Error::from).and_then(|t| Ok(serde_json::from_str::<Registration>(&t)?)) {
            Ok(run) => runs.push(run),
            // It is no reason not to reach the others.
            Err(e) => crate::say(&format!(
                "hapfic: {}: cannot read this registration of a run ({e:#}); is it of another version of hapfic?",
                path.display()
            )),
        }
    }
    runs.sort_by(|a, b| a.run.cmp(&b.run));
    Ok(runs)
}

/// Does something while a run cannot end, so that nothing made meanwhile in its corner outlives it; `None` if it has ended.
///
/// # Errors
/// If the place where runs are registered cannot be locked.
pub fn while_alive<T>(run: &str, act: impl FnOnce() -> T) -> Result<Option<T>> {
    let folder = folder_path();
    if !is_ours(&folder)? {
        return Ok(None);
    }
    let _turn = Turn::take(&folder)?;
    Ok(is_alive(&folder.join(format!("{run}.json"))).then(act))
}

/// Whether a registration's supervisor lives: it holds the lock. To be called in turn.
fn is_alive(path: &Path) -> bool {
    File::open(path).is_ok_and(|file| flock(&file, FlockOperation::NonBlockingLockExclusive).is_err())
}

/// A run's place; removed with everything in it when dropped.
#[derive(Debug)]
pub struct RunDirectory {
    run: String,
    file: PathBuf,
    others: usize,
    orphaned_logs: Vec<PathBuf>,
    // Holds the lock.
    _registration: File,
}

impl RunDirectory {
    /// Makes a place that no other run has, and registers it.
    ///
    /// # Errors
    /// If shared memory or the user's run-time directory cannot be written.
    pub fn take(scenario: &str, log: &Path) -> Result<Self> {
        let folder = runtime_folder()?;
        // One start or end at a time, so that none takes another's half-made registration for a dead run's.
        let turn = Turn::take(&folder)?;
        let (others, orphaned_logs) = clean_up(&folder);
        let mut salt = hapfic_ipc::clock::unix_ns();
        loop {
            // Short: a Unix socket's path has 108 bytes, and iceoryx2 needs most of them.
            let run = format!("hf{}{}", base36(u64::from(std::process::id())), base36(salt % 46_656));
            let file = folder.join(format!("{run}.json"));
            let made = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&file);
            let registration = match made {
                Ok(registration) => registration,
                Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {
                    salt += 1;
                    continue;
                }
                Err(e) => return Err(e).with_context(|| format!("cannot register the run in {}", file.display())),
            };
            flock(&registration, FlockOperation::NonBlockingLockExclusive).context("cannot lock the run's registration")?;
            let content = Registration {
                run: run.clone(),
                pid: std::process::id(),
                scenario: scenario.to_owned(),
                // Whoever asks may be elsewhere.
                log: std::path::absolute(log).unwrap_or_else(|_| log.to_owned()),
            };
            let place = Self { run, file, others, orphaned_logs, _registration: registration };
            let furnished = place.furnish(&content);
            // A place that is dropped asks for the turn itself.
            drop(turn);
            return furnished.map(|()| place);
        }
    }

    fn furnish(&self, content: &Registration) -> Result<()> {
        serde_json::to_writer_pretty(&self._registration, content).context("cannot write the run's registration")?;
        DirBuilder::new()
            .mode(0o700)
            .create(self.root())
            .with_context(|| format!("cannot make {}, the run's folder in shared memory", self.root()))
    }

    /// Prefix of the run's shared memory.
    #[must_use]
    pub fn prefix(&self) -> String {
        format!("{}_", self.run)
    }

    /// Logs of runs whose remains were removed when this one registered: their supervisors were killed.
    #[must_use]
    pub fn orphaned_logs(&self) -> &[PathBuf] {
        &self.orphaned_logs
    }

    /// Puts a copy that only this user may open in place of iceoryx2's counter of nodes, which is made with mode 0666: whoever
    /// else opened the first one then has nothing. To be called when the first node is there, before any other.
    ///
    /// # Errors
    /// If it cannot be replaced.
    pub fn close_to_others(&self) -> Result<()> {
        let problem = || format!("cannot close {SHM}/{}* to other users", self.prefix());
        for entry in fs::read_dir(SHM).with_context(problem)?.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.starts_with(&self.prefix()) && name.ends_with(".global_mgmt") {
                let bytes = fs::read(entry.path()).with_context(problem)?;
                let copy = format!("{SHM}/{}closed", self.prefix());
                let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&copy).with_context(problem)?;
                file.write_all(&bytes).with_context(problem)?;
                fs::rename(&copy, entry.path()).with_context(problem)?;
            }
        }
        Ok(())
    }

    /// Runs that were alive on this machine when this one registered.
    #[must_use]
    pub fn others(&self) -> usize {
        self.others
    }

    /// The run's folder.
    #[must_use]
    pub fn root(&self) -> String {
        format!("{SHM}/{}", self.run)
    }
}

impl Drop for RunDirectory {
    fn drop(&mut self) {
        let Some(folder) = self.file.parent() else { return };
        // In turn: whoever is about to ask this run something must not make anything here after it has been removed. Without its
        // turn it can still remove its own, but not the folder that others may be about to use.
        let turn = Turn::take(folder);
        remove_remains(&self.run);
        // Last: as long as it is there, the next start knows that something may be left.
        let _ = fs::remove_file(&self.file);
        if turn.is_ok() {
            // Only if no other run is registered.
            let _ = fs::remove_dir(folder);
        }
    }
}

/// The right to change what is registered; ends when dropped.
struct Turn(#[allow(dead_code)] File);

impl Turn {
    fn take(folder: &Path) -> Result<Self> {
        use std::os::unix::fs::MetadataExt;
        let problem = || format!("cannot lock {}, where runs are registered", folder.display());
        loop {
            let handle = match File::open(folder) {
                Ok(handle) => handle,
                // Another run has just removed it.
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                    // Made anew, unless the user's own folder has gone away altogether, as at the end of a session.
                    if runtime_folder()? != folder {
                        return Err(e).with_context(problem);
                    }
                    continue;
                }
                Err(e) => return Err(e).with_context(problem),
            };
            flock(&handle, FlockOperation::LockExclusive).with_context(problem)?;
            // While this one waited, the folder may have been removed and made anew.
            let same = |a: &fs::Metadata, b: &fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
            if let (Ok(ours), Ok(now)) = (handle.metadata(), fs::metadata(folder))
                && same(&ours, &now)
            {
                return Ok(Self(handle));
            }
        }
    }
}

/// Where the user's run-time directory for runs is.
fn folder_path() -> PathBuf {
    match std::env::var_os("XDG_RUNTIME_DIR") {
        // Set, but not there: as after `su`.
        Some(dir) if Path::new(&dir).is_dir() => PathBuf::from(dir).join("hapfic"),
        _ => std::env::temp_dir().join(format!("hapfic-{}", rustix::process::getuid().as_raw())),
    }
}

/// The user's run-time directory for runs; made if it is not there.
fn runtime_folder() -> Result<PathBuf> {
    let folder = folder_path();
    match DirBuilder::new().mode(0o700).create(&folder) {
        Ok(()) => Ok(folder),
        Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {
            anyhow::ensure!(is_ours(&folder)?, "{} has just been removed; try again", folder.display());
            Ok(folder)
        }
        Err(e) => Err(e).with_context(|| format!("cannot make {}, where runs are registered", folder.display())),
    }
}

/// Whether the folder where runs are registered is there. Not one that somebody else has put there, or may write to.
fn is_ours(folder: &Path) -> Result<bool> {
    use std::os::unix::fs::MetadataExt;
    let found = match fs::symlink_metadata(folder) {
        Ok(found) => found,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(false),
        Err(e) => {
            return Err(e).with_context(|| {
                format!(
                    "cannot look at {}, where runs are registered; set XDG_RUNTIME_DIR to a folder of your own",
                    folder.display()
                )
            });
        }
    };
    let own = rustix::process::getuid().as_raw();
    anyhow::ensure!(
        found.is_dir() && found.uid() == own && found.mode() & 0o022 == 0,
        "{} belongs to user {} with mode {:o}, expected a folder of user {own} that nobody else may write; set XDG_RUNTIME_DIR to a \
         folder of your own",
        folder.display(),
        found.uid(),
        found.mode() & 0o7777
    );
    Ok(true)
}

/// Removes what dead runs have left. Returns how many are alive, and the logs of the dead.
fn clean_up(folder: &Path) -> (usize, Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else { return (0, Vec::new()) };
    let (mut alive, mut logs) = (0, Vec::new());
    for path in entries.flatten().map(|e| e.path()) {
        let Ok(file) = File::open(&path) else { continue };
        if is_held(&file, &path) {
            alive += 1;
            continue;
        }
        let run = path.file_stem().and_then(|s| s.to_str()).unwrap_or_default();
        if run.starts_with("hf") && run.len() > 4 && run.chars().all(|c| c.is_ascii_alphanumeric()) {
            remove_remains(run);
            // A registration that was cut off by the death of its run names no log.
            let registered = fs::read(&path).ok().and_then(|text| serde_json::from_slice::<Registration>(&text).ok());
            logs.extend(registered.map(|registration| registration.log));
            let _ = fs::remove_file(&path);
        }
    }
    (alive, logs)
}

/// Whether somebody alive holds the lock of a registration. A supervisor that was killed in the middle of starting a process leaves the lock to that
/// process until it becomes another program or ends, which is soon.
fn is_held(file: &File, path: &Path) -> bool {
    let begun = Instant::now();
    while flock(file, FlockOperation::NonBlockingLockExclusive).is_err() {
        let registered = fs::read(path).ok().and_then(|text| serde_json::from_slice::<Registration>(&text).ok());
        if registered.is_some_and(|registration| lives(registration.pid)) || begun.elapsed() > LOCK_PATIENCE {
            return true;
        }
        std::thread::sleep(POLL_INTERVAL);
    }
    false
}

/// Whether there is such a process, and not only what is left of it for its parent.
fn lives(pid: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit_once(") ").is_some_and(|(_, rest)| !rest.starts_with(['Z', 'X']))
}

fn remove_remains(run: &str) {
    end_processes(run);
    let _ = fs::remove_dir_all(format!("{SHM}/{run}"));
    let prefix = format!("{run}_");
    let Ok(entries) = fs::read_dir(SHM) else { return };
    for entry in entries.flatten() {
        if entry.file_name().to_string_lossy().starts_with(&prefix) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Ends what still runs of a run whose supervisor is gone: it should have ended by itself, unless it was stopped.
fn end_processes(run: &str) {
    let mark = format!("{}={SHM}/{run}/", hapfic_ipc::RunFile::VARIABLE);
    let Ok(entries) = fs::read_dir("/proc") else { return };
    let mut ended = Vec::new();
    for entry in entries.flatten() {
        let Some(pid) = entry.file_name().to_str().and_then(|n| n.parse().ok()).and_then(Pid::from_raw) else { continue };
        // Opened first: what is read after is then of the same process.
        let Ok(handle) = pidfd_open(pid, PidfdFlags::empty()) else { continue };
        let environment = fs::read(entry.path().join("environ")).unwrap_or_default();
        if environment.split(|b| *b == 0).any(|v| v.starts_with(mark.as_bytes())) {
            let _ = pidfd_send_signal(&handle, Signal::KILL);
            ended.push(handle);
        }
    }
    // One that is in the middle of a system call may still make a file.
    for handle in &ended {
        let _ = poll(&mut [PollFd::new(handle, PollFlags::IN)], Some(&hapfic_ipc::clock::timespec(END_PATIENCE_NS)));
    }
}

fn base36(mut value: u64) -> String {
    let mut digits = Vec::new();
    while value > 0 || digits.is_empty() {
        digits.push(char::from_digit((value % 36) as u32, 36).unwrap_or('0'));
        value /= 36;
    }
    digits.iter().rev().collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn places_are_unique_and_leave_nothing() {
        let (a, b) = (RunDirectory::take("floor", Path::new("a")).unwrap(), RunDirectory::take("floor", Path::new("b")).unwrap());
        assert_ne!(a.prefix(), b.prefix());
        let (root, file) = (a.root(), a.file.clone());
        assert!(Path::new(&root).is_dir() && file.is_file());
        fs::write(format!("{SHM}/{}remains", a.prefix()), "x").unwrap();
        // A third start must not take a living run for a dead one.
        let c = RunDirectory::take("floor", Path::new("c")).unwrap();
        assert!(Path::new(&root).is_dir());
        drop((a, c));
        assert!(!Path::new(&root).exists() && !file.exists());
        assert!(!fs::read_dir(SHM).unwrap().flatten().any(|e| e.file_name().to_string_lossy().ends_with("remains")));
        drop(b);
    }

    #[test]
    fn what_a_dead_run_left_is_swept_at_the_next_start() {
        let folder = runtime_folder().unwrap();
        // As if its supervisor had been killed: registered, and nobody holds the lock.
        let run = format!("hfdead{}", base36(u64::from(std::process::id())));
        fs::write(folder.join(format!("{run}.json")), "{}").unwrap();
        fs::create_dir(format!("{SHM}/{run}")).unwrap();
        fs::write(format!("{SHM}/{run}_segment"), "x").unwrap();
        let place = RunDirectory::take("floor", Path::new("a")).unwrap();
        assert!(!Path::new(&format!("{SHM}/{run}")).exists());
        assert!(!Path::new(&format!("{SHM}/{run}_segment")).exists());
        drop(place);
    }

    #[test]
    fn a_lock_that_outlives_its_supervisor_is_waited_for_and_that_of_the_living_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hfx.json");
        let register = |pid: u32| {
            let content = Registration { run: "hfx".to_owned(), pid, scenario: "floor".to_owned(), log: PathBuf::from("a") };
            fs::write(&path, serde_json::to_string(&content).unwrap()).unwrap();
        };
        let mut dead = std::process::Command::new("true").spawn().unwrap();
        let pid = dead.id();
        dead.wait().unwrap();
        register(pid);
        let held = File::open(&path).unwrap();
        flock(&held, FlockOperation::NonBlockingLockExclusive).unwrap();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                std::thread::sleep(Duration::from_millis(30));
                drop(held);
            });
            assert!(!is_held(&File::open(&path).unwrap(), &path));
        });
        register(std::process::id());
        let held = File::open(&path).unwrap();
        flock(&held, FlockOperation::NonBlockingLockExclusive).unwrap();
        assert!(is_held(&File::open(&path).unwrap(), &path));
    }

    #[test]
    fn base36_counts() {
        assert_eq!((base36(0), base36(35), base36(36)), ("0".into(), "z".into(), "10".into()));
    }
}
