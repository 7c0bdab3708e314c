//! Removal of what dead runs have left: processes, shared memory and registrations.

use super::lock::is_held;
use super::{Registration, SHM};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// Time a killed process may take to end [ns].
const END_TIMEOUT_NS: u64 = 1_000_000_000;

/// Removes the remains of dead runs. Returns the number of live runs, and the logs of the dead ones.
pub(super) fn clean_up(folder: &Path) -> (usize, Vec<PathBuf>) {
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

pub(super) fn remove_remains(run: &str) {
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
