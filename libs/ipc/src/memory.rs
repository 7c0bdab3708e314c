//! Bringing memory in before it is used: the program's code, the heap, and what messages pass through.
//!
//! Locked memory stays once it was used (see [`crate::realtime::lock_memory`]); the first use is a page fault, about a microsecond. So
//! a real-time process brings in beforehand all that it may come to use, and no more: its code and its libraries, a reserve of heap,
//! and of each topic as many messages as can be on their way at once. Without real time nothing is brought in.

use crate::topic::RECORDER_DEPTH;
use core::ffi::{c_int, c_void};
use core::sync::atomic::{AtomicBool, Ordering};
use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::service::header::publish_subscribe::Header;
use rustix::mm::{Advice, madvise};

/// Heap brought in for each real-time thread, bytes: a loan at a time, and what meeting others takes (some 50 kB each).
const HEAP: usize = 512 << 10;
/// In pieces that the allocator takes from its heap instead of mapping them.
const PIECE: usize = 64 << 10;
/// Messages of one sender that can be on their way at once: all that the recorder may be behind, and what short queues, histories and
/// loans hold. A sender takes the one given back last, so it never uses more than that many.
const IN_FLIGHT: usize = RECORDER_DEPTH + 128;
/// Senders of a topic whose memory is known to be in.
const SENDERS: usize = 4;
/// Bytes of a page. Larger ones do no harm.
const PAGE: usize = 4096;

/// Whether memory is brought in beforehand.
static ENABLED: AtomicBool = AtomicBool::new(false);

/// From here on memory is brought in beforehand.
pub(crate) fn enable() {
    ENABLED.store(true, Ordering::Relaxed);
}

fn enabled() -> bool {
    ENABLED.load(Ordering::Relaxed)
}

/// Brings in what is there to read, or to write, at these addresses. Before Linux 5.14 nothing is: pages then come in as they are used.
fn prefault(from: usize, bytes: usize, advice: Advice) {
    let start = from - from % PAGE;
    let ptr = core::ptr::without_provenance_mut::<c_void>(start);
    // SAFETY: the advices passed here change no contents and take no mapping away; an address that is not mapped is an error.
    let _ = unsafe { madvise(ptr, (from + bytes - start).next_multiple_of(PAGE), advice) };
}

/// Brings in the program's code, and the libraries as a whole.
///
/// The program's constants come in as they are used: most of them are what reports are made of.
pub(crate) fn prefault_code() {
    let mut first = true;
    // SAFETY: the callback is of the type that is asked for, and `first` lives through the call.
    unsafe { libc::dl_iterate_phdr(Some(prefault_object), (&raw mut first).cast()) };
}

unsafe extern "C" fn prefault_object(info: *mut libc::dl_phdr_info, _size: usize, first: *mut c_void) -> c_int {
    // SAFETY: the loader passes a description that is valid during the call, and the pointer that it was given.
    let (info, first) = unsafe { (&*info, &mut *first.cast::<bool>()) };
    // The program itself comes first.
    let whole = !core::mem::replace(first, false);
    if info.dlpi_phdr.is_null() {
        return 0;
    }
    // SAFETY: there are as many headers, which stay as long as the object is loaded.
    let headers = unsafe { core::slice::from_raw_parts(info.dlpi_phdr, usize::from(info.dlpi_phnum)) };
    for header in headers.iter().filter(|h| h.p_type == libc::PT_LOAD && (whole || h.p_flags & libc::PF_X != 0)) {
        prefault(info.dlpi_addr as usize + header.p_vaddr as usize, header.p_memsz as usize, Advice::LinuxPopulateRead);
    }
    0
}

/// Has the calling thread's heap keep a reserve that is in memory. Where the allocator is another one than glibc's, it decides itself.
pub(crate) fn prefault_heap() {
    if !enabled() {
        return;
    }
    #[cfg(target_env = "gnu")]
    // SAFETY: sets a number of the allocator: the size from which free memory at the end of the heap is given back.
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

/// Brings in what a sender's messages will be written to, from its first one on.
pub(crate) fn prefault_writes<T>(first: *const T) {
    if enabled() {
        prefault(first.addr(), bytes_in_flight::<T>(), Advice::LinuxPopulateWrite);
    }
}

/// The senders whose messages a receiver has memory in for.
#[derive(Debug, Default)]
pub(crate) struct Senders {
    known: [Option<UniquePublisherId>; SENDERS],
    /// Where the next new one goes: in place of the oldest.
    next: usize,
    /// A message of a new one.
    found: Option<usize>,
}

impl Senders {
    /// Looks at a message and who sent it.
    pub(crate) fn look_at<T>(&mut self, message: *const T, sender: UniquePublisherId) {
        if enabled() && !self.known.contains(&Some(sender)) {
            self.known[self.next] = Some(sender);
            self.next = (self.next + 1) % SENDERS;
            self.found = Some(message.addr());
        }
    }

    /// Work for the slack: brings in where the messages of a new sender will be read.
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

    /// Faults while each page is written to once, after `bring` was called with the memory.
    fn faults_after(bring: impl FnOnce(usize)) -> u64 {
        let protection = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: new memory at a place of the kernel's choice.
        let memory = unsafe { mmap_anonymous(core::ptr::null_mut(), PAGES * PAGE, protection, MapFlags::SHARED) }.unwrap();
        bring(memory.addr());
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
    fn what_was_brought_in_costs_no_fault_and_what_was_not_one_a_page() {
        assert!(faults_after(|_| {}) >= PAGES as u64 / 16, "the counter counts");
        assert!(faults_after(|at| prefault(at + 100, (PAGES - 1) * PAGE, Advice::LinuxPopulateWrite)) <= 1);
    }

    #[test]
    fn the_whole_window_of_a_topic_is_brought_in() {
        type Message = [u64; 16];
        enable();
        let bytes = bytes_in_flight::<Message>();
        assert!(bytes >= IN_FLIGHT * size_of::<Message>() && bytes < PAGES * PAGE);
        let untouched = faults_after(|at| prefault_writes(core::ptr::without_provenance::<Message>(at)));
        assert!(untouched <= (PAGES - bytes / PAGE) as u64, "{untouched} faults");
    }

    #[test]
    fn code_and_heap_can_be_brought_in() {
        enable();
        prefault_code();
        prefault_heap();
        let before = page_faults();
        let piece = core::hint::black_box(vec![1_u8; PIECE]);
        assert!(page_faults() - before <= 1, "{} bytes", piece.len());
    }
}
