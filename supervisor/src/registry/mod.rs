//! Namespace of a run: its prefix and folder in shared memory, and the registration by which other commands find it.
//!
//! Launcher and supervisor hold a lock on the registration while they live. A registration without a lock belongs to a dead
//! run, and the next start removes the remains of that run.

mod clean_up;
mod lock;

use anyhow::{Context, Result};
pub(crate) use clean_up::end_in_order;
pub use clean_up::end_orphans;
use clean_up::{clean_up, remove_remains};
use hapfic_ipc::Domain;
use lock::{RegistryLock, folder_path, is_alive, is_ours, runtime_folder};
use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Folder of POSIX shared memory.
const SHM: &str = "/dev/shm";

/// Public data of a run, as other commands read it.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Registration {
    /// Name of the run: the prefix of its shared memory without the trailing `_`.
    pub run: String,
    /// Process id of the launcher.
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

    /// Logs of runs that were killed, and whose remains this run removed when it registered.
    #[must_use]
    pub fn orphaned_logs(&self) -> &[PathBuf] {
        &self.orphaned_logs
    }

    /// Handle of the registration, which holds the lock: the supervisor shares it, so that the run is not taken for dead
    /// before both have ended.
    ///
    /// # Errors
    /// If the process has too many open files.
    pub fn handle(&self) -> Result<File> {
        self._registration.try_clone().context("cannot share the run's registration")
    }

    /// Takes over the namespace of a run from a launcher that is lost.
    ///
    /// # Errors
    /// If the registry folder cannot be found.
    pub fn taken_over(prefix: &str, registration: File) -> Result<Self> {
        let run = prefix.trim_end_matches('_').to_owned();
        let file = runtime_folder()?.join(format!("{run}.json"));
        Ok(Self { run, file, others: 0, orphaned_logs: Vec::new(), _registration: registration })
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

/// Replaces iceoryx2's node counter, which has mode 0666, by a copy that only this user may open.
///
/// Another user who has opened the first file then holds an unused one. The call comes after the first node exists
/// and before any other. `prefix` begins the names of the run's segments.
///
/// # Errors
/// If the file cannot be replaced.
pub fn close_to_others(prefix: &str) -> Result<()> {
    let problem = || format!("cannot close {SHM}/{prefix}* to other users");
    for entry in fs::read_dir(SHM).with_context(problem)?.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with(prefix) && name.ends_with(".global_mgmt") {
            let bytes = fs::read(entry.path()).with_context(problem)?;
            let copy = format!("{SHM}/{prefix}closed");
            let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&copy).with_context(problem)?;
            file.write_all(&bytes).with_context(problem)?;
            fs::rename(&copy, entry.path()).with_context(problem)?;
        }
    }
    Ok(())
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
        // A killed run: registered, without a lock.
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
    fn base36_digit_overflow_carries() {
        assert_eq!((base36(0), base36(35), base36(36)), ("0".into(), "z".into(), "10".into()));
    }
}
