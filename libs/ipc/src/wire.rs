//! Messages as iceoryx2 carries them.

use hapfic_messages::Message;
use iceoryx2::prelude::ZeroCopySend;

/// A message in shared memory.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct Wire<T>(pub(crate) T);

// SAFETY: a `Message` is plain data without padding or pointers, valid for every bit pattern, and its name stands for
// its layout.
unsafe impl<T: Message> ZeroCopySend for Wire<T> {
    unsafe fn type_name() -> &'static str {
        T::NAME
    }
}
