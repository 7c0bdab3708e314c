//! Every interleaving of each lock-free primitive, explored by loom: `RUSTFLAGS="--cfg loom" cargo test -p hapfic-sync
//! --release`.
//!
//! Tests of older, wrong designs stand beside those of the present ones: loom finds their faults.
#![cfg(loom)]
#![allow(clippy::unwrap_used, missing_docs)]

use hapfic_sync::{DeadlineWord, DoorbellWord, GenerationCell, PendingId, VersionedCell};
use loom::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use loom::sync::{Arc, Condvar, Mutex};
use loom::thread;

/// Model of the kernel's futex: comparison and sleep are one step under the lock of the hash bucket.
#[derive(Default)]
struct Futex {
    bucket: Mutex<()>,
    waiters: Condvar,
}

impl Futex {
    fn wait(&self, word: &AtomicU32, expected: u32) {
        let held = self.bucket.lock().unwrap();
        if word.load(Ordering::SeqCst) == expected {
            drop(self.waiters.wait(held).unwrap());
        }
    }

    fn wake(&self) {
        drop(self.bucket.lock().unwrap());
        self.waiters.notify_all();
    }
}

/// A notifier and a waiter: no notification is lost. A lost notification would be a deadlock, which loom reports.
#[test]
fn doorbell_waiter_always_wakes() {
    loom::model(|| {
        let shared = Arc::new((DoorbellWord::default(), Futex::default(), AtomicU32::new(0)));
        let theirs = Arc::clone(&shared);
        let notifier = thread::spawn(move || {
            theirs.2.store(1, Ordering::Relaxed);
            theirs.0.notify(|_| theirs.1.wake());
        });
        let (word, futex, message) = &*shared;
        if word.sequence() == 0 {
            let _waiter = word.register();
            futex.wait(word.futex(), 0);
        }
        assert_eq!(word.sequence(), 1, "the only wake-up is the notification");
        assert_eq!(message.load(Ordering::Relaxed), 1, "writes before the notification are visible");
        notifier.join().unwrap();
        assert!(!word.has_waiters());
    });
}

/// The same without a registered waiter: loom finds the lost wake-up.
#[test]
#[should_panic(expected = "deadlock")]
fn doorbell_without_registration_loses_wake_up() {
    loom::model(|| {
        let shared = Arc::new((DoorbellWord::default(), Futex::default()));
        let theirs = Arc::clone(&shared);
        let notifier = thread::spawn(move || theirs.0.notify(|_| theirs.1.wake()));
        shared.1.wait(shared.0.futex(), 0);
        notifier.join().unwrap();
    });
}

/// A deadline that is disarmed or replaced while the helper thread checks it: it fires at most once, and never if
/// replaced.
#[test]
fn deadline_replaced_or_disarmed_never_fires() {
    loom::model(|| {
        let word = Arc::new(DeadlineWord::default());
        word.arm(10);
        let theirs = Arc::clone(&word);
        let helper = thread::spawn(move || [theirs.fire_if_due(10), theirs.fire_if_due(10)]);
        word.arm(20);
        word.disarm();
        let checks = helper.join().unwrap();
        assert!(checks.iter().filter(|(_, fired)| *fired).count() <= 1);
        assert!(checks.iter().all(|(when, fired)| !fired || *when == 10), "the one at 20 is not due");
        assert!(!word.is_armed(), "a late check must not arm it again");
    });
}

/// A reader beside three writes: it never sees words of two writes, and never goes back.
#[test]
fn versioned_cell_reads_whole_writes() {
    loom::model(|| {
        let cell = Arc::new(VersionedCell::<2>::default());
        let theirs = Arc::clone(&cell);
        let writer = thread::spawn(move || (1..=3).for_each(|n| theirs.write([n, 10 * n])));
        let [first, second] = [cell.read(), cell.read()];
        for words in [first, second] {
            assert_eq!(words[1], 10 * words[0]);
        }
        assert!(second[0] >= first[0]);
        writer.join().unwrap();
        assert_eq!(cell.read(), [3, 30]);
    });
}

/// A successor is expected while the predecessor's last heartbeat is recorded: the predecessor does not count
/// afterwards.
#[test]
fn generation_cell_hides_predecessor() {
    loom::model(|| {
        let cell = Arc::new(GenerationCell::<3>::default());
        let theirs = Arc::clone(&cell);
        let recorder = thread::spawn(move || {
            theirs.write(0, [0, 7, 8]);
            theirs.write(1, [0, 1, 2]);
        });
        cell.expect(1);
        if let Some([_, tick, phase]) = cell.read() {
            assert_eq!((tick, phase), (1, 2), "words of the predecessor");
        }
        recorder.join().unwrap();
        assert_eq!(cell.read().map(|words| words[1]), Some(1));
    });
}

/// Heartbeat words of an older design: it checks the generation first, and then stores the words one by one.
struct CheckedFirst {
    generation: AtomicU64,
    tick: AtomicU64,
}

impl CheckedFirst {
    fn record(&self, generation: u64, tick: u64) {
        if self.generation.load(Ordering::Acquire) == generation {
            self.tick.store(tick, Ordering::Relaxed);
        }
    }

    fn expect(&self, generation: u64) {
        self.generation.store(generation, Ordering::Release);
        self.tick.store(0, Ordering::Relaxed);
    }
}

/// Loom finds the race of that design: the predecessor's tick survives into its successor.
#[test]
#[should_panic(expected = "tick of the predecessor")]
fn generation_checked_first_keeps_predecessor() {
    loom::model(|| {
        let words = Arc::new(CheckedFirst { generation: AtomicU64::new(0), tick: AtomicU64::new(0) });
        let theirs = Arc::clone(&words);
        let recorder = thread::spawn(move || theirs.record(0, 7));
        words.expect(1);
        recorder.join().unwrap();
        assert_ne!(words.tick.load(Ordering::Relaxed), 7, "tick of the predecessor");
    });
}

/// An operator's server that withdraws while the gate takes: exactly one of them gets the request.
#[test]
fn pending_id_taken_or_withdrawn() {
    loom::model(|| {
        let pending = Arc::new(PendingId::default());
        pending.open(1);
        let theirs = Arc::clone(&pending);
        let gate = thread::spawn(move || theirs.take(1));
        let withdrawn = pending.withdraw(1);
        let taken = gate.join().unwrap();
        assert!(withdrawn != taken);
        assert!(!pending.take(1) && !pending.withdraw(1), "closed for good");
    });
}

/// A request that was withdrawn and replaced: the gate, which finds the old request in its queue first, takes only the
/// new one.
#[test]
fn pending_id_replaced_request_not_taken() {
    loom::model(|| {
        let pending = Arc::new(PendingId::default());
        pending.open(1);
        assert!(pending.withdraw(1));
        let theirs = Arc::clone(&pending);
        let gate = thread::spawn(move || (theirs.take(1), theirs.take(2)));
        pending.open(2);
        let (old, new) = gate.join().unwrap();
        assert!(!old);
        assert!(new != pending.withdraw(2));
    });
}
