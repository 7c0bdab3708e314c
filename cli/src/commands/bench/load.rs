//! Load of the machine: a busy process on every core.

use anyhow::{Context, Result};
use hapfic_supervisor::children::this_program;
use rustix::process::Pid;
use std::process::{Child, Stdio};
use std::time::Duration;

/// One busy process a core, none of them real-time; all end when dropped, or with this process.
#[derive(Debug)]
pub(super) struct Load(Vec<Child>);

impl Load {
    /// No load.
    pub(super) const NONE: Self = Self(Vec::new());

    /// Starts the processes, for `at_most`. Only for the main thread: they end with their parent thread.
    pub(super) fn start(at_most: Duration) -> Result<Self> {
        let set = rustix::thread::sched_getaffinity(None).context("cannot read the usable cores")?;
        let mut load = Self::NONE;
        for core in (0..rustix::thread::CpuSet::MAX_CPU).filter(|core| set.is_set(*core)) {
            let own = std::process::id().to_string();
            let child = this_program()?
                .args(["stressor", &own, "hog", &at_most.as_millis().to_string()])
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .spawn()
                .context("cannot start a busy process")?;
            let pid = Pid::from_child(&child);
            load.0.push(child);
            hapfic_ipc::realtime::pin(Some(pid), core).with_context(|| format!("cannot pin a busy process to core {core}"))?;
        }
        Ok(load)
    }

    /// Number of busy processes.
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        for child in &mut self.0 {
            // Fails only if it has ended already.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}
