//! The spare gate thread, on the core of plant and controller.
//!
//! The gate polls for requests on a core of its own, and a host may take that core away just when a request comes. The controller sees
//! that no command follows, and notifies this thread. The thread takes the gate, ports and all, from its [`HandOffCell`], does the open
//! ticks, and puts it back; the gate's own thread finds them done. While neither thread works with the gate, the gate lies in the cell:
//! exactly one thread has it.

use crate::node::GateNode;
use crate::tick_account::TickAccount;
use hapfic_ipc::realtime::{self, SchedRequest};
use hapfic_ipc::{Doorbell, IpcError, Listener, clock, wait};
use hapfic_sync::HandOffCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Interval at which the gate's thread looks for the gate [ns].
const POLL_INTERVAL_NS: u64 = 50_000;

/// The spare gate thread; it ends when this is dropped.
pub(super) struct SpareGate {
    pub(super) cell: Arc<HandOffCell<GateNode>>,
    stop: Arc<AtomicBool>,
    doorbell: Doorbell,
    thread: Option<JoinHandle<()>>,
}

impl SpareGate {
    /// Starts the thread; `listener` listens to `doorbell`. To be called before the run begins, by a thread that is not real-time yet.
    pub(super) fn start(doorbell: Doorbell, listener: Listener, sched: SchedRequest) -> Result<Self, IpcError> {
        let (cell, stop) = (Arc::new(HandOffCell::<GateNode>::default()), Arc::new(AtomicBool::new(false)));
        let theirs = (Arc::clone(&cell), Arc::clone(&stop));
        let thread = std::thread::Builder::new()
            .name("hapfic-gate-2".to_owned())
            .stack_size(realtime::SMALL_STACK)
            .spawn(move || {
                let (cell, stop) = theirs;
                // The gate reports the privileges, which are the same; without them this thread comes a little later.
                let _ = realtime::apply_to_current_thread(sched);
                let mut account = TickAccount::new(1);
                while !stop.load(Ordering::Acquire) {
                    // An error ends this thread; the gate goes on alone.
                    if wait(&[&listener], Duration::MAX).is_err() {
                        break;
                    }
                    if let Some(mut node) = cell.take() {
                        node.spare_tick(&mut account);
                        drop(cell.put(node));
                    }
                }
            })
            .map_err(|cause| IpcError::System { action: "start the gate's spare", cause })?;
        Ok(Self { cell, stop, doorbell, thread: Some(thread) })
    }

    /// Takes the gate back for its own thread once the spare thread is done with it.
    ///
    /// # Errors
    /// [`IpcError::System`] if the spare thread has panicked, and the gate is lost.
    pub(super) fn wait_for_gate(&self) -> Result<Box<GateNode>, IpcError> {
        loop {
            // In this order: a thread that ended well has put the gate back before.
            let over = self.thread.as_ref().is_none_or(JoinHandle::is_finished);
            if let Some(node) = self.cell.take() {
                return Ok(node);
            }
            if over {
                let cause = std::io::Error::other("its spare has panicked");
                return Err(IpcError::System { action: "go on with the gate", cause });
            }
            clock::sleep_until(clock::now_ns() + POLL_INTERVAL_NS);
        }
    }
}

impl Drop for SpareGate {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        self.doorbell.notify();
        if let Some(thread) = self.thread.take() {
            // Its panic has been printed.
            let _ = thread.join();
        }
    }
}
