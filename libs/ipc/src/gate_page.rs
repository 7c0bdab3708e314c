//! Page of the two gates in the run's folder: which of them gates at present, the lock under which a tick is gated, and the
//! last command and parameter sets.
//!
//! Each tick has one owner: the holder of the lock. It is a robust mutex shared between processes, so the kernel releases it
//! when its owner dies, and the next owner learns that from the call. A gate holds it from its look at the inputs to the
//! publication of the command, never while it waits.
//!
//! The owner writes the command here before it publishes it. The next owner begins with it, whether it has reached every
//! process, some, or none: so there is never a second command of a tick. The page outlives both gates.

use crate::error::IpcError;
use crate::shared_page::{PageContent, SharedPage};
use crate::topic;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use hapfic_messages::{Command, Message, Operator, Process};
use zerocopy::IntoBytes;

/// Name of the page in the run's folder.
const FILE: &str = "gates";
/// Last commands in the page: as many as a late joiner needs.
const HISTORY: usize = topic::HISTORY_DEPTH;

#[derive(Debug)]
#[repr(C)]
struct Content {
    lock: UnsafeCell<libc::pthread_mutex_t>,
    /// 0: the gate, 1: the spare gate.
    active: AtomicU32,
    /// Tick of the last command that was written, plus one.
    written: AtomicU64,
    /// Last published tick plus one.
    published: AtomicU64,
    /// Commands by their tick modulo their number. The oldest is overwritten, which is none of the last [`HISTORY`].
    commands: [Words<{ size_of::<Command>() / 8 }>; HISTORY + 1],
    /// Version announced in the last sets, plus one, and the sets by their version modulo two.
    version: AtomicU64,
    sets: [Words<{ size_of::<Operator>() / 8 }>; 2],
}

/// A message word by word: its size is a multiple of eight bytes.
#[derive(Debug)]
#[repr(C)]
struct Words<const N: usize>([AtomicU64; N]);

impl<const N: usize> Words<N> {
    fn write<T: Message>(&self, message: &T) {
        const { assert!(size_of::<T>() == 8 * N) };
        for (word, bytes) in self.0.iter().zip(message.as_bytes().chunks_exact(8)) {
            let mut padded = [0; 8];
            padded.copy_from_slice(bytes);
            word.store(u64::from_ne_bytes(padded), Ordering::Relaxed);
        }
    }

    fn read<T: Message>(&self) -> T {
        const { assert!(size_of::<T>() == 8 * N) };
        let words: [u64; N] = core::array::from_fn(|i| self.0[i].load(Ordering::Relaxed));
        // The sizes are equal.
        T::read_from_bytes(words.as_bytes()).unwrap_or_else(|_| T::new_zeroed())
    }
}

// SAFETY: the lock is touched by the C library alone, which makes it usable from several threads and processes. It is
// initialised by `create`, before any other process opens the page. The rest are atomics; those of an entry are written and
// read under the lock.
unsafe impl Sync for Content {}
// SAFETY: as above; it is never moved.
unsafe impl Send for Content {}
// SAFETY: as above. Zero is the static initial value of a mutex of glibc and musl, and of the atomics.
unsafe impl PageContent for Content {}

/// The page of a run's gates.
#[derive(Debug)]
pub struct GatePage(SharedPage<Content>);

/// Place of a tick's command.
fn index(tick: i64) -> usize {
    tick.rem_euclid(HISTORY as i64 + 1) as usize
}

/// Result of an attempt to lock.
#[derive(Debug)]
pub enum Locked<'a> {
    /// The caller owns the tick.
    Own(GateLock<'a>),
    /// The caller owns the tick; the owner before has died with it, and may have published it.
    Inherited(GateLock<'a>),
    /// Another gate owns it.
    Busy,
}

/// Ownership of the tick; ends when dropped.
#[derive(Debug)]
pub struct GateLock<'a>(&'a GatePage);

impl GateLock<'_> {
    /// Writes the command that the owner is about to publish, with the parameter sets published last. A gate that dies in
    /// between leaves the command before it.
    pub fn write(&self, command: &Command, sets: &Operator) {
        let page = &self.0.0;
        let version = sets.next.version + 1;
        if page.version.load(Ordering::Relaxed) != version {
            page.sets[version as usize % 2].write(sets);
            page.version.store(version, Ordering::Release);
        }
        page.commands[index(command.tick)].write(command);
        page.written.store((command.tick + 1) as u64, Ordering::Release);
    }

    /// Last commands, the oldest first, and the sets published last; none before the first.
    pub fn read(&self) -> (impl Iterator<Item = Command> + use<'_>, Option<Operator>) {
        let page = &self.0.0;
        let written = self.0.written();
        let first = (written + 1 - HISTORY as i64).max(0);
        let commands = (first..=written).map(|tick| page.commands[index(tick)].read::<Command>());
        let sets = page.version.load(Ordering::Acquire).checked_sub(1).map(|_| {
            let version = page.version.load(Ordering::Relaxed);
            page.sets[version as usize % 2].read()
        });
        (commands, sets)
    }
}

impl Drop for GateLock<'_> {
    fn drop(&mut self) {
        // SAFETY: an initialised mutex that the calling thread has locked.
        unsafe { libc::pthread_mutex_unlock(self.0.0.lock.get()) };
    }
}

impl GatePage {
    /// Creates the page of a run in its folder. Only the supervisor may call it, before any gate starts.
    ///
    /// # Errors
    /// [`IpcError::System`] if the page cannot be created, or the system has no robust locks.
    pub fn create(folder: &str) -> Result<Self, IpcError> {
        let page = Self::open(folder)?;
        page.initialise()?;
        Ok(page)
    }

    /// Maps the page of a run in its folder.
    ///
    /// # Errors
    /// [`IpcError::System`] if that fails.
    pub fn open(folder: &str) -> Result<Self, IpcError> {
        SharedPage::open(folder, FILE, "share the page of the gates").map(Self)
    }

    fn initialise(&self) -> Result<(), IpcError> {
        let mut attributes = MaybeUninit::<libc::pthread_mutexattr_t>::uninit();
        let checked = |code: libc::c_int| {
            let cause = std::io::Error::from_raw_os_error(code);
            if code == 0 { Ok(()) } else { Err(IpcError::System { action: "make the lock of the gates", cause }) }
        };
        // SAFETY: `attributes` lives through the calls and is initialised by the first; no other thread or process uses
        // the mutex yet.
        unsafe {
            checked(libc::pthread_mutexattr_init(attributes.as_mut_ptr()))?;
            let made = checked(libc::pthread_mutexattr_setpshared(attributes.as_mut_ptr(), libc::PTHREAD_PROCESS_SHARED))
                .and_then(|()| checked(libc::pthread_mutexattr_setrobust(attributes.as_mut_ptr(), libc::PTHREAD_MUTEX_ROBUST)))
                .and_then(|()| checked(libc::pthread_mutex_init(self.0.lock.get(), attributes.as_ptr())));
            libc::pthread_mutexattr_destroy(attributes.as_mut_ptr());
            made
        }
    }

    /// Tries to own the tick; never waits, and makes no system call.
    #[must_use]
    pub fn try_lock(&self) -> Locked<'_> {
        // SAFETY: a mutex that `create` has initialised.
        match unsafe { libc::pthread_mutex_trylock(self.0.lock.get()) } {
            0 => Locked::Own(GateLock(self)),
            libc::EOWNERDEAD => {
                // SAFETY: the calling thread has just locked it. What it protects is the next command, which the new owner
                // derives from the last published one.
                unsafe { libc::pthread_mutex_consistent(self.0.lock.get()) };
                Locked::Inherited(GateLock(self))
            }
            _ => Locked::Busy,
        }
    }

    /// The gate that gates at present: [`Process::Gate`] or [`Process::SpareGate`].
    #[must_use]
    pub fn active(&self) -> Process {
        if self.0.active.load(Ordering::Acquire) == 0 { Process::Gate } else { Process::SpareGate }
    }

    /// Makes a gate the one that gates from now on.
    pub fn set_active(&self, gate: Process) {
        self.0.active.store((gate == Process::SpareGate).into(), Ordering::Release);
    }

    /// Notes the tick that the owner has published.
    pub fn set_published(&self, tick: i64) {
        self.0.published.store((tick + 1) as u64, Ordering::Release);
    }

    /// Tick of the last command that was written; -1 before the first.
    #[must_use]
    pub fn written(&self) -> i64 {
        self.0.written.load(Ordering::Acquire) as i64 - 1
    }

    /// Last published tick; -1 before the first.
    #[must_use]
    pub fn published(&self) -> i64 {
        self.0.published.load(Ordering::Acquire) as i64 - 1
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn lock_has_one_owner_and_outlives_it() {
        let folder = tempfile::tempdir().unwrap();
        let page = GatePage::create(folder.path().to_str().unwrap()).unwrap();
        let other = GatePage::open(folder.path().to_str().unwrap()).unwrap();
        assert_eq!((page.active(), page.published()), (Process::Gate, -1));
        let own = page.try_lock();
        assert!(matches!(own, Locked::Own(_)));
        std::thread::scope(|scope| {
            scope.spawn(|| assert!(matches!(other.try_lock(), Locked::Busy)));
        });
        drop(own);
        // A thread that ends with the lock leaves it as a process that dies does.
        let other = std::sync::Arc::new(other);
        let dying = std::sync::Arc::clone(&other);
        std::thread::spawn(move || std::mem::forget(dying.try_lock())).join().unwrap();
        assert!(matches!(page.try_lock(), Locked::Inherited(_)));
        assert!(matches!(page.try_lock(), Locked::Own(_)), "once");
        let Locked::Own(lock) = page.try_lock() else { panic!("no other owner is left") };
        assert!(lock.read().0.next().is_none() && lock.read().1.is_none() && page.written() == -1);
        let made = |tick: i64| {
            let command = Command { tick, torque: [1.0 / 3.0; hapfic_messages::MAX_JOINTS], ..Command::default() };
            let mut sets = Operator::default();
            sets.next.version = tick as u64 / 2;
            (command, sets)
        };
        for tick in 0..12 {
            let (command, sets) = made(tick);
            lock.write(&command, &sets);
            let (commands, last) = lock.read();
            let expected: Vec<_> = ((tick - 3).max(0)..=tick).map(|tick| made(tick).0).collect();
            assert_eq!((commands.collect::<Vec<_>>(), last, page.written()), (expected, Some(sets), tick));
        }
        drop(lock);
        let Locked::Own(theirs) = other.try_lock() else { panic!("the lock is free") };
        assert_eq!(theirs.read().0.map(|command| command.tick).collect::<Vec<_>>(), [8, 9, 10, 11]);
        drop(theirs);
        page.set_active(Process::SpareGate);
        page.set_published(7);
        assert_eq!((other.active(), other.published()), (Process::SpareGate, 7));
    }
}
