//! Page of the operator's changes in the run's folder: requests of the supervisor, decisions of the gate.
//!
//! The supervisor waits for a bounded time, and the gate must not make a change whose caller has given up. [`PendingId`]
//! marks the newest request as pending: either the gate takes it or the supervisor withdraws it, never both. Changes that
//! are placed stay in the page until they are in force, so that another gate can take over.

use crate::error::IpcError;
use crate::shared_page::{PageContent, SharedPage};
use core::sync::atomic::{AtomicI64, AtomicU32, AtomicU64, Ordering, fence};
use hapfic_sync::PendingId;

/// Name of the page in the run's folder.
const FILE: &str = "changes";
/// Changes in the page.
pub const CHANGES: u64 = 64;
/// Longest text of a change, or of its answer [bytes].
pub const CHANGE_TEXT: usize = 4096;

/// Text of bounded length in words, each written and read alone.
#[derive(Debug)]
#[repr(C)]
struct Text {
    length: AtomicU64,
    words: [AtomicU64; CHANGE_TEXT / 8],
}

impl Text {
    /// Writes a text; one that is too long is an empty one.
    fn write(&self, text: &str) {
        let bytes = if text.len() <= CHANGE_TEXT { text.as_bytes() } else { &[] };
        for (word, chunk) in self.words.iter().zip(bytes.chunks(8)) {
            let mut padded = [0; 8];
            padded[..chunk.len()].copy_from_slice(chunk);
            word.store(u64::from_le_bytes(padded), Ordering::Relaxed);
        }
        self.length.store(bytes.len() as u64, Ordering::Release);
    }

    fn read(&self) -> String {
        let length = usize::try_from(self.length.load(Ordering::Acquire)).unwrap_or(0).min(CHANGE_TEXT);
        let words = &self.words[..length.div_ceil(8)];
        let mut bytes: Vec<u8> = words.iter().flat_map(|word| word.load(Ordering::Relaxed).to_le_bytes()).collect();
        bytes.truncate(length);
        String::from_utf8(bytes).unwrap_or_default()
    }
}

/// A change and its decision.
#[derive(Debug)]
#[repr(C)]
struct Change {
    id: AtomicU64,
    request: Text,
    /// Code of the decision plus one; 0: none yet.
    decision: AtomicU32,
    /// Whether the answer is complete.
    answered: AtomicU32,
    effective_tick: AtomicI64,
    version: AtomicU64,
    taken_tick: AtomicI64,
    answer: Text,
}

#[derive(Debug)]
#[repr(C)]
struct Content {
    pending: PendingId,
    newest: AtomicU64,
    changes: [Change; CHANGES as usize],
}

// SAFETY: atomics only, and zero stands for no change; `PendingId` is an atomic word, of which zero names no request.
unsafe impl PageContent for Content {}

/// Decision on a change, as the page keeps it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decision {
    /// Code of the decision.
    pub code: u32,
    /// First tick of the new set.
    pub effective_tick: i64,
    /// Version of the new set.
    pub version: u64,
    /// Tick that was due when the gate took the request.
    pub taken_tick: i64,
}

/// The page of a run's changes.
#[derive(Debug)]
pub struct ChangePage(SharedPage<Content>);

impl ChangePage {
    /// Maps the page in a run's folder; creates it if it is missing.
    ///
    /// # Errors
    /// [`IpcError::System`] if that fails.
    pub fn open(folder: &str) -> Result<Self, IpcError> {
        SharedPage::open(folder, FILE, "share the changes of the run").map(Self)
    }

    /// Maps a page that only this process sees.
    ///
    /// # Errors
    /// [`IpcError::System`] without memory.
    pub fn private() -> Result<Self, IpcError> {
        SharedPage::private().map(Self)
    }

    fn change(&self, id: u64) -> &Change {
        &self.0.changes[(id % CHANGES) as usize]
    }

    /// Makes a request pending, in place of the previous one, and returns its id. Only the supervisor may call it.
    pub fn open_request(&self, text: &str) -> u64 {
        let id = self.newest() + 1;
        let change = self.change(id);
        change.id.store(0, Ordering::Relaxed);
        fence(Ordering::Release);
        change.decision.store(0, Ordering::Relaxed);
        change.answered.store(0, Ordering::Relaxed);
        change.request.write(text);
        change.id.store(id, Ordering::Release);
        self.0.pending.open(id);
        self.0.newest.store(id, Ordering::Release);
        id
    }

    /// Withdraws a request. Returns `false` if the gate has taken it.
    #[must_use]
    pub fn withdraw(&self, id: u64) -> bool {
        self.0.pending.withdraw(id)
    }

    /// Takes a request for the gate. Returns `false` if it was withdrawn, replaced or taken before.
    #[must_use]
    pub fn take(&self, id: u64) -> bool {
        self.0.pending.take(id)
    }

    /// Id of the newest request; 0 before the first.
    #[must_use]
    pub fn newest(&self) -> u64 {
        self.0.newest.load(Ordering::Acquire)
    }

    /// Text of a request; `None` if it is not in the page any more.
    #[must_use]
    pub fn request(&self, id: u64) -> Option<String> {
        let change = self.change(id);
        let before = change.id.load(Ordering::Acquire);
        let text = change.request.read();
        fence(Ordering::Acquire);
        (before == id && change.id.load(Ordering::Relaxed) == id).then_some(text)
    }

    /// Notes the decision on a request; wait-free, for the gate alone.
    pub fn decide(&self, id: u64, decision: Decision) {
        let change = self.change(id);
        change.effective_tick.store(decision.effective_tick, Ordering::Relaxed);
        change.version.store(decision.version, Ordering::Relaxed);
        change.taken_tick.store(decision.taken_tick, Ordering::Relaxed);
        change.decision.store(decision.code + 1, Ordering::Release);
    }

    /// Decision on a request; `None` before it.
    #[must_use]
    pub fn decision(&self, id: u64) -> Option<Decision> {
        let change = self.change(id);
        let code = change.decision.load(Ordering::Acquire).checked_sub(1)?;
        Some(Decision {
            code,
            effective_tick: change.effective_tick.load(Ordering::Relaxed),
            version: change.version.load(Ordering::Relaxed),
            taken_tick: change.taken_tick.load(Ordering::Relaxed),
        })
    }

    /// Answers a request.
    pub fn answer(&self, id: u64, text: &str) {
        let change = self.change(id);
        change.answer.write(text);
        change.answered.store(1, Ordering::Release);
    }

    /// Answer to a request; `None` before it.
    #[must_use]
    pub fn answer_to(&self, id: u64) -> Option<String> {
        let change = self.change(id);
        (change.answered.load(Ordering::Acquire) != 0).then(|| change.answer.read())
    }

    /// Ids of the requests in the page, the oldest first.
    pub fn ids(&self) -> impl Iterator<Item = u64> {
        let newest = self.newest();
        newest.saturating_sub(CHANGES - 1).max(1)..=newest
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn request_is_taken_or_withdrawn_and_answered() {
        let folder = tempfile::tempdir().unwrap();
        let open = || ChangePage::open(folder.path().to_str().unwrap()).unwrap();
        let (supervisor, gate) = (open(), open());
        assert_eq!((gate.newest(), gate.ids().count()), (0, 0));
        let id = supervisor.open_request("a change of 20 bytes");
        assert_eq!((id, gate.newest(), gate.request(id).as_deref()), (1, 1, Some("a change of 20 bytes")));
        assert!(gate.take(id) && !supervisor.withdraw(id) && !gate.take(id));
        assert_eq!((supervisor.decision(id), supervisor.answer_to(id)), (None, None));
        let decision = Decision { code: 0, effective_tick: 9, version: 3, taken_tick: 4 };
        gate.decide(id, decision);
        gate.answer(id, "{}");
        assert_eq!(supervisor.decision(id), Some(decision));
        assert_eq!(supervisor.answer_to(id).as_deref(), Some("{}"));
        let id = supervisor.open_request("x");
        assert!(supervisor.withdraw(id) && !gate.take(id));
        assert_eq!(gate.ids().collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn old_requests_leave_the_page() {
        let page = ChangePage::private().unwrap();
        (0..CHANGES + 3).for_each(|number| {
            page.open_request(&number.to_string());
        });
        assert_eq!(page.ids().next(), Some(4));
        assert_eq!((page.request(3), page.request(4)), (None, Some("3".to_owned())));
        let long = page.open_request(&"x".repeat(CHANGE_TEXT + 1));
        assert_eq!(page.request(long).as_deref(), Some(""));
    }
}
