//! Doorbells: futex notifiers on a page of counters that all processes of a run share.
//!
//! iceoryx2 carries the messages. Its own events would wake receivers through Unix datagram sockets: two to three
//! system calls a hop, and a socket for each pair of processes. A sender increments the doorbell's sequence and wakes
//! its waiters: one system call, none without waiters. A receiver sleeps while the sequence is the last one seen: one
//! system call, none if it differs. Or it [polls](poll) the sequence for some microseconds. A process that dies leaves
//! no lock behind, only numbers ([`DoorbellWord`]).

use crate::clock;
use crate::error::IpcError;
use crate::shared_page::{PageContent, SharedPage};
use core::cell::Cell;
use core::time::Duration;
use hapfic_sync::{DoorbellWord, WaiterGuard};
use rustix::io::Errno;
use rustix::thread::{ClockId, Timespec, futex};
use std::sync::Arc;

/// Name of the page in the run's folder.
const FILE: &str = "doorbells";
/// Doorbells in the page.
const DOORBELLS: usize = 16;
/// Most doorbells that a thread can wait for together.
const MAX_WAITS: usize = 4;
/// Interval of polling where the kernel cannot wait for several futexes (before Linux 5.16).
const POLL_INTERVAL: Duration = Duration::from_micros(500);
/// Time after the end of every run.
const FAR: Timespec = Timespec { tv_sec: i64::MAX, tv_nsec: 0 };

/// Index of a doorbell; the same in every process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DoorbellId(pub(crate) usize);

type Words = [DoorbellWord; DOORBELLS];

// SAFETY: a doorbell word holds atomics only, and zero stands for a doorbell that was never notified.
unsafe impl PageContent for Words {}

/// Page of all doorbells.
#[derive(Debug)]
pub(crate) struct DoorbellPage(SharedPage<Words>);

impl DoorbellPage {
    /// Maps the page in a run's folder; creates it if it is missing.
    pub(crate) fn open(folder: &str) -> Result<Arc<Self>, IpcError> {
        SharedPage::open(folder, FILE, "share the doorbells of the run").map(|page| Arc::new(Self(page)))
    }

    fn word(&self, id: DoorbellId) -> &DoorbellWord {
        &self.0[id.0]
    }
}

/// Notifier of one doorbell.
#[derive(Clone, Debug)]
pub struct Doorbell {
    page: Arc<DoorbellPage>,
    id: DoorbellId,
}

impl Doorbell {
    pub(crate) fn new(page: &Arc<DoorbellPage>, id: DoorbellId) -> Self {
        Self { page: Arc::clone(page), id }
    }

    fn word(&self) -> &DoorbellWord {
        self.page.word(self.id)
    }

    /// Wakes all waiters; they check for changes.
    pub fn notify(&self) {
        self.word().notify(|sequence| {
            // Waking cannot fail on a mapped word.
            let _ = futex::wake(sequence, futex::Flags::empty(), i32::MAX as u32);
        });
    }

    /// Notifications so far, modulo 2^32.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.word().sequence()
    }

    /// Whether a notification would wake a sleeping thread.
    #[must_use]
    pub fn has_waiters(&self) -> bool {
        self.word().has_waiters()
    }

    /// Polls until the count differs from `count` or the monotonic clock reads `until_ns`. Returns whether the count
    /// differs.
    #[must_use]
    pub fn spin_until_changed(&self, count: u32, until_ns: u64) -> bool {
        loop {
            if self.count() != count {
                return true;
            }
            if clock::now_ns() >= until_ns {
                return false;
            }
            core::hint::spin_loop();
        }
    }

    /// Whether a thread [polls](poll) it and need not be woken.
    #[must_use]
    pub fn is_polled(&self) -> bool {
        self.word().is_polled()
    }
}

/// Waiter for one doorbell.
#[derive(Debug)]
pub struct Listener {
    doorbell: Doorbell,
    last_seen: Cell<u32>,
}

impl Listener {
    pub(crate) fn new(page: &Arc<DoorbellPage>, id: DoorbellId) -> Self {
        let doorbell = Doorbell::new(page, id);
        let last_seen = Cell::new(doorbell.count());
        Self { doorbell, last_seen }
    }

    fn word(&self) -> &DoorbellWord {
        self.doorbell.word()
    }

    /// Discards the notifications so far: they do not end the next wait.
    pub fn discard_notifications(&self) {
        let _ = self.is_notified();
    }

    /// Whether a notification came since the last call.
    fn is_notified(&self) -> bool {
        let now = self.word().sequence();
        self.last_seen.replace(now) != now
    }
}

/// A source of wake-ups. Implemented by [`crate::Input`].
pub trait Wakes {
    /// Listener of the source, if any.
    #[doc(hidden)]
    fn listener(&self) -> Option<&Listener>;
}

impl Wakes for Listener {
    fn listener(&self) -> Option<&Listener> {
        Some(self)
    }
}

/// Waits for a notification of one of the inputs, a signal or the time-out. Returns whether a notification ended the
/// wait.
///
/// A notification since the last wait ends it immediately. Wake-ups coalesce and may be spurious: the caller then takes
/// all messages. [`Duration::MAX`] means no time-out, which is cheaper than any (see [`crate::deadline_timer`]). The
/// call ignores inputs opened with [`crate::Wait::No`], and all but the first four.
///
/// # Errors
/// [`IpcError::System`] if the system cannot wait.
pub fn wait(inputs: &[&dyn Wakes], timeout: Duration) -> Result<bool, IpcError> {
    let mut slots: [Option<&Listener>; MAX_WAITS] = [None; MAX_WAITS];
    let mut count = 0;
    for listener in inputs.iter().filter_map(|i| i.listener()).take(MAX_WAITS) {
        slots[count] = Some(listener);
        count += 1;
    }
    let listeners = || slots[..count].iter().flatten();
    // Checks every listener: a notification that was seen must not end the next wait.
    let notified = || listeners().fold(false, |any, l| l.is_notified() | any);
    if notified() {
        return Ok(true);
    }
    let until = if timeout == Duration::MAX { None } else { Some(clock::timespec(clock::now_ns() + timeout.as_nanos() as u64)) };
    let until = until.as_ref();
    let slept = match (slots[0], count) {
        (None, _) => rustix::thread::clock_nanosleep_absolute(ClockId::Monotonic, until.unwrap_or(&FAR)),
        (Some(listener), 1) => sleep_on(listener, until),
        _ => sleep_on_any(&slots[..count], until),
    };
    match slept {
        Ok(()) | Err(Errno::INTR | Errno::AGAIN | Errno::TIMEDOUT) => Ok(notified()),
        Err(e) => Err(IpcError::System { action: "wait for a message", cause: e.into() }),
    }
}

/// Polls the inputs until a notification, or until the monotonic clock reads `until_ns`. Returns whether one came.
///
/// A notification since the last wait ends the poll immediately. The thread must not share its core with the sender.
pub fn poll(inputs: &[&dyn Wakes], until_ns: u64) -> bool {
    let listeners = || inputs.iter().filter_map(|i| i.listener());
    let notified = || listeners().fold(false, |any, l| l.is_notified() | any);
    listeners().for_each(|l| l.word().set_polled(true));
    let mut found = notified();
    while !found && clock::now_ns() < until_ns {
        core::hint::spin_loop();
        found = notified();
    }
    listeners().for_each(|l| l.word().set_polled(false));
    found
}

fn sleep_on(listener: &Listener, until: Option<&Timespec>) -> Result<(), Errno> {
    let all = core::num::NonZeroU32::MAX;
    let word = listener.word();
    let _waiter = word.register();
    futex::wait_bitset(word.futex(), futex::Flags::empty(), listener.last_seen.get(), until, all)
}

fn sleep_on_any(slots: &[Option<&Listener>], until: Option<&Timespec>) -> Result<(), Errno> {
    let register = |i: usize| slots.get(i).copied().flatten().map(|listener| listener.word().register());
    let _waiters: [Option<WaiterGuard<'_>>; MAX_WAITS] = core::array::from_fn(register);
    let mut waits = [futex::Wait::new(); MAX_WAITS];
    let mut count = 0;
    for (wait, listener) in waits.iter_mut().zip(slots.iter().flatten()) {
        wait.val = listener.last_seen.get().into();
        wait.uaddr = futex::WaitPtr::new(listener.word().futex().as_ptr().cast());
        wait.flags = futex::WaitFlags::SIZE_U32;
        count += 1;
    }
    match futex::waitv(&waits[..count], futex::WaitvFlags::empty(), until, ClockId::Monotonic) {
        Ok(_) => Ok(()),
        Err(Errno::NOSYS) => {
            let Some(first) = slots.iter().flatten().next() else { return Ok(()) };
            sleep_on(first, Some(&clock::timespec(clock::now_ns() + POLL_INTERVAL.as_nanos() as u64)))
        }
        Err(e) => Err(e),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use core::sync::atomic::{AtomicU32, Ordering};
    use std::time::Instant;

    const LONG: Duration = Duration::from_secs(60);

    fn page() -> (tempfile::TempDir, Arc<DoorbellPage>) {
        let folder = tempfile::tempdir().unwrap();
        let page = DoorbellPage::open(folder.path().to_str().unwrap()).unwrap();
        (folder, page)
    }

    #[test]
    fn wait_earlier_notifications_end_one_wait() {
        let (folder, page) = page();
        let listener = Listener::new(&page, DoorbellId(3));
        // Another mapping of the same page.
        let other = DoorbellPage::open(folder.path().to_str().unwrap()).unwrap();
        let doorbell = Doorbell::new(&other, DoorbellId(3));
        doorbell.notify();
        doorbell.notify();
        assert!(wait(&[&listener], LONG).unwrap());
        assert!(!wait(&[&listener], Duration::from_millis(1)).unwrap(), "both notifications were one wake-up");
        Doorbell::new(&other, DoorbellId(4)).notify();
        assert!(!wait(&[&listener], Duration::from_millis(1)).unwrap(), "the notification of another doorbell");
    }

    #[test]
    fn doorbell_counts_and_sees_waiters() {
        let (_folder, page) = page();
        let doorbell = Doorbell::new(&page, DoorbellId(5));
        let before = doorbell.count();
        assert!(!doorbell.has_waiters());
        assert!(!doorbell.spin_until_changed(before, clock::now_ns()), "not notified");
        std::thread::scope(|scope| {
            scope.spawn(|| wait(&[&Listener::new(&page, DoorbellId(5))], LONG).unwrap());
            let begun = Instant::now();
            while !doorbell.has_waiters() {
                assert!(begun.elapsed() < LONG);
            }
            doorbell.notify();
        });
        assert!(!doorbell.has_waiters());
        assert!(doorbell.spin_until_changed(before, u64::MAX));
        assert_eq!(doorbell.count(), before.wrapping_add(1));
    }

    #[test]
    fn wait_several_doorbells_any_wakes() {
        let (_folder, page) = page();
        for id in [1, 2] {
            let (a, b) = (Listener::new(&page, DoorbellId(1)), Listener::new(&page, DoorbellId(2)));
            let doorbell = Doorbell::new(&page, DoorbellId(id));
            let begun = Instant::now();
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    while !doorbell.has_waiters() {
                        assert!(begun.elapsed() < LONG);
                    }
                    doorbell.notify();
                });
                while !wait(&[&a, &b], LONG).unwrap() {
                    assert!(begun.elapsed() < LONG);
                }
            });
            assert!(!wait(&[&a, &b], Duration::ZERO).unwrap(), "doorbell {id}: seen once");
        }
    }

    #[test]
    fn doorbell_ping_pong_loses_nothing() {
        const TURNS: u32 = 20_000;
        let (_folder, page) = page();
        let done = AtomicU32::new(0);
        std::thread::scope(|scope| {
            for side in [0, 1] {
                let (page, done) = (&page, &done);
                scope.spawn(move || {
                    let (mine, theirs) = (Listener::new(page, DoorbellId(side)), Doorbell::new(page, DoorbellId(1 - side)));
                    let begun = Instant::now();
                    loop {
                        let turn = done.load(Ordering::Acquire);
                        if turn >= TURNS {
                            break theirs.notify();
                        }
                        if turn % 2 == side as u32 {
                            done.store(turn + 1, Ordering::Release);
                            theirs.notify();
                        } else {
                            wait(&[&mine], LONG).unwrap();
                            assert!(begun.elapsed() < LONG, "stuck at turn {turn}");
                        }
                    }
                });
            }
        });
        assert_eq!(done.into_inner(), TURNS);
    }

    #[test]
    fn wait_no_inputs_pauses() {
        let begun = Instant::now();
        assert!(!wait(&[], Duration::from_millis(5)).unwrap());
        assert!(begun.elapsed() >= Duration::from_millis(5));
    }

    #[test]
    fn page_missing_folder_rejected() {
        let rejected = DoorbellPage::open("/nonexistent/folder").unwrap_err().to_string();
        assert!(rejected.contains("doorbells") && rejected.contains("No such file"), "{rejected}");
    }
}
