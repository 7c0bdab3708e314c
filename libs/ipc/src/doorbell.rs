//! Waking each other: a page of words that all processes of a run share, and futexes on them.
//!
//! iceoryx2 carries the messages; its own events would do the waking, through Unix datagram sockets: two to three system calls a
//! hop, and a socket for each pair of processes. Here whoever has sent something adds one to the topic's word and wakes all who
//! sleep on it (one system call; none if nobody does); whoever waits sleeps as long as the word is what it was when he last looked
//! (one system call, none if it is not), or [looks at it](watch) for some microseconds. A process that dies leaves no lock behind, only
//! numbers: if it slept, the count of waiters stays too high, and each ring makes its system call.

use crate::clock;
use crate::error::IpcError;
use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::mm::{MapFlags, ProtFlags};
use rustix::thread::{ClockId, Timespec, futex};
use std::path::Path;
use std::sync::Arc;

/// Name of the page in the run's folder.
const FILE: &str = "doorbells";
/// DoorbellWords, each on a cache line of its own.
const DOORBELLS: usize = 16;
/// Most that one may wait for at once.
const MAX_WAITS: usize = 4;
/// How often it is looked round where the kernel cannot wait for several words at once (before Linux 5.16).
const POLL_INTERVAL: Duration = Duration::from_micros(500);

/// Some time after all runs.
const FAR: Timespec = Timespec { tv_sec: i64::MAX, tv_nsec: 0 };

/// Which doorbell; the same in every process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DoorbellId(pub(crate) usize);

/// A doorbell's place in the page.
#[derive(Debug)]
#[repr(C, align(64))]
struct DoorbellWord {
    /// How often it was sequence.
    sequence: AtomicU32,
    /// Threads that sleep on it, or are about to; more than that once one was killed while it slept.
    waiters: AtomicU32,
    /// Whether somebody looks at it all the time.
    polled: AtomicU32,
}

type DoorbellWords = [DoorbellWord; DOORBELLS];

/// The page, mapped.
#[derive(Debug)]
pub(crate) struct DoorbellPage(*mut DoorbellWords);

// SAFETY: the page holds atomics only, and stays mapped until the last owner is gone.
unsafe impl Send for DoorbellPage {}
// SAFETY: as above.
unsafe impl Sync for DoorbellPage {}

impl DoorbellPage {
    /// Maps the page in a run's folder; makes it if it is not there.
    pub(crate) fn open(folder: &str) -> Result<Arc<Self>, IpcError> {
        let path = Path::new(folder).join(FILE);
        let system = |e: Errno| IpcError::System { action: "share the doorbells of the run", cause: e.into() };
        let file =
            rustix::fs::open(&path, OFlags::RDWR | OFlags::CREATE | OFlags::CLOEXEC, Mode::RUSR | Mode::WUSR).map_err(system)?;
        let size = size_of::<DoorbellWords>();
        // Never makes it smaller: that would pull the page from under those who have it.
        if rustix::fs::fstat(&file).map_err(system)?.st_size < size as i64 {
            rustix::fs::ftruncate(&file, size as u64).map_err(system)?;
        }
        // SAFETY: a new mapping at a place of the kernel's choice, of a file that is as long.
        let page = unsafe {
            rustix::mm::mmap(core::ptr::null_mut(), size, ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED, &file, 0)
        };
        Ok(Arc::new(Self(page.map_err(system)?.cast())))
    }

    fn word(&self, place: DoorbellId) -> &DoorbellWord {
        // SAFETY: the page is mapped as long as `self` lives, is as long as `DoorbellWords`, page-aligned, and holds atomics only, for
        // which every bit pattern is good.
        let words = unsafe { &*self.0 };
        &words[place.0]
    }
}

impl Drop for DoorbellPage {
    fn drop(&mut self) {
        // SAFETY: mapped in `open` with this size, and nobody has a reference any more. What cannot be unmapped stays.
        let _ = unsafe { rustix::mm::munmap(self.0.cast(), size_of::<DoorbellWords>()) };
    }
}

/// Wakes those who wait at a place.
#[derive(Clone, Debug)]
pub struct Doorbell {
    doorbells: Arc<DoorbellPage>,
    place: DoorbellId,
}

impl Doorbell {
    pub(crate) fn new(doorbells: &Arc<DoorbellPage>, place: DoorbellId) -> Self {
        Self { doorbells: Arc::clone(doorbells), place }
    }

    /// Wakes them all. They look around, and find what has changed.
    pub fn notify(&self) {
        let word = self.doorbells.word(self.place);
        // What was sent before is seen by whoever sees this. One order for all of this and for falling asleep: either the sleeper is
        // seen here, or the ring there.
        word.sequence.fetch_add(1, Ordering::SeqCst);
        if word.waiters.load(Ordering::SeqCst) != 0 {
            // Nothing can go wrong with a mapped word.
            let _ = futex::wake(&word.sequence, futex::Flags::empty(), i32::MAX as u32);
        }
    }

    /// How often it has been sequence.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.doorbells.word(self.place).sequence.load(Ordering::SeqCst)
    }

    /// Whether somebody sleeps on it, whom a ring would wake.
    #[must_use]
    pub fn has_waiters(&self) -> bool {
        self.doorbells.word(self.place).waiters.load(Ordering::SeqCst) != 0
    }

    /// Looks, without sleeping, until it has been sequence more often than `count` times or the monotonic clock reads `until_ns`. Says
    /// whether it was.
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

    /// Whether somebody [watches](watch) it: he need not be woken.
    #[must_use]
    pub fn is_polled(&self) -> bool {
        self.doorbells.word(self.place).polled.load(Ordering::Relaxed) != 0
    }
}

/// Hears a doorbell.
#[derive(Debug)]
pub struct Listener {
    doorbell: Doorbell,
    last_seen: Cell<u32>,
}

impl Listener {
    pub(crate) fn new(doorbells: &Arc<DoorbellPage>, place: DoorbellId) -> Self {
        let doorbell = Doorbell::new(doorbells, place);
        let last_seen = Cell::new(doorbell.doorbells.word(place).sequence.load(Ordering::Acquire));
        Self { doorbell, last_seen }
    }

    fn place(&self) -> &DoorbellWord {
        self.doorbell.doorbells.word(self.doorbell.place)
    }

    /// Has the next wait not end by what was sent before now.
    pub fn forget(&self) {
        let _ = self.sequence();
    }

    /// Whether it was sequence since this was last asked.
    fn sequence(&self) -> bool {
        let now = self.place().sequence.load(Ordering::SeqCst);
        self.last_seen.replace(now) != now
    }
}

/// Something to wait for. Implemented by [`crate::Input`].
pub trait Wakes {
    /// The listener, if there is one.
    #[doc(hidden)]
    fn listener(&self) -> Option<&Listener>;
}

impl Wakes for Listener {
    fn listener(&self) -> Option<&Listener> {
        Some(self)
    }
}

/// Waits until something was sent to one of the inputs, a signal came, or the time is up; at once if something was sent since
/// the last wait. Wake-ups coalesce, so take everything there is afterwards; and they may be spurious.
///
/// [`Duration::MAX`] is for ever, and cheaper than any time-out (see [`crate::deadline_timer`]). Inputs opened with [`crate::Wait::No`] are passed
/// over. At most four can be waited for. Says whether anything woke it.
///
/// # Errors
/// [`IpcError::System`] if the system cannot wait.
pub fn wait(inputs: &[&dyn Wakes], timeout: Duration) -> Result<bool, IpcError> {
    let mut places: [Option<&Listener>; MAX_WAITS] = [None; MAX_WAITS];
    let mut count = 0;
    for listener in inputs.iter().filter_map(|i| i.listener()).take(MAX_WAITS) {
        places[count] = Some(listener);
        count += 1;
    }
    let listeners = || places[..count].iter().flatten();
    // Each is asked: what one has last_seen must not wake it again.
    let sequence = || listeners().fold(false, |any, l| l.sequence() | any);
    if sequence() {
        return Ok(true);
    }
    let until = if timeout == Duration::MAX { None } else { Some(clock::timespec(clock::now_ns() + timeout.as_nanos() as u64)) };
    let until = until.as_ref();
    let slept = match (places[0], count) {
        (None, _) => rustix::thread::clock_nanosleep_absolute(ClockId::Monotonic, until.unwrap_or(&FAR)),
        (Some(listener), 1) => sleep_on(listener, until),
        _ => sleep_on_any(&places[..count], until),
    };
    match slept {
        Ok(()) | Err(Errno::INTR | Errno::AGAIN | Errno::TIMEDOUT) => Ok(sequence()),
        Err(e) => Err(IpcError::System { action: "wait for a message", cause: e.into() }),
    }
}

/// Waits for some microseconds without sleeping, until something was sent to one of the inputs or the monotonic clock reads `until_ns`;
/// at once if something was sent since the last wait. For a thread that keeps nobody from the processor who is waited for. Says whether
/// anything was sent.
pub fn watch(inputs: &[&dyn Wakes], until_ns: u64) -> bool {
    let listeners = || inputs.iter().filter_map(|i| i.listener());
    let mark = |polled| listeners().for_each(|l| l.place().polled.store(polled, Ordering::Relaxed));
    let sequence = || listeners().fold(false, |any, l| l.sequence() | any);
    mark(1);
    let mut last_seen = sequence();
    while !last_seen && clock::now_ns() < until_ns {
        core::hint::spin_loop();
        last_seen = sequence();
    }
    mark(0);
    last_seen
}

/// One who sleeps, or is about to.
struct WaiterGuard<'a>(&'a DoorbellWord);

impl<'a> WaiterGuard<'a> {
    fn on(word: &'a DoorbellWord) -> Self {
        word.waiters.fetch_add(1, Ordering::SeqCst);
        Self(word)
    }
}

impl Drop for WaiterGuard<'_> {
    fn drop(&mut self) {
        self.0.waiters.fetch_sub(1, Ordering::SeqCst);
    }
}

fn sleep_on(listener: &Listener, until: Option<&Timespec>) -> Result<(), Errno> {
    let all = core::num::NonZeroU32::MAX;
    let word = listener.place();
    let _asleep = WaiterGuard::on(word);
    futex::wait_bitset(&word.sequence, futex::Flags::empty(), listener.last_seen.get(), until, all)
}

fn sleep_on_any(places: &[Option<&Listener>], until: Option<&Timespec>) -> Result<(), Errno> {
    let asleep = |i: usize| places.get(i).copied().flatten().map(|listener| WaiterGuard::on(listener.place()));
    let _asleep: [Option<WaiterGuard<'_>>; MAX_WAITS] = core::array::from_fn(asleep);
    let mut waits = [futex::Wait::new(); MAX_WAITS];
    let mut count = 0;
    for (wait, listener) in waits.iter_mut().zip(places.iter().flatten()) {
        wait.val = listener.last_seen.get().into();
        wait.uaddr = futex::WaitPtr::new(listener.place().sequence.as_ptr().cast());
        wait.flags = futex::WaitFlags::SIZE_U32;
        count += 1;
    }
    match futex::waitv(&waits[..count], futex::WaitvFlags::empty(), until, ClockId::Monotonic) {
        Ok(_) => Ok(()),
        Err(Errno::NOSYS) => {
            let Some(first) = places.iter().flatten().next() else { return Ok(()) };
            sleep_on(first, Some(&clock::timespec(clock::now_ns() + POLL_INTERVAL.as_nanos() as u64)))
        }
        Err(e) => Err(e),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::time::Instant;

    const LONG: Duration = Duration::from_secs(60);

    fn doorbells() -> (tempfile::TempDir, Arc<DoorbellPage>) {
        let folder = tempfile::tempdir().unwrap();
        let doorbells = DoorbellPage::open(folder.path().to_str().unwrap()).unwrap();
        (folder, doorbells)
    }

    #[test]
    fn what_was_rung_before_the_wait_is_heard_once() {
        let (folder, doorbells) = doorbells();
        let listener = Listener::new(&doorbells, DoorbellId(3));
        // Another mapping of the same page.
        let other = DoorbellPage::open(folder.path().to_str().unwrap()).unwrap();
        let doorbell = Doorbell::new(&other, DoorbellId(3));
        doorbell.notify();
        doorbell.notify();
        assert!(wait(&[&listener], LONG).unwrap());
        assert!(!wait(&[&listener], Duration::from_millis(1)).unwrap(), "both rings were one wake-up");
        Doorbell::new(&other, DoorbellId(4)).notify();
        assert!(!wait(&[&listener], Duration::from_millis(1)).unwrap(), "that was another place");
    }

    #[test]
    fn rings_are_counted_and_sleepers_seen() {
        let (_folder, doorbells) = doorbells();
        let doorbell = Doorbell::new(&doorbells, DoorbellId(5));
        let before = doorbell.count();
        assert!(!doorbell.has_waiters());
        assert!(!doorbell.spin_until_changed(before, clock::now_ns()), "not sequence");
        std::thread::scope(|scope| {
            scope.spawn(|| wait(&[&Listener::new(&doorbells, DoorbellId(5))], LONG).unwrap());
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
    fn one_who_sleeps_is_woken_by_any_of_several() {
        let (_folder, doorbells) = doorbells();
        for sequence in [1, 2] {
            let (a, b) = (Listener::new(&doorbells, DoorbellId(1)), Listener::new(&doorbells, DoorbellId(2)));
            let doorbell = Doorbell::new(&doorbells, DoorbellId(sequence));
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
            assert!(!wait(&[&a, &b], Duration::ZERO).unwrap(), "place {sequence}: last_seen once");
        }
    }

    #[test]
    fn no_ring_is_lost_between_two_who_take_turns() {
        const TURNS: u32 = 20_000;
        let (_folder, doorbells) = doorbells();
        let done = AtomicU32::new(0);
        std::thread::scope(|scope| {
            for who in [0, 1] {
                let (doorbells, done) = (&doorbells, &done);
                scope.spawn(move || {
                    let (mine, theirs) =
                        (Listener::new(doorbells, DoorbellId(who)), Doorbell::new(doorbells, DoorbellId(1 - who)));
                    let begun = Instant::now();
                    loop {
                        let turn = done.load(Ordering::Acquire);
                        if turn >= TURNS {
                            break theirs.notify();
                        }
                        if turn % 2 == who as u32 {
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
    fn nothing_to_wait_for_is_a_pause() {
        let begun = Instant::now();
        assert!(!wait(&[], Duration::from_millis(5)).unwrap());
        assert!(begun.elapsed() >= Duration::from_millis(5));
    }

    #[test]
    fn a_folder_that_is_not_there_is_refused() {
        let rejected = DoorbellPage::open("/nonexistent/folder").unwrap_err().to_string();
        assert!(rejected.contains("doorbells") && rejected.contains("No such file"), "{rejected}");
    }
}
