//! Counts heap allocations of the current thread.
//!
//! A real-time loop must not allocate between receiving and sending. The binary installs [`CountingAllocator`] as its
//! global allocator; each loop compares [`count`] before and after and reports the difference in
//! [`hapfic_messages::Timing`].

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

/// Allocations made by this thread so far; stays zero unless [`CountingAllocator`] is the global allocator.
#[must_use]
pub fn count() -> u64 {
    COUNT.with(Cell::get)
}

/// System allocator that counts allocations.
#[derive(Debug)]
pub struct CountingAllocator;

fn count_one() {
    // A thread in tear-down has no counter and no reader any more.
    let _ = COUNT.try_with(|c| c.set(c.get() + 1));
}

// SAFETY: every call goes unchanged to the system allocator; counting touches a plain thread-local cell only.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count_one();
        // SAFETY: the caller upholds what `System` requires.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(ptr, layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count_one();
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count_one();
        // SAFETY: as above.
        unsafe { System.realloc(ptr, layout, new_size) }
    }
}
