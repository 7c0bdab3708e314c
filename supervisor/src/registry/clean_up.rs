//! Removal of what dead runs have left: processes, shared memory and registrations.

use super::lock::{RegistryLock, folder_path, is_alive, is_held};
use super::{Registration, SHM};
use hapfic_ipc::{RecorderPage, RunFile, SharedStatus};
use hapfic_messages::{Detector, Process};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::fs::{self, File};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Time a killed process may take to end [ns].
const END_TIMEOUT_NS: u64 = 1_000_000_000;
/// Time in which the processes of an orphaned run end by themselves, and after SIGTERM [ns].
const OTHERS_TIMEOUT_NS: u64 = 2_000_000_000;
const TERM_TIMEOUT_NS: u64 = 2_000_000_000;
/// Time in which the gates let the drive brake before a run without a supervisor ends.
const BRAKE_TIME: Duration = Duration::from_millis(300);
/// Time that the recorder of such a run may take to finish the log [ns].
const FINISH_TIMEOUT_NS: u64 = 10_000_000_000;
/// Time that a recorder may take to finish the log of such a run [ns].
const RECORDER_TIMEOUT_NS: u64 = 30_000_000_000;

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
            end_in_order(run);
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

/// Kills the remaining processes of a run, and waits for their end.
fn end_processes(run: &str) {
    let ended = processes(run, &[]);
    for handle in &ended {
        let _ = pidfd_send_signal(handle, Signal::KILL);
    }
    // A process inside a system call may still create a file.
    wait_for(&ended, END_TIMEOUT_NS);
}

/// Ends the processes of a run that has no supervisor any more: lets the drive brake, ends them, and lets the recorder finish
/// its log. Those that do not end are left.
pub(crate) fn end_in_order(run: &str) {
    if processes(run, &[]).is_empty() {
        return;
    }
    let root = format!("{SHM}/{run}");
    let (Ok(status), Ok(recorder)) = (SharedStatus::open(&root), RecorderPage::open(&root)) else { return };
    if status.orders.start.load(Ordering::Acquire) {
        status.orders.stop_latched(Detector::Exit);
        std::thread::sleep(BRAKE_TIME);
    }
    status.orders.stop.store(true, Ordering::Release);
    let others = processes(run, &[Process::Recorder]);
    for handle in &others {
        let _ = pidfd_send_signal(handle, Signal::TERM);
        let _ = pidfd_send_signal(handle, Signal::CONT);
    }
    wait_for(&others, TERM_TIMEOUT_NS);
    recorder.order_drain();
    let recorders = processes(run, &[]);
    for handle in &recorders {
        let _ = pidfd_send_signal(handle, Signal::CONT);
    }
    wait_for(&recorders, FINISH_TIMEOUT_NS);
}

/// Ends a run without launcher and supervisor, and removes its remains. The gates call it last: the others end by themselves,
/// but for external programs, and processes that hang. The recorder finishes the log before.
pub fn end_orphans(root: &Path) {
    let run = root.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    // Also a supervisor that the launcher has started after all.
    let patient: &[Process] = &[Process::Recorder, Process::Gate, Process::SpareGate, Process::Supervisor];
    wait_for(&processes(&run, patient), OTHERS_TIMEOUT_NS);
    for (signal, timeout_ns) in [(Signal::TERM, TERM_TIMEOUT_NS), (Signal::KILL, END_TIMEOUT_NS)] {
        let left = processes(&run, patient);
        for handle in &left {
            let _ = pidfd_send_signal(handle, signal);
            let _ = pidfd_send_signal(handle, Signal::CONT);
        }
        wait_for(&left, timeout_ns);
    }
    wait_for(&processes(&run, &patient[1..]), RECORDER_TIMEOUT_NS);
    let file = folder_path().join(format!("{run}.json"));
    // A launcher or supervisor that lives after all ends its run itself, and so does the other gate.
    if let Some(folder) = file.parent()
        && let Ok(_lock) = RegistryLock::take(folder)
        && file.exists()
        && !is_alive(&file)
    {
        remove_remains(&run);
        let _ = fs::remove_file(&file);
        // Fails if another run is registered.
        let _ = fs::remove_dir(folder);
    }
}

/// All other processes of a run, whose environment names it, but for those of some roles.
fn processes(run: &str, except: &[Process]) -> Vec<OwnedFd> {
    let mark = format!("{}={SHM}/{run}/", RunFile::VARIABLE);
    let spared: Vec<_> = except.iter().map(|process| format!("{}={}", RunFile::PROCESS, process.name())).collect();
    let Ok(entries) = fs::read_dir("/proc") else { return Vec::new() };
    let mut found = Vec::new();
    for entry in entries.flatten() {
        let Some(pid) = entry.file_name().to_str().and_then(|n| n.parse().ok()).and_then(Pid::from_raw) else { continue };
        if pid == rustix::process::getpid() {
            continue;
        }
        // Opened before the environment is read, so that both belong to the same process.
        let Ok(handle) = pidfd_open(pid, PidfdFlags::empty()) else { continue };
        let environment = fs::read(entry.path().join("environ")).unwrap_or_default();
        let variables = || environment.split(|b| *b == 0);
        let is_spared = spared.iter().any(|spared| variables().any(|v| v == spared.as_bytes()));
        if !is_spared && variables().any(|v| v.starts_with(mark.as_bytes())) {
            found.push(handle);
        }
    }
    found
}

/// Waits until processes have ended, at most for a time altogether.
fn wait_for(processes: &[OwnedFd], timeout_ns: u64) {
    let deadline = hapfic_ipc::clock::now_ns() + timeout_ns;
    for handle in processes {
        let left = deadline.saturating_sub(hapfic_ipc::clock::now_ns());
        let _ = poll(&mut [PollFd::new(handle, PollFlags::IN)], Some(&hapfic_ipc::clock::timespec(left)));
    }
}
