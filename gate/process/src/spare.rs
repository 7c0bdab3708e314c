//! Spare gate thread, on the core of plant and controller.
//!
//! The gate polls for requests on a core of its own, and steal time may take that core away just when a request comes.
//! The controller then sees no command, and notifies this thread. The thread takes the gate with its ports from a
//! [`HandOffCell`], gates the open ticks, and puts it back. The gate's own thread finds these ticks done. While neither
//! thread works with the gate, the cell holds it: the gate never has two owners.

use crate::node::GateNode;
use crate::tick_account::TickAccount;
use hapfic_ipc::realtime::{self, SchedRequest};
use hapfic_ipc::{Doorbell, IpcError, Listener, clock, wait};
use hapfic_sync::HandOffCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Poll interval of the gate's thread for the gate [ns].
const POLL_INTERVAL_NS: u64 = 50_000;

/// Spare gate thread; ends on drop.
pub(super) struct SpareGate {
    pub(super) cell: Arc<HandOffCell<GateNode>>,
    stop: Arc<AtomicBool>,
    doorbell: Doorbell,
    thread: Option<JoinHandle<()>>,
}

impl SpareGate {
    /// Starts the thread, which waits on `listener` for `doorbell`. The caller must not be a real-time thread yet.
    pub(super) fn start(doorbell: Doorbell, listener: Listener, sched: SchedRequest) -> Result<Self, IpcError> {
        let (cell, stop) = (Arc::new(HandOffCell::<GateNode>::default()), Arc::new(AtomicBool::new(false)));
        let theirs = (Arc::clone(&cell), Arc::clone(&stop));
        let thread = std::thread::Builder::new()
            .name("hapfic-gate-2".to_owned())
            .stack_size(realtime::SMALL_STACK)
            .spawn(move || {
                let (cell, stop) = theirs;
                // The gate reports the privileges, which are the same; without them this thread wakes a little later.
                let _ = realtime::apply_to_current_thread(sched);
                let mut account = TickAccount::new(1);
                while !stop.load(Ordering::Acquire) {
                    // An error ends this thread; the gate continues alone.
                    if wait(&[&listener], Duration::MAX).is_err() {
                        break;
                    }
                    if let Some(mut node) = cell.take() {
                        node.spare_tick(&mut account);
                        drop(cell.put(node));
                    }
                }
            })
            .map_err(|cause| IpcError::System { action: "start the spare gate thread", cause })?;
        Ok(Self { cell, stop, doorbell, thread: Some(thread) })
    }

    /// Takes the gate back for its own thread, once the spare thread has put it back.
    ///
    /// # Errors
    /// [`IpcError::System`] if the spare thread has panicked, and the gate is lost.
    pub(super) fn wait_for_gate(&self) -> Result<Box<GateNode>, IpcError> {
        loop {
            // In this order: a thread that ends without a panic puts the gate back first.
            let over = self.thread.as_ref().is_none_or(JoinHandle::is_finished);
            if let Some(node) = self.cell.take() {
                return Ok(node);
            }
            if over {
                let cause = std::io::Error::other("the spare gate thread has panicked");
                return Err(IpcError::System { action: "continue the gate", cause });
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
