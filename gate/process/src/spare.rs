//! Who stands in when the gate's own thread does not come: a second thread, on the core of plant and controller.
//!
//! The gate looks out for requests on a core of its own, and a host may take that core away just when a request comes. The controller
//! sees that no command follows, and rings for this thread. It takes the gate, ports and all, from where the other one left it
//! ([`HandOffCell`]), does what is open, and puts it back; the other one finds it done. Whoever has the gate has it alone.

use crate::node::GateNode;
use crate::turn::TickAccount;
use crossbeam_utils::atomic::AtomicCell;
use hapfic_ipc::realtime::{self, SchedRequest};
use hapfic_ipc::{Doorbell, IpcError, Listener, clock, wait};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// How often the gate's thread looks whether the spare is done, ns.
const POLL_INTERVAL_NS: u64 = 50_000;

/// Where the gate is while nobody is at work with it: a pointer that one atomic instruction takes away or puts back. The spare, if
/// it finds it gone, goes without; the gate's own thread, if it does, has nothing else to do and looks again.
pub(super) type HandOffCell = AtomicCell<Option<Box<GateNode>>>;

const _: () = assert!(HandOffCell::is_lock_free());

/// The thread; it ends when this is dropped.
pub(super) struct SpareGate {
    pub(super) cell: Arc<HandOffCell>,
    stop: Arc<AtomicBool>,
    doorbell: Doorbell,
    thread: Option<JoinHandle<()>>,
}

impl SpareGate {
    /// Starts it; `listener` hears when it is called, `doorbell` is the same one. To be called before the run begins, by a thread that is
    /// not a real-time one yet.
    pub(super) fn start(doorbell: Doorbell, listener: Listener, wish: SchedRequest) -> Result<Self, IpcError> {
        let (cell, stop) = (Arc::new(HandOffCell::default()), Arc::new(AtomicBool::new(false)));
        let theirs = (Arc::clone(&cell), Arc::clone(&stop));
        let thread = std::thread::Builder::new()
            .name("hapfic-gate-2".to_owned())
            .stack_size(realtime::SMALL_STACK)
            .spawn(move || {
                let (cell, stop) = theirs;
                // It gets what the gate gets, which says so; without privileges it comes a little later.
                let _ = realtime::apply_to_current_thread(wish);
                let mut account = TickAccount::new(1);
                while !stop.load(Ordering::Acquire) {
                    // What cannot be waited for ends this thread, and the gate goes on alone.
                    if wait(&[&listener], Duration::MAX).is_err() {
                        break;
                    }
                    if let Some(mut gateway) = cell.take() {
                        gateway.spare_tick(&mut account);
                        cell.store(Some(gateway));
                    }
                }
            })
            .map_err(|cause| IpcError::System { action: "start the gate's spare", cause })?;
        Ok(Self { cell, stop, doorbell, thread: Some(thread) })
    }

    /// Takes the gate back for its own thread, when the spare is done with it.
    ///
    /// # Errors
    /// [`IpcError::System`] if it has panicked, and the gate is lost.
    pub(super) fn wait_for_gate(&self) -> Result<Box<GateNode>, IpcError> {
        loop {
            // In this order: one that ended well has put it back before.
            let over = self.thread.as_ref().is_none_or(JoinHandle::is_finished);
            if let Some(gateway) = self.cell.take() {
                return Ok(gateway);
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
            // It has nothing to say.
            let _ = thread.join();
        }
    }
}
