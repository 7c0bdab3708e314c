//! Who stands in when the gate's own thread does not come: a second thread, on the core of plant and controller.
//!
//! The gate looks out for requests on a core of its own, and a host may take that core away just when a request comes. The controller
//! sees that no command follows, and rings for this thread. It takes the gate, ports and all, from where the other one left it
//! ([`Baton`]), does the tick, and puts it back; the other one finds the tick done. Whoever has the gate has it alone.

use super::thread::{Gateway, Hand};
use crossbeam_utils::atomic::AtomicCell;
use hapfic_ipc::realtime::{self, Wish};
use hapfic_ipc::{Bell, IpcError, Listener, wait};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Stack of the thread, bytes: more than what is touched beforehand.
const STACK: usize = 512 * 1024;

/// Where the gate is while nobody is at work with it: a pointer that one atomic instruction takes away or puts back. Who finds it gone goes
/// without: nobody ever waits here.
pub(super) type Baton = AtomicCell<Option<Box<Gateway>>>;

const _: () = assert!(Baton::is_lock_free());

/// The thread; it ends when this is dropped.
#[derive(Debug)]
pub(super) struct Understudy {
    stop: Arc<AtomicBool>,
    bell: Bell,
    thread: Option<JoinHandle<()>>,
}

impl Understudy {
    /// Starts it; `listener` hears when it is called, `bell` is the same one.
    pub(super) fn start(baton: &Arc<Baton>, bell: Bell, listener: Listener, wish: Wish) -> Result<Self, IpcError> {
        let stop = Arc::new(AtomicBool::new(false));
        let (baton, theirs) = (Arc::clone(baton), Arc::clone(&stop));
        let thread = std::thread::Builder::new()
            .name("hapfic-gate-2".to_owned())
            .stack_size(STACK)
            .spawn(move || {
                // Without privileges it comes a little later.
                let _ = realtime::enter(wish);
                let mut hand = Hand::new(1);
                while !theirs.load(Ordering::Acquire) {
                    // What cannot be waited for ends this thread, and the gate goes on alone.
                    if wait(&[&listener], Duration::MAX).is_err() {
                        break;
                    }
                    if let Some(mut gateway) = baton.take() {
                        gateway.stand_in(&mut hand);
                        baton.store(Some(gateway));
                    }
                }
            })
            .map_err(|cause| IpcError::System { action: "start the gate's understudy", cause })?;
        Ok(Self { stop, bell, thread: Some(thread) })
    }
}

impl Drop for Understudy {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        self.bell.ring();
        if let Some(thread) = self.thread.take() {
            // It has nothing to say.
            let _ = thread.join();
        }
    }
}
