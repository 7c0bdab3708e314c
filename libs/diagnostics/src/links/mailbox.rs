//! Mailboxes in shared memory: the payload of the futex and eventfd chains.
#![allow(unsafe_code)]

use crate::link::{STAGES, Seat};
use rustix::fs::{MemfdFlags, ftruncate, memfd_create};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::io;
use std::os::fd::OwnedFd;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU32, Ordering};

/// Messages that a mailbox holds, so that a late reader's message is not overwritten meanwhile.
const SLOTS: usize = 4;
/// Length of the header [bytes]: of a mailbox, the number of the newest message; of a slot, the message length.
const HEADER: usize = 64;

/// Mailboxes of a chain in one mapping; mailbox `i` leads from stage `i` to the next.
#[derive(Debug)]
pub(super) struct Mailboxes {
    base: NonNull<u8>,
    stride: usize,
    slot: usize,
}

impl Mailboxes {
    /// Makes the memory for the mailboxes of a chain.
    pub(super) fn make(sizes: &[usize; STAGES]) -> io::Result<OwnedFd> {
        let memory = memfd_create(c"hapfic-chain", MemfdFlags::CLOEXEC)?;
        ftruncate(&memory, (STAGES * stride(longest(sizes))) as u64)?;
        Ok(memory)
    }

    /// Maps the mailboxes.
    pub(super) fn open(memory: &OwnedFd, seat: &Seat) -> io::Result<Self> {
        let slot = HEADER + seat.longest().next_multiple_of(HEADER);
        let stride = stride(seat.longest());
        // SAFETY: a new mapping at an address of the system's choice aliases nothing of this process.
        let base = unsafe {
            mmap(
                std::ptr::null_mut(),
                STAGES * stride,
                ProtFlags::READ | ProtFlags::WRITE,
                MapFlags::SHARED | MapFlags::POPULATE,
                memory,
                0,
            )
        }?;
        let base = NonNull::new(base.cast()).ok_or(io::ErrorKind::OutOfMemory)?;
        Ok(Self { base, stride, slot })
    }

    /// Number of the newest message of a mailbox; the futex that a reader waits on.
    pub(super) fn newest(&self, mailbox: usize) -> &AtomicU32 {
        assert!(mailbox < STAGES);
        // SAFETY: within the mapping, aligned to its page, and used only as an atomic in all processes.
        unsafe { AtomicU32::from_ptr(self.base.as_ptr().add(mailbox * self.stride).cast()) }
    }

    /// Writes a message to a mailbox.
    pub(super) fn put(&self, mailbox: usize, message: &[u8]) -> io::Result<()> {
        if message.len() > self.slot - HEADER {
            return Err(io::Error::other("the message is longer than the mailbox"));
        }
        let newest = self.newest(mailbox);
        let number = newest.load(Ordering::Relaxed).wrapping_add(1);
        let (length, bytes) = self.at(mailbox, number);
        length.store(message.len() as u32, Ordering::Relaxed);
        // SAFETY: the slot is within the mapping and long enough by the check above. Its reader has had the time of
        // three more messages.
        unsafe { std::ptr::copy_nonoverlapping(message.as_ptr(), bytes, message.len()) };
        newest.store(number, Ordering::Release);
        Ok(())
    }

    /// Copies the newest message if its number differs from `last`, and updates `last`.
    pub(super) fn take(&self, mailbox: usize, last: &mut u32, into: &mut [u8]) -> io::Result<Option<usize>> {
        let number = self.newest(mailbox).load(Ordering::Acquire);
        if number == *last {
            return Ok(None);
        }
        *last = number;
        let (length, bytes) = self.at(mailbox, number);
        let length = length.load(Ordering::Relaxed) as usize;
        if length > into.len().min(self.slot - HEADER) {
            return Err(io::Error::other("the message is longer than expected"));
        }
        // SAFETY: `length` is within the slot and within `into`, which is this process's own.
        unsafe { std::ptr::copy_nonoverlapping(bytes, into.as_mut_ptr(), length) };
        Ok(Some(length))
    }

    /// Returns length and bytes of a message's slot.
    fn at(&self, mailbox: usize, number: u32) -> (&AtomicU32, *mut u8) {
        let offset = mailbox * self.stride + HEADER + number as usize % SLOTS * self.slot;
        assert!(mailbox < STAGES && offset + self.slot <= STAGES * self.stride);
        // SAFETY: within the mapping by the assertion, like the rest of the slot.
        let start = unsafe { self.base.as_ptr().add(offset) };
        // SAFETY: aligned to 64 bytes, and used only as an atomic.
        let length = unsafe { AtomicU32::from_ptr(start.cast()) };
        // SAFETY: a slot is longer than its header.
        (length, unsafe { start.add(HEADER) })
    }
}

impl Drop for Mailboxes {
    fn drop(&mut self) {
        // SAFETY: `open` has mapped it, and no borrow outlives this value.
        let _ = unsafe { munmap(self.base.as_ptr().cast(), STAGES * self.stride) };
    }
}

fn longest(sizes: &[usize; STAGES]) -> usize {
    sizes.iter().copied().max().unwrap_or(0)
}

/// Distance from one mailbox to the next, whole pages [bytes].
fn stride(longest: usize) -> usize {
    (HEADER + SLOTS * (HEADER + longest.next_multiple_of(HEADER))).next_multiple_of(4096)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn mailbox_messages_are_read_once_and_unchanged() {
        let sizes = [1000, 8, 4000];
        let memory = Mailboxes::make(&sizes).unwrap();
        let seat = Seat { stage: 0, sizes, chain: String::new(), shared: Vec::new() };
        let (writer, reader) = (Mailboxes::open(&memory, &seat).unwrap(), Mailboxes::open(&memory, &seat).unwrap());
        let mut into = vec![0; 4000];
        for mailbox in 0..STAGES {
            let mut last = 0;
            assert_eq!(reader.take(mailbox, &mut last, &mut into).unwrap(), None);
            for round in 0_u8..10 {
                let message = vec![round + mailbox as u8; 100 * usize::from(round) + 1];
                writer.put(mailbox, &message).unwrap();
                let length = reader.take(mailbox, &mut last, &mut into).unwrap().unwrap();
                assert_eq!(&into[..length], message);
                assert_eq!(reader.take(mailbox, &mut last, &mut into).unwrap(), None);
            }
        }
        assert!(writer.put(0, &[0; 4097]).is_err());
        writer.put(1, &[1; 100]).unwrap();
        assert!(reader.take(1, &mut 0, &mut [0; 99]).is_err());
    }
}
