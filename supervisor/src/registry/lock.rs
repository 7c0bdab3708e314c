//! Locks of the registry: one for changes of the whole folder, one in every registration while its launcher or supervisor
//! lives.

use super::Registration;
use anyhow::{Context, Result};
use rustix::fs::{FlockOperation, flock};
use std::fs::{self, DirBuilder, File};
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Time a lock may outlive its owner, and interval at which it is polled.
const LOCK_TIMEOUT: Duration = Duration::from_secs(1);
const LOCK_POLL_INTERVAL: Duration = Duration::from_millis(1);

/// Whether launcher or supervisor of a registration lives, that is, holds its lock. The caller holds the [`RegistryLock`].
pub(super) fn is_alive(path: &Path) -> bool {
    File::open(path).is_ok_and(|file| flock(&file, FlockOperation::NonBlockingLockExclusive).is_err())
}

/// The exclusive right to change the registry; ends when dropped.
pub(super) struct RegistryLock(#[allow(dead_code)] File);

impl RegistryLock {
    pub(super) fn take(folder: &Path) -> Result<Self> {
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
pub(super) fn folder_path() -> PathBuf {
    match std::env::var_os("XDG_RUNTIME_DIR") {
        // The variable may name a missing folder, as after `su`.
        Some(dir) if Path::new(&dir).is_dir() => PathBuf::from(dir).join("hapfic"),
        _ => std::env::temp_dir().join(format!("hapfic-{}", rustix::process::getuid().as_raw())),
    }
}

/// The user's registry folder; created if it does not exist.
pub(super) fn runtime_folder() -> Result<PathBuf> {
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
pub(super) fn is_ours(folder: &Path) -> Result<bool> {
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

/// Whether a live launcher or supervisor holds the lock of a registration.
///
/// One that is killed while it starts a process leaves its lock to that process, until the process calls exec or ends.
pub(super) fn is_held(file: &File, path: &Path) -> bool {
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

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
}
