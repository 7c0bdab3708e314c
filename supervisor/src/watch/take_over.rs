//! Course of a run in the successor of a lost supervisor: it takes the processes over, and goes on.

use super::slot::ProcessSlot;
use super::{FAULTS_FILE, RunTimes, Watch, bit};
use crate::children::{Child, has_ended, started};
use crate::summary::RunFault;
use anyhow::Result;
use hapfic_gate::restart_policy::RestartStage;
use hapfic_ipc::{RunFile, SupervisorRecord};
use hapfic_messages::{Detector, EventKind, Process};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::sync::atomic::Ordering;

impl Watch<'_> {
    /// Takes over the processes of a lost supervisor, whose last heartbeat was at `last_ns`, and watches the run to its end.
    ///
    /// # Errors
    /// If a process cannot be started or polled.
    pub fn take_over_and_follow(&mut self, last_ns: u64) -> Result<RunTimes> {
        let mut children = adopt(self.run.launcher_pid, self.run.record, self.run.run_file);
        for child in &children {
            // It may be halted by a fault that its supervisor would have ended.
            child.signal(Signal::CONT);
        }
        self.faults = std::fs::read(self.run.root.join(FAULTS_FILE)).map(|text| RunFault::of_text(&text)).unwrap_or_default();
        let present = self.run.shared.presence.present.load(Ordering::Acquire);
        let mut lost = Vec::new();
        for process in [&[Process::Recorder], started(self.run.settings)].concat() {
            let child = children.iter().position(|child| child.process == process).map(|index| children.swap_remove(index));
            let record = self.run.record.process(process);
            let slot = ProcessSlot::taken_over(process, child, record, &self.run.shared, present & bit(process) != 0);
            if slot.child.is_none() && matches!(slot.restart.stage, RestartStage::Working | RestartStage::Starting) {
                lost.push(process);
            }
            self.slots.push(slot);
        }
        let silent_ns = hapfic_ipc::clock::now_ns().saturating_sub(last_ns);
        self.run.record.longest_ns.fetch_max(silent_ns, Ordering::Relaxed);
        let silent_ms = silent_ns as f64 * 1e-6;
        let text = format!("supervisor was lost; its successor takes over {silent_ms:.1} ms after its last heartbeat");
        self.note(Process::Supervisor, EventKind::Lost, Detector::Exit, &text);
        self.stall.advanced = (-1, self.evidence.observed_ns());
        self.take_priority();
        self.swap_roles();
        let spent = |slot: &ProcessSlot| slot.restart.stage == RestartStage::BudgetSpent;
        self.stopped_by_budget = self.slots.iter().any(|slot| spent(slot) && slot.process != Process::Recorder);
        if self.slots.iter().any(|slot| spent(slot) && slot.process == Process::Recorder) {
            self.grant_all()?;
        }
        if self.run.shared.orders.stop.load(Ordering::Acquire) {
            return Ok(self.end_begun());
        }
        self.evidence.observe(&self.run.shared.heartbeats, hapfic_ipc::clock::now_ns());
        for process in lost {
            if !self.on_lost(process, Detector::Exit, "ended while the run had no supervisor")? {
                return Ok(self.times(false));
            }
        }
        let completed = self.follow()?;
        if completed {
            self.note(Process::Supervisor, EventKind::Ended, Detector::None, "all ticks are done");
        }
        Ok(self.times(completed))
    }

    /// Goes on with the end of a run that a lost supervisor has begun.
    fn end_begun(&mut self) -> RunTimes {
        let completed = self.run.shared.gate.tick.load(Ordering::Acquire) + 1 >= self.run.settings.duration_ticks as i64;
        // The reason of the end is among the faults that it has left.
        if !completed && self.faults.is_empty() {
            self.fault("supervisor", "was lost while it ended the run".to_owned(), Detector::Exit);
        }
        self.times(completed)
    }
}

/// Processes that lost supervisors have started, and that still run. The kernel has made them children of the launcher.
///
/// A process of the run that its supervisor has not noted yet is killed: its role takes a successor.
fn adopt(launcher: i32, record: &SupervisorRecord, run_file: &Path) -> Vec<Child> {
    let mark = [RunFile::VARIABLE.as_bytes(), b"=", run_file.as_os_str().as_bytes()].concat();
    let noted: Vec<(Process, i32)> =
        Process::ALL.iter().filter_map(|process| Some((*process, record.process(*process).pid()?))).collect();
    let mut adopted = Vec::new();
    for entry in fs::read_dir("/proc").into_iter().flatten().flatten() {
        let Some(pid) = entry.file_name().to_str().and_then(|name| name.parse().ok()).and_then(Pid::from_raw) else { continue };
        if pid == rustix::process::getpid() {
            continue;
        }
        // Opened before the parent is read, so that both belong to the same process.
        let Ok(handle) = pidfd_open(pid, PidfdFlags::empty()) else { continue };
        let Some((parent, group)) = parent_and_group(&fs::read_to_string(entry.path().join("stat")).unwrap_or_default()) else {
            continue;
        };
        if parent != launcher || has_ended(&handle) {
            continue;
        }
        match noted.iter().find(|(_, noted)| *noted == pid.as_raw_nonzero().get()) {
            Some((process, _)) => adopted.push(Child::adopted(*process, pid, handle)),
            // What an external program has left behind belongs to its group.
            None if noted.iter().any(|(_, leader)| *leader == group) => {}
            None => {
                // Others than those of the run may be children of the launcher: it may be process 1 of a container.
                let environment = fs::read(entry.path().join("environ"));
                if environment.map_or(true, |all| all.split(|b| *b == 0).any(|variable| variable == mark)) {
                    let _ = pidfd_send_signal(&handle, Signal::KILL);
                }
            }
        }
    }
    adopted
}

/// Parent and process group in `/proc/PID/stat`; `None` if it is no such text.
fn parent_and_group(stat: &str) -> Option<(i32, i32)> {
    // The name may hold anything, parentheses too.
    let mut fields = stat.rsplit_once(") ")?.1.split_whitespace().skip(1);
    Some((fields.next()?.parse().ok()?, fields.next()?.parse().ok()?))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn parent_and_group_name_with_parentheses_is_read() {
        assert_eq!(parent_and_group("17 (a) (b) S 5 17 17 0 -1"), Some((5, 17)));
        assert_eq!(parent_and_group("17 (a"), None);
        let own = fs::read_to_string("/proc/self/stat").unwrap();
        let parent = rustix::process::getppid().unwrap().as_raw_nonzero().get();
        assert_eq!(parent_and_group(&own).unwrap().0, parent);
    }
}
