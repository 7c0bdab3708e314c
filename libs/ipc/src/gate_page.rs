//! Page of the two gates in the run's folder: which of them gates at present, the lock under which a tick is gated, and the
//! last command and parameter sets.
//!
//! Each tick has one owner: whoever holds the lock. It is a robust mutex shared between processes, so the kernel releases it
//! when its owner dies, and the next owner learns that from the call. A gate holds it from its look at the inputs to the
//! publication of the command, never while it waits.
//!
//! The owner writes the command here before it publishes it. The next owner begins with it, whether it has reached every
//! process, some, or none: so there is never a second command of a tick. The page outlives both gates.

use crate::error::IpcError;
use crate::shared_page::{PageContent, SharedPage};
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use hapfic_messages::{Command, Message, Operator, Process};
use zerocopy::IntoBytes;

/// Name of the page in the run's folder.
const FILE: &str = "gates";

#[derive(Debug)]
#[repr(C)]
struct Content {
    lock: UnsafeCell<libc::pthread_mutex_t>,
    /// 0: the gate, 1: the spare gate.
    active: AtomicU32,
    /// Last command: 1 + its entry + 2 x its tick, of which the first is 0; 0: none.
    newest: AtomicU64,
    /// Last published tick plus one.
    published: AtomicU64,
    entries: [Entry; 2],
}

/// A command, and the parameter sets published last with it.
#[derive(Debug)]
#[repr(C)]
struct Entry {
    command: Words<{ size_of::<Command>() / 8 }>,
    /// Version announced last in `sets`, plus one; equal versions have equal sets.
    version: AtomicU64,
    sets: Words<{ size_of::<Operator>() / 8 }>,
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
        let next = self.0.newest().map_or(0, |(entry, _)| 1 - entry);
        let entry = &self.0.0.entries[next];
        entry.command.write(command);
        let version = sets.next.version + 1;
        if entry.version.load(Ordering::Relaxed) != version {
            entry.version.store(0, Ordering::Relaxed);
            entry.sets.write(sets);
            entry.version.store(version, Ordering::Relaxed);
        }
        self.0.0.newest.store(1 + next as u64 + 2 * command.tick as u64, Ordering::Release);
    }

    /// Last command and sets, if its tick is after `tick`.
    #[must_use]
    pub fn read_after(&self, tick: i64) -> Option<(Command, Operator)> {
        let (entry, _) = self.0.newest().filter(|(_, newest)| *newest > tick)?;
        let entry = &self.0.0.entries[entry];
        Some((entry.command.read(), entry.sets.read()))
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

    /// Whether a command was ever written.
    #[must_use]
    pub fn has_command(&self) -> bool {
        self.newest().is_some()
    }

    /// Entry and tick of the last command; `None` before the first.
    fn newest(&self) -> Option<(usize, i64)> {
        let word = self.0.newest.load(Ordering::Acquire).checked_sub(1)?;
        Some(((word % 2) as usize, (word / 2) as i64))
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
        assert!(lock.read_after(-1).is_none() && !page.has_command());
        for tick in 0..5 {
            let command = Command { tick, torque: [1.0 / 3.0; hapfic_messages::MAX_JOINTS], ..Command::default() };
            let mut sets = Operator::default();
            sets.next.version = tick as u64;
            lock.write(&command, &sets);
            assert_eq!(lock.read_after(tick - 1), Some((command, sets)));
            assert!(lock.read_after(tick).is_none());
        }
        drop(lock);
        let Locked::Own(theirs) = other.try_lock() else { panic!("the lock is free") };
        assert_eq!(theirs.read_after(-1).map(|(command, _)| command.tick), Some(4));
        drop(theirs);
        page.set_active(Process::SpareGate);
        page.set_published(7);
        assert_eq!((other.active(), other.published()), (Process::SpareGate, 7));
    }
}
