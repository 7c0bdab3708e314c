//! Hand-off of ownership between two threads.

use crate::atomic::{AtomicPtr, Ordering};
use core::marker::PhantomData;

/// Cell whose box is either inside or owned by the thread that took it. No call waits or allocates.
pub struct HandOffCell<T> {
    content: AtomicPtr<T>,
    owns: PhantomData<Box<T>>,
}

// SAFETY: the cell only moves a box from thread to thread; no two threads ever have a reference to its content.
unsafe impl<T: Send> Send for HandOffCell<T> {}
// SAFETY: as above.
unsafe impl<T: Send> Sync for HandOffCell<T> {}

impl<T> Default for HandOffCell<T> {
    fn default() -> Self {
        Self { content: AtomicPtr::new(core::ptr::null_mut()), owns: PhantomData }
    }
}

impl<T> core::fmt::Debug for HandOffCell<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("HandOffCell").finish_non_exhaustive()
    }
}

impl<T> HandOffCell<T> {
    /// Takes the box, if the cell holds it.
    #[must_use]
    pub fn take(&self) -> Option<Box<T>> {
        let content = self.content.swap(core::ptr::null_mut(), Ordering::AcqRel);
        // SAFETY: every pointer but null comes from `Box::into_raw` in `put`, and the swap gave it to this thread
        // alone.
        (!content.is_null()).then(|| unsafe { Box::from_raw(content) })
    }

    /// Puts a box into the cell. Returns the previous box, if any.
    pub fn put(&self, content: Box<T>) -> Option<Box<T>> {
        let before = self.content.swap(Box::into_raw(content), Ordering::AcqRel);
        // SAFETY: as in `take`.
        (!before.is_null()).then(|| unsafe { Box::from_raw(before) })
    }
}

impl<T> Drop for HandOffCell<T> {
    fn drop(&mut self) {
        drop(self.take());
    }
}
