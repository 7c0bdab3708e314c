//! Prefaulting: loads memory before its first use, for the program's code, the heap, and messages.
//!
//! Locked memory stays once it is used (see [`crate::realtime::lock_memory`]); the first use is a page fault, about a
//! microsecond. So a real-time process prefaults all that it may use, and no more: its code and libraries, a heap
//! reserve, and as many messages of each topic as can be in flight. Without real time nothing is prefaulted.

use crate::topic::RECORDER_DEPTH;
use core::ffi::{c_int, c_void};
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::service::header::publish_subscribe::Header;
use rustix::mm::{Advice, madvise};

/// Heap reserve of each real-time thread [bytes]: a loan at a time, and new connections (some 50 kB each).
const HEAP: usize = 512 << 10;
/// Size of the pieces that fill the reserve [bytes]: the allocator takes these from its heap instead of mapping them.
const PIECE: usize = 64 << 10;
/// Messages of a sender that can be in flight: the recorder's backlog, and the contents of short queues, histories and
/// loans. A sender reuses the sample returned last, so it never uses more.
const IN_FLIGHT: usize = RECORDER_DEPTH + 128;
/// Senders of a topic that a receiver remembers as prefaulted.
const SENDERS: usize = 4;
/// Size of a page [bytes]. Larger pages do no harm.
const PAGE: usize = 4096;

/// Whether prefaulting is on.
static ENABLED: AtomicBool = AtomicBool::new(false);

/// Turns prefaulting on.
pub(crate) fn enable() {
    ENABLED.store(true, Ordering::Relaxed);
}

fn enabled() -> bool {
    ENABLED.load(Ordering::Relaxed)
}

/// Prefaults a range of addresses for reading or writing. Before Linux 5.14 it does nothing: pages then fault in at
/// first use.
fn prefault(from: usize, bytes: usize, advice: Advice) {
    let start = from - from % PAGE;
    let ptr = core::ptr::without_provenance_mut::<c_void>(start);
    // SAFETY: the advices passed here change no contents and remove no mapping; an unmapped address is an error.
    let _ = unsafe { madvise(ptr, (from + bytes - start).next_multiple_of(PAGE), advice) };
}

/// Prefaults shared words for writing.
pub(crate) fn prefault_shared(words: &[AtomicU64]) {
    if enabled() {
        prefault(words.as_ptr() as usize, size_of_val(words), Advice::LinuxPopulateWrite);
    }
}

/// Prefaults the program's code, and the libraries as a whole.
///
/// The program's constants fault in at first use: most of them belong to reports.
pub(crate) fn prefault_code() {
    let mut first = true;
    // SAFETY: the callback has the required type, and `first` lives through the call.
    unsafe { libc::dl_iterate_phdr(Some(prefault_object), (&raw mut first).cast()) };
}

unsafe extern "C" fn prefault_object(info: *mut libc::dl_phdr_info, _size: usize, first: *mut c_void) -> c_int {
    // SAFETY: the loader passes a description that is valid during the call, and the pointer given to it.
    let (info, first) = unsafe { (&*info, &mut *first.cast::<bool>()) };
    // The program itself comes first.
    let whole = !core::mem::replace(first, false);
    if info.dlpi_phdr.is_null() {
        return 0;
    }
    // SAFETY: there are `dlpi_phnum` headers, which stay as long as the object is loaded.
    let headers = unsafe { core::slice::from_raw_parts(info.dlpi_phdr, usize::from(info.dlpi_phnum)) };
    for header in headers.iter().filter(|h| h.p_type == libc::PT_LOAD && (whole || h.p_flags & libc::PF_X != 0)) {
        prefault(info.dlpi_addr as usize + header.p_vaddr as usize, header.p_memsz as usize, Advice::LinuxPopulateRead);
    }
    0
}

/// Gives the calling thread's heap a prefaulted reserve. An allocator other than glibc's may release it.
pub(crate) fn prefault_heap() {
    if !enabled() {
        return;
    }
    #[cfg(target_env = "gnu")]
    // SAFETY: sets a number of the allocator: the size from which it releases free memory at the end of the heap.
    unsafe {
        libc::mallopt(libc::M_TRIM_THRESHOLD, 16 * HEAP as c_int);
    }
    let mut pieces = [const { Vec::<u8>::new() }; HEAP / PIECE];
    for piece in &mut pieces {
        piece.resize(PIECE, 1);
    }
    core::hint::black_box(&pieces);
}

fn bytes_in_flight<T>() -> usize {
    let chunk = (size_of::<Header>() + size_of::<T>()).next_multiple_of(align_of::<T>().max(align_of::<Header>()));
    chunk * IN_FLIGHT
}

/// Prefaults the memory that a sender's messages will be written to, from its first message on.
pub(crate) fn prefault_writes<T>(first: *const T) {
    if enabled() {
        prefault(first.addr(), bytes_in_flight::<T>(), Advice::LinuxPopulateWrite);
    }
}

/// Senders whose message memory a receiver has prefaulted.
#[derive(Debug, Default)]
pub(crate) struct Senders {
    known: [Option<UniquePublisherId>; SENDERS],
    /// Index of the oldest, which the next new sender replaces.
    next: usize,
    /// Address of a message of a new sender.
    found: Option<usize>,
}

impl Senders {
    /// Notes the sender of a message, if it is new.
    pub(crate) fn observe<T>(&mut self, message: *const T, sender: UniquePublisherId) {
        if enabled() && !self.known.contains(&Some(sender)) {
            self.known[self.next] = Some(sender);
            self.next = (self.next + 1) % SENDERS;
            self.found = Some(message.addr());
        }
    }

    /// Prefaults the memory that a new sender's messages will be read from. Idle-time work.
    pub(crate) fn prefault<T>(&mut self) {
        if let Some(first) = self.found.take() {
            prefault(first, bytes_in_flight::<T>(), Advice::LinuxPopulateRead);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::realtime::page_faults;
    use rustix::mm::{MapFlags, ProtFlags, mmap_anonymous, munmap};

    const PAGES: usize = 256;

    /// Faults of one write to each page, after `prepare` was called with the memory.
    fn faults_after(prepare: impl FnOnce(usize)) -> u64 {
        let protection = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: new memory at a place of the kernel's choice.
        let memory = unsafe { mmap_anonymous(core::ptr::null_mut(), PAGES * PAGE, protection, MapFlags::SHARED) }.unwrap();
        prepare(memory.addr());
        let before = page_faults();
        for page in 0..PAGES {
            // SAFETY: within the mapping.
            unsafe { memory.cast::<u8>().add(page * PAGE).write_volatile(1) };
        }
        let faults = page_faults() - before;
        // SAFETY: mapped above, and nothing refers to it.
        unsafe { munmap(memory, PAGES * PAGE) }.unwrap();
        faults
    }

    #[test]
    fn prefault_range_avoids_later_faults() {
        assert!(faults_after(|_| {}) >= PAGES as u64 / 16, "the counter counts");
        assert!(faults_after(|at| prefault(at + 100, (PAGES - 1) * PAGE, Advice::LinuxPopulateWrite)) <= 1);
    }

    #[test]
    fn prefault_writes_covers_messages_in_flight() {
        type Message = [u64; 16];
        enable();
        let bytes = bytes_in_flight::<Message>();
        assert!(bytes >= IN_FLIGHT * size_of::<Message>() && bytes < PAGES * PAGE);
        let untouched = faults_after(|at| prefault_writes(core::ptr::without_provenance::<Message>(at)));
        assert!(untouched <= (PAGES - bytes / PAGE) as u64, "{untouched} faults");
    }

    #[test]
    fn prefault_heap_avoids_faults_of_allocation() {
        enable();
        prefault_code();
        prefault_heap();
        let before = page_faults();
        let piece = core::hint::black_box(vec![1_u8; PIECE]);
        assert!(page_faults() - before <= 1, "{} bytes", piece.len());
    }
}
