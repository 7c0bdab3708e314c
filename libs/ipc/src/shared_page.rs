//! Pages of atomics in a run's folder, mapped by all its processes.

use crate::error::IpcError;
use core::sync::atomic::AtomicU64;
use rustix::fs::{Mode, OFlags};
use rustix::mm::{MapFlags, ProtFlags};
use std::path::Path;

/// Content of a page.
///
/// # Safety
/// The type holds atomics only, for which every bit pattern is valid, and zero is the initial value.
pub(crate) unsafe trait PageContent: Send + Sync {}

/// Maps a file in a run's folder, made if it is missing.
fn map(folder: &str, file: &str, bytes: usize, action: &'static str) -> Result<*mut core::ffi::c_void, IpcError> {
    let system = |e: rustix::io::Errno| IpcError::System { action, cause: e.into() };
    let flags = OFlags::RDWR | OFlags::CREATE | OFlags::CLOEXEC;
    let file = rustix::fs::open(Path::new(folder).join(file), flags, Mode::RUSR | Mode::WUSR).map_err(system)?;
    // Never shrinks the file: other processes have mapped it. Reserved memory cannot run out at the first write.
    if rustix::fs::fstat(&file).map_err(system)?.st_size < bytes as i64 {
        rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, bytes as u64).map_err(system)?;
    }
    // SAFETY: a new mapping, at an address of the kernel's choice, of a file that is long enough.
    unsafe {
        let access = ProtFlags::READ | ProtFlags::WRITE;
        rustix::mm::mmap(core::ptr::null_mut(), bytes, access, MapFlags::SHARED, &file, 0).map_err(system)
    }
}

/// Mapped words, as many as the file was opened with; unmapped when dropped.
#[derive(Debug)]
pub(crate) struct SharedWords(*mut AtomicU64, usize);

// SAFETY: atomics only, which stay mapped until the owner drops them.
unsafe impl Send for SharedWords {}
// SAFETY: as above.
unsafe impl Sync for SharedWords {}

impl SharedWords {
    /// Maps the file in a run's folder, made of zeros if it is missing. All who open it do so with the same number.
    ///
    /// # Errors
    /// [`IpcError::System`] with `action` if it cannot be made or mapped.
    pub(crate) fn open(folder: &str, file: &str, words: usize, action: &'static str) -> Result<Self, IpcError> {
        Ok(Self(map(folder, file, words * size_of::<AtomicU64>(), action)?.cast(), words))
    }

    /// Prefaults all words for a writer that is a real-time thread, which may come to some of them late.
    pub(crate) fn prefault_writes(&self) {
        crate::memory::prefault_shared(self);
    }
}

impl core::ops::Deref for SharedWords {
    type Target = [AtomicU64];

    fn deref(&self) -> &[AtomicU64] {
        // SAFETY: mapped as long as `self` lives, page-aligned, of this length, and any bit pattern is valid.
        unsafe { core::slice::from_raw_parts(self.0, self.1) }
    }
}

impl Drop for SharedWords {
    fn drop(&mut self) {
        // SAFETY: mapped in `open` with this size; no reference is left. A failure leaks the mapping.
        let _ = unsafe { rustix::mm::munmap(self.0.cast(), self.1 * size_of::<AtomicU64>()) };
    }
}

/// A mapped page; unmapped when dropped.
#[derive(Debug)]
pub(crate) struct SharedPage<T: PageContent>(*mut T);

// SAFETY: the page holds atomics only, and stays mapped until the last owner drops it.
unsafe impl<T: PageContent> Send for SharedPage<T> {}
// SAFETY: as above.
unsafe impl<T: PageContent> Sync for SharedPage<T> {}

impl<T: PageContent> SharedPage<T> {
    /// Maps the page `file` in a run's folder; creates it if it is missing.
    ///
    /// # Errors
    /// [`IpcError::System`] with `action` if the file cannot be created, reserved or mapped.
    pub(crate) fn open(folder: &str, file: &str, action: &'static str) -> Result<Self, IpcError> {
        Ok(Self(map(folder, file, size_of::<T>(), action)?.cast()))
    }

    /// Maps a page that only this process sees.
    ///
    /// # Errors
    /// [`IpcError::System`] without memory.
    pub(crate) fn private() -> Result<Self, IpcError> {
        // SAFETY: a new anonymous mapping at an address of the kernel's choice.
        let page = unsafe {
            let access = ProtFlags::READ | ProtFlags::WRITE;
            rustix::mm::mmap_anonymous(core::ptr::null_mut(), size_of::<T>(), access, MapFlags::PRIVATE)
        };
        let system = |e: rustix::io::Errno| IpcError::System { action: "map a page", cause: e.into() };
        Ok(Self(page.map_err(system)?.cast()))
    }
}

impl<T: PageContent> core::ops::Deref for SharedPage<T> {
    type Target = T;

    fn deref(&self) -> &T {
        // SAFETY: mapped as long as `self` lives, page-aligned, as long as `T`, and any bit pattern is a valid `T`.
        unsafe { &*self.0 }
    }
}

impl<T: PageContent> Drop for SharedPage<T> {
    fn drop(&mut self) {
        // SAFETY: mapped in `open` or `private` with this size; no reference is left. A failure leaks the mapping.
        let _ = unsafe { rustix::mm::munmap(self.0.cast(), size_of::<T>()) };
    }
}
