//! Something in everybody's way on every core: a loaded machine.

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

    /// Starts them, for at most so long. To be called on the main thread: they end with the thread that starts them.
    pub(super) fn start(at_most: Duration) -> Result<Self> {
        let set = rustix::thread::sched_getaffinity(None).context("cannot tell the cores")?;
        let mut load = Self::NONE;
        for core in (0..rustix::thread::CpuSet::MAX_CPU).filter(|core| set.is_set(*core)) {
            let own = std::process::id().to_string();
            let child = this_program()?
                .args(["nuisance", &own, "hog", &at_most.as_millis().to_string()])
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .spawn()
                .context("cannot start a load")?;
            let pid = Pid::from_child(&child);
            load.0.push(child);
            hapfic_ipc::realtime::pin(Some(pid), core).with_context(|| format!("cannot keep a load on core {core}"))?;
        }
        Ok(load)
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        for child in &mut self.0 {
            // It may have ended already.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}
