//! Namespace of a run: its prefix and folder in shared memory, and the registration by which other commands find it.
//!
//! The supervisor holds a lock on the registration while it process_lives. A registration without a lock belongs to a dead run,
//! and the next start removes the remains of that run.

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

/// Time a killed process may take to end [ns].
const END_TIMEOUT_NS: u64 = 1_000_000_000;
/// Folder of POSIX shared memory.
const SHM: &str = "/dev/shm";
/// Time a lock may outlive its supervisor, and interval at which it is polled.
const LOCK_TIMEOUT: Duration = Duration::from_secs(1);
const LOCK_POLL_INTERVAL: Duration = Duration::from_millis(1);

/// Public data of a run, as other commands read it.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Registration {
    /// Name of the run: the prefix of its shared memory without the trailing `_`.
    pub run: String,
    /// Process id of the supervisor.
    pub pid: u32,
    /// Name of the scenario.
    pub scenario: String,
    /// Absolute path of the log.
    pub log: PathBuf,
}

impl Registration {
    /// Namespace of the run.
    ///
    /// # Errors
    /// If the run's name is invalid.
    pub fn domain(&self) -> Result<Domain> {
        Ok(Domain::new(&format!("{}_", self.run), &format!("{SHM}/{}", self.run))?)
    }
}

/// All live runs of this user, sorted by name.
///
/// # Errors
/// If the registry folder cannot be read.
pub fn running() -> Result<Vec<Registration>> {
    let folder = folder_path();
    if !is_ours(&folder)? {
        return Ok(Vec::new());
    }
    let _lock = RegistryLock::take(&folder)?;
    let entries =
        fs::read_dir(&folder).with_context(|| format!("cannot read {}, where runs are registered", folder.display()))?;
    let mut runs = Vec::new();
    for path in entries.flatten().map(|e| e.path()) {
        if !is_alive(&path) {
            continue;
        }
        match fs::read_to_string(&path).map_err(anyhow::Error::from).and_then(|t| Ok(serde_json::from_str::<Registration>(&t)?)) {
            Ok(run) => runs.push(run),
            // The other runs stay reachable.
            Err(e) => crate::log_line(&format!(
                "hapfic: {}: cannot read this registration of a run ({e:#}). Hint: another version of hapfic may have written it",
                path.display()
            )),
        }
    }
    runs.sort_by(|a, b| a.run.cmp(&b.run));
    Ok(runs)
}

/// Calls `act` while the run cannot end, so that nothing made in its namespace outlives it; `None` if it has ended.
///
/// # Errors
/// If the registry folder cannot be locked.
pub fn while_alive<T>(run: &str, act: impl FnOnce() -> T) -> Result<Option<T>> {
    let folder = folder_path();
    if !is_ours(&folder)? {
        return Ok(None);
    }
    let _lock = RegistryLock::take(&folder)?;
    Ok(is_alive(&folder.join(format!("{run}.json"))).then(act))
}

/// Whether the supervisor of a registration process_lives, that is, holds its lock. The caller holds the [`RegistryLock`].
fn is_alive(path: &Path) -> bool {
    File::open(path).is_ok_and(|file| flock(&file, FlockOperation::NonBlockingLockExclusive).is_err())
}

/// The namespace of a run; dropping it removes everything in it.
#[derive(Debug)]
pub struct RunDirectory {
    run: String,
    file: PathBuf,
    others: usize,
    orphaned_logs: Vec<PathBuf>,
    /// Holds the lock.
    _registration: File,
}

impl RunDirectory {
    /// Creates a namespace that no other run has, and registers it.
    ///
    /// # Errors
    /// If shared memory or the user's run-time directory cannot be written.
    pub fn take(scenario: &str, log: &Path) -> Result<Self> {
        let folder = runtime_folder()?;
        // One start or end at a time: a half-made registration looks like that of a dead run.
        let lock = RegistryLock::take(&folder)?;
        let (others, orphaned_logs) = clean_up(&folder);
        let mut salt = hapfic_ipc::clock::unix_ns();
        loop {
            // Short: the path of a Unix socket has 108 bytes, and iceoryx2 needs most of them.
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
                // Clients may have another working directory.
                log: std::path::absolute(log).unwrap_or_else(|_| log.to_owned()),
            };
            let directory = Self { run, file, others, orphaned_logs, _registration: registration };
            let populated = directory.populate(&content);
            // Dropping the directory takes the lock itself.
            drop(lock);
            return populated.map(|()| directory);
        }
    }

    fn populate(&self, content: &Registration) -> Result<()> {
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

    /// Logs of runs whose supervisors were killed, and whose remains this run removed when it registered.
    #[must_use]
    pub fn orphaned_logs(&self) -> &[PathBuf] {
        &self.orphaned_logs
    }

    /// Replaces iceoryx2's node counter, which has mode 0666, by a copy that only this user may open.
    ///
    /// Another user who has opened the first file then holds an unused one. The call comes after the first node exists
    /// and before any other.
    ///
    /// # Errors
    /// If the file cannot be replaced.
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

    /// Number of runs that were alive when this one registered.
    #[must_use]
    pub fn others(&self) -> usize {
        self.others
    }

    /// Folder of the run in shared memory.
    #[must_use]
    pub fn root(&self) -> String {
        format!("{SHM}/{}", self.run)
    }
}

impl Drop for RunDirectory {
    fn drop(&mut self) {
        let Some(folder) = self.file.parent() else { return };
        // Under the lock no client creates ports here after the removal. Without it the run removes its own files, but
        // not the folder, which another run may be about to use.
        let lock = RegistryLock::take(folder);
        remove_remains(&self.run);
        // Last: while the registration exists, the next start looks for remains.
        let _ = fs::remove_file(&self.file);
        if lock.is_ok() {
            // Fails if another run is registered.
            let _ = fs::remove_dir(folder);
        }
    }
}

/// The exclusive right to change the registry; ends when dropped.
struct RegistryLock(#[allow(dead_code)] File);

impl RegistryLock {
    fn take(folder: &Path) -> Result<Self> {
        use std::os::unix::fs::MetadataExt;
        let problem = || format!("cannot lock {}, where runs are registered", folder.display());
        loop {
            let handle = match File::open(folder) {
                Ok(handle) => handle,
                // Another run has just removed the folder.
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                    // Created again, unless the user's run-time directory itself is gone, as after a logout.
                    if runtime_folder()? != folder {
                        return Err(e).with_context(problem);
                    }
                    continue;
                }
                Err(e) => return Err(e).with_context(problem),
            };
            flock(&handle, FlockOperation::LockExclusive).with_context(problem)?;
            // Another run may have removed and recreated the folder during the wait.
            let same = |a: &fs::Metadata, b: &fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
            if let (Ok(ours), Ok(now)) = (handle.metadata(), fs::metadata(folder))
                && same(&ours, &now)
            {
                return Ok(Self(handle));
            }
        }
    }
}

/// Path of the user's registry folder.
fn folder_path() -> PathBuf {
    match std::env::var_os("XDG_RUNTIME_DIR") {
        // The variable may name a missing folder, as after `su`.
        Some(dir) if Path::new(&dir).is_dir() => PathBuf::from(dir).join("hapfic"),
        _ => std::env::temp_dir().join(format!("hapfic-{}", rustix::process::getuid().as_raw())),
    }
}

/// The user's registry folder; created if it does not exist.
fn runtime_folder() -> Result<PathBuf> {
    let folder = folder_path();
    match DirBuilder::new().mode(0o700).create(&folder) {
        Ok(()) => Ok(folder),
        Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {
            anyhow::ensure!(is_ours(&folder)?, "{} has just been removed. Hint: try again", folder.display());
            Ok(folder)
        }
        Err(e) => Err(e).with_context(|| format!("cannot make {}, where runs are registered", folder.display())),
    }
}

/// Whether the registry folder exists; fails if another user owns it or may write to it.
fn is_ours(folder: &Path) -> Result<bool> {
    use std::os::unix::fs::MetadataExt;
    let found = match fs::symlink_metadata(folder) {
        Ok(found) => found,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(false),
        Err(e) => {
            return Err(e).with_context(|| {
                format!(
                    "cannot read {}, where runs are registered. Hint: set XDG_RUNTIME_DIR to a folder of your own",
                    folder.display()
                )
            });
        }
    };
    let own = rustix::process::getuid().as_raw();
    anyhow::ensure!(
        found.is_dir() && found.uid() == own && found.mode() & 0o022 == 0,
        "{} belongs to user {} with mode {:o}, expected a folder of user {own} without write permission for others. Hint: set \
         XDG_RUNTIME_DIR to a folder of your own",
        folder.display(),
        found.uid(),
        found.mode() & 0o7777
    );
    Ok(true)
}

/// Removes the remains of dead runs. Returns the number of live runs, and the logs of the dead ones.
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
            // A truncated registration names no log.
            let registered = fs::read(&path).ok().and_then(|text| serde_json::from_slice::<Registration>(&text).ok());
            logs.extend(registered.map(|registration| registration.log));
            let _ = fs::remove_file(&path);
        }
    }
    (alive, logs)
}

/// Whether a live supervisor holds the lock of a registration.
///
/// A supervisor that is killed while it starts a process leaves its lock to that process, until the process calls exec
/// or ends.
fn is_held(file: &File, path: &Path) -> bool {
    let begun = Instant::now();
    while flock(file, FlockOperation::NonBlockingLockExclusive).is_err() {
        let registered = fs::read(path).ok().and_then(|text| serde_json::from_slice::<Registration>(&text).ok());
        if registered.is_some_and(|registration| process_lives(registration.pid)) || begun.elapsed() > LOCK_TIMEOUT {
            return true;
        }
        std::thread::sleep(LOCK_POLL_INTERVAL);
    }
    false
}

/// Whether a process exists and is no zombie.
fn process_lives(pid: u32) -> bool {
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

/// Kills the remaining processes of a dead run; only stopped ones outlive their supervisor.
fn end_processes(run: &str) {
    let mark = format!("{}={SHM}/{run}/", hapfic_ipc::RunFile::VARIABLE);
    let Ok(entries) = fs::read_dir("/proc") else { return };
    let mut ended = Vec::new();
    for entry in entries.flatten() {
        let Some(pid) = entry.file_name().to_str().and_then(|n| n.parse().ok()).and_then(Pid::from_raw) else { continue };
        // Opened before the environment is read, so that both belong to the same process.
        let Ok(handle) = pidfd_open(pid, PidfdFlags::empty()) else { continue };
        let environment = fs::read(entry.path().join("environ")).unwrap_or_default();
        if environment.split(|b| *b == 0).any(|v| v.starts_with(mark.as_bytes())) {
            let _ = pidfd_send_signal(&handle, Signal::KILL);
            ended.push(handle);
        }
    }
    // A process inside a system call may still create a file.
    for handle in &ended {
        let _ = poll(&mut [PollFd::new(handle, PollFlags::IN)], Some(&hapfic_ipc::clock::timespec(END_TIMEOUT_NS)));
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
    fn run_directory_drop_leaves_nothing() {
        let (a, b) = (RunDirectory::take("floor", Path::new("a")).unwrap(), RunDirectory::take("floor", Path::new("b")).unwrap());
        assert_ne!(a.prefix(), b.prefix());
        let (root, file) = (a.root(), a.file.clone());
        assert!(Path::new(&root).is_dir() && file.is_file());
        fs::write(format!("{SHM}/{}remains", a.prefix()), "x").unwrap();
        // A third start must keep a live run.
        let c = RunDirectory::take("floor", Path::new("c")).unwrap();
        assert!(Path::new(&root).is_dir());
        drop((a, c));
        assert!(!Path::new(&root).exists() && !file.exists());
        assert!(!fs::read_dir(SHM).unwrap().flatten().any(|e| e.file_name().to_string_lossy().ends_with("remains")));
        drop(b);
    }

    #[test]
    fn run_directory_next_start_cleans_up_dead_run() {
        let folder = runtime_folder().unwrap();
        // A killed supervisor: registered, without a lock.
        let run = format!("hfdead{}", base36(u64::from(std::process::id())));
        fs::write(folder.join(format!("{run}.json")), "{}").unwrap();
        fs::create_dir(format!("{SHM}/{run}")).unwrap();
        fs::write(format!("{SHM}/{run}_segment"), "x").unwrap();
        let directory = RunDirectory::take("floor", Path::new("a")).unwrap();
        assert!(!Path::new(&format!("{SHM}/{run}")).exists());
        assert!(!Path::new(&format!("{SHM}/{run}_segment")).exists());
        drop(directory);
    }

    #[test]
    fn is_held_dead_supervisor_waits_for_lock() {
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
    fn base36_digit_overflow_carries() {
        assert_eq!((base36(0), base36(35), base36(36)), ("0".into(), "z".into(), "10".into()));
    }
}
