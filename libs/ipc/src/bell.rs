//! Waking each other: a page of counters that all processes of a run share, and futexes on them.
//!
//! iceoryx2 carries the messages; its own events would do the waking, through Unix datagram sockets: two to three system calls a
//! hop, and a socket for each pair of processes. Here whoever has sent something adds one to the topic's counter and wakes all who
//! sleep on it (one system call; none if nobody does); whoever waits sleeps as long as the counter is what it was when he last looked
//! (one system call, none if it is not), or [looks at it](watch) for some microseconds. A process that dies leaves no lock behind, only
//! numbers: if it slept, the count of sleepers stays too high, and each ring makes its system call.

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
const FILE: &str = "bells";
/// Counters, each on a cache line of its own.
const PLACES: usize = 16;
/// Most that one may wait for at once.
const MAX_WAITS: usize = 4;
/// How often it is looked round where the kernel cannot wait for several counters at once (before Linux 5.16).
const LOOK_EVERY: Duration = Duration::from_micros(500);

/// Some time after all runs.
const FAR: Timespec = Timespec { tv_sec: i64::MAX, tv_nsec: 0 };

/// Which bell; the same in every process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place(pub(crate) usize);

/// A bell's place in the page.
#[derive(Debug)]
#[repr(C, align(64))]
struct Counter {
    /// How often it was rung.
    rung: AtomicU32,
    /// Threads that sleep on it, or are about to; more than that once one was killed while it slept.
    sleepers: AtomicU32,
    /// Whether somebody looks at it all the time.
    watched: AtomicU32,
}

type Counters = [Counter; PLACES];

/// The page, mapped.
#[derive(Debug)]
pub(crate) struct Bells(*mut Counters);

// SAFETY: the page holds atomics only, and stays mapped until the last owner is gone.
unsafe impl Send for Bells {}
// SAFETY: as above.
unsafe impl Sync for Bells {}

impl Bells {
    /// Maps the page in a run's folder; makes it if it is not there.
    pub(crate) fn open(folder: &str) -> Result<Arc<Self>, IpcError> {
        let path = Path::new(folder).join(FILE);
        let system = |e: Errno| IpcError::System { action: "share the bells of the run", cause: e.into() };
        let file =
            rustix::fs::open(&path, OFlags::RDWR | OFlags::CREATE | OFlags::CLOEXEC, Mode::RUSR | Mode::WUSR).map_err(system)?;
        let size = size_of::<Counters>();
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

    fn counter(&self, place: Place) -> &Counter {
        // SAFETY: the page is mapped as long as `self` lives, is as long as `Counters`, page-aligned, and holds atomics only, for
        // which every bit pattern is good.
        let counters = unsafe { &*self.0 };
        &counters[place.0]
    }
}

impl Drop for Bells {
    fn drop(&mut self) {
        // SAFETY: mapped in `open` with this size, and nobody has a reference any more. What cannot be unmapped stays.
        let _ = unsafe { rustix::mm::munmap(self.0.cast(), size_of::<Counters>()) };
    }
}

/// Wakes those who wait at a place.
#[derive(Clone, Debug)]
pub struct Bell {
    bells: Arc<Bells>,
    place: Place,
}

impl Bell {
    pub(crate) fn new(bells: &Arc<Bells>, place: Place) -> Self {
        Self { bells: Arc::clone(bells), place }
    }

    /// Wakes them all. They look around, and find what has changed.
    pub fn ring(&self) {
        let counter = self.bells.counter(self.place);
        // What was sent before is seen by whoever sees this. One order for all of this and for falling asleep: either the sleeper is
        // seen here, or the ring there.
        counter.rung.fetch_add(1, Ordering::SeqCst);
        if counter.sleepers.load(Ordering::SeqCst) != 0 {
            // Nothing can go wrong with a mapped word.
            let _ = futex::wake(&counter.rung, futex::Flags::empty(), i32::MAX as u32);
        }
    }

    /// How often it has been rung.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.bells.counter(self.place).rung.load(Ordering::SeqCst)
    }

    /// Whether somebody sleeps on it, whom a ring would wake.
    #[must_use]
    pub fn is_slept_on(&self) -> bool {
        self.bells.counter(self.place).sleepers.load(Ordering::SeqCst) != 0
    }

    /// Looks, without sleeping, until it has been rung more often than `count` times or the monotonic clock reads `until_ns`. Says
    /// whether it was.
    #[must_use]
    pub fn rings_after(&self, count: u32, until_ns: u64) -> bool {
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
    pub fn is_watched(&self) -> bool {
        self.bells.counter(self.place).watched.load(Ordering::Relaxed) != 0
    }
}

/// Hears a bell.
#[derive(Debug)]
pub struct Listener {
    bell: Bell,
    heard: Cell<u32>,
}

impl Listener {
    pub(crate) fn new(bells: &Arc<Bells>, place: Place) -> Self {
        let bell = Bell::new(bells, place);
        let heard = Cell::new(bell.bells.counter(place).rung.load(Ordering::Acquire));
        Self { bell, heard }
    }

    fn place(&self) -> &Counter {
        self.bell.bells.counter(self.bell.place)
    }

    /// Has the next wait not end by what was sent before now.
    pub fn forget(&self) {
        let _ = self.rung();
    }

    /// Whether it was rung since this was last asked.
    fn rung(&self) -> bool {
        let now = self.place().rung.load(Ordering::SeqCst);
        self.heard.replace(now) != now
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
/// [`Duration::MAX`] is for ever, and cheaper than any time-out (see [`crate::alarm`]). Inputs opened with [`crate::Wait::No`] are passed
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
    // Each is asked: what one has heard must not wake it again.
    let rung = || listeners().fold(false, |any, l| l.rung() | any);
    if rung() {
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
        Ok(()) | Err(Errno::INTR | Errno::AGAIN | Errno::TIMEDOUT) => Ok(rung()),
        Err(e) => Err(IpcError::System { action: "wait for a message", cause: e.into() }),
    }
}

/// Waits for some microseconds without sleeping, until something was sent to one of the inputs or the monotonic clock reads `until_ns`;
/// at once if something was sent since the last wait. For a thread that keeps nobody from the processor who is waited for. Says whether
/// anything was sent.
pub fn watch(inputs: &[&dyn Wakes], until_ns: u64) -> bool {
    let listeners = || inputs.iter().filter_map(|i| i.listener());
    let mark = |watched| listeners().for_each(|l| l.place().watched.store(watched, Ordering::Relaxed));
    let rung = || listeners().fold(false, |any, l| l.rung() | any);
    mark(1);
    let mut heard = rung();
    while !heard && clock::now_ns() < until_ns {
        core::hint::spin_loop();
        heard = rung();
    }
    mark(0);
    heard
}

/// One who sleeps, or is about to.
struct Asleep<'a>(&'a Counter);

impl<'a> Asleep<'a> {
    fn on(counter: &'a Counter) -> Self {
        counter.sleepers.fetch_add(1, Ordering::SeqCst);
        Self(counter)
    }
}

impl Drop for Asleep<'_> {
    fn drop(&mut self) {
        self.0.sleepers.fetch_sub(1, Ordering::SeqCst);
    }
}

fn sleep_on(listener: &Listener, until: Option<&Timespec>) -> Result<(), Errno> {
    let all = core::num::NonZeroU32::MAX;
    let counter = listener.place();
    let _asleep = Asleep::on(counter);
    futex::wait_bitset(&counter.rung, futex::Flags::empty(), listener.heard.get(), until, all)
}

fn sleep_on_any(places: &[Option<&Listener>], until: Option<&Timespec>) -> Result<(), Errno> {
    let asleep = |i: usize| places.get(i).copied().flatten().map(|listener| Asleep::on(listener.place()));
    let _asleep: [Option<Asleep<'_>>; MAX_WAITS] = core::array::from_fn(asleep);
    let mut waits = [futex::Wait::new(); MAX_WAITS];
    let mut count = 0;
    for (wait, listener) in waits.iter_mut().zip(places.iter().flatten()) {
        wait.val = listener.heard.get().into();
        wait.uaddr = futex::WaitPtr::new(listener.place().rung.as_ptr().cast());
        wait.flags = futex::WaitFlags::SIZE_U32;
        count += 1;
    }
    match futex::waitv(&waits[..count], futex::WaitvFlags::empty(), until, ClockId::Monotonic) {
        Ok(_) => Ok(()),
        Err(Errno::NOSYS) => {
            let Some(first) = places.iter().flatten().next() else { return Ok(()) };
            sleep_on(first, Some(&clock::timespec(clock::now_ns() + LOOK_EVERY.as_nanos() as u64)))
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

    fn bells() -> (tempfile::TempDir, Arc<Bells>) {
        let folder = tempfile::tempdir().unwrap();
        let bells = Bells::open(folder.path().to_str().unwrap()).unwrap();
        (folder, bells)
    }

    #[test]
    fn what_was_rung_before_the_wait_is_heard_once() {
        let (folder, bells) = bells();
        let listener = Listener::new(&bells, Place(3));
        // Another mapping of the same page.
        let other = Bells::open(folder.path().to_str().unwrap()).unwrap();
        let bell = Bell::new(&other, Place(3));
        bell.ring();
        bell.ring();
        assert!(wait(&[&listener], LONG).unwrap());
        assert!(!wait(&[&listener], Duration::from_millis(1)).unwrap(), "both rings were one wake-up");
        Bell::new(&other, Place(4)).ring();
        assert!(!wait(&[&listener], Duration::from_millis(1)).unwrap(), "that was another place");
    }

    #[test]
    fn rings_are_counted_and_sleepers_seen() {
        let (_folder, bells) = bells();
        let bell = Bell::new(&bells, Place(5));
        let before = bell.count();
        assert!(!bell.is_slept_on());
        assert!(!bell.rings_after(before, clock::now_ns()), "not rung");
        std::thread::scope(|scope| {
            scope.spawn(|| wait(&[&Listener::new(&bells, Place(5))], LONG).unwrap());
            let begun = Instant::now();
            while !bell.is_slept_on() {
                assert!(begun.elapsed() < LONG);
            }
            bell.ring();
        });
        assert!(!bell.is_slept_on());
        assert!(bell.rings_after(before, u64::MAX));
        assert_eq!(bell.count(), before.wrapping_add(1));
    }

    #[test]
    fn one_who_sleeps_is_woken_by_any_of_several() {
        let (_folder, bells) = bells();
        for rung in [1, 2] {
            let (a, b) = (Listener::new(&bells, Place(1)), Listener::new(&bells, Place(2)));
            let bell = Bell::new(&bells, Place(rung));
            let begun = Instant::now();
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    while !bell.is_slept_on() {
                        assert!(begun.elapsed() < LONG);
                    }
                    bell.ring();
                });
                while !wait(&[&a, &b], LONG).unwrap() {
                    assert!(begun.elapsed() < LONG);
                }
            });
            assert!(!wait(&[&a, &b], Duration::ZERO).unwrap(), "place {rung}: heard once");
        }
    }

    #[test]
    fn no_ring_is_lost_between_two_who_take_turns() {
        const TURNS: u32 = 20_000;
        let (_folder, bells) = bells();
        let done = AtomicU32::new(0);
        std::thread::scope(|scope| {
            for who in [0, 1] {
                let (bells, done) = (&bells, &done);
                scope.spawn(move || {
                    let (mine, theirs) = (Listener::new(bells, Place(who)), Bell::new(bells, Place(1 - who)));
                    let begun = Instant::now();
                    loop {
                        let turn = done.load(Ordering::Acquire);
                        if turn >= TURNS {
                            break theirs.ring();
                        }
                        if turn % 2 == who as u32 {
                            done.store(turn + 1, Ordering::Release);
                            theirs.ring();
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
        let refused = Bells::open("/nonexistent/folder").unwrap_err().to_string();
        assert!(refused.contains("bells") && refused.contains("No such file"), "{refused}");
    }
}
