//! Shared memory of several processes: words in a mapped file.
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::fs::{File, OpenOptions};
use std::io;
use std::ops::Deref;
use std::os::fd::AsRawFd;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::ptr::{self, NonNull};
use std::sync::atomic::AtomicU32;

use rustix::fs::{FallocateFlags, OFlags, fallocate};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};

use shortened::MappingGuard;

mod shortened;

pub(crate) use shortened::take_shortened;

/// Words in a file of `/dev/shm`, shared with every process that opens the same file. Unmapped when dropped.
#[derive(Debug)]
pub struct SharedWords {
    memory: NonNull<AtomicU32>,
    count: usize,
    /// Guard of the mapping; `None` only while the words are being dropped.
    guard: Option<MappingGuard>,
    /// The file stays open, so that an operator finds the words through this process after the file was removed, and so that the size of
    /// the file can be restored.
    file: File,
}

impl SharedWords {
    /// Opens the `count` words in the file at `path`. A new file is readable and writable by its owner only, and its words are
    /// zero. Memory is allocated at once, so that a full `/dev/shm` causes an error here and not a signal later.
    ///
    /// # Errors
    /// The file cannot be opened or is a link; [`io::ErrorKind::PermissionDenied`] if it belongs to another user;
    /// [`io::ErrorKind::InvalidData`] if it has another size; [`io::ErrorKind::StorageFull`] if there is no memory.
    pub fn open(path: &Path, count: usize) -> io::Result<Self> {
        Self::of_file(open_private(path, true)?, count)
    }

    /// Like [`SharedWords::open`], for a file that exists.
    ///
    /// # Errors
    /// Like [`SharedWords::open`]; [`io::ErrorKind::NotFound`] if there is no such file.
    pub fn open_existing(path: &Path, count: usize) -> io::Result<Self> {
        Self::of_file(open_private(path, false)?, count)
    }

    /// The words at the beginning of a file in which a running process has mapped them.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`] if the file was shortened.
    pub(crate) fn of_mapped_file(file: File, count: usize) -> io::Result<Self> {
        if file.metadata()?.len() < size(count) {
            return Err(io::ErrorKind::InvalidData.into());
        }
        Self::map(file, count)
    }

    /// The words in an open file, which gets their size if it is empty.
    ///
    /// # Errors
    /// Like [`SharedWords::open`].
    pub(crate) fn of_file(file: File, count: usize) -> io::Result<Self> {
        match file.metadata()?.len() {
            0 => fallocate(&file, FallocateFlags::empty(), 0, size(count))?,
            present if present == size(count) => {}
            _ => return Err(io::ErrorKind::InvalidData.into()),
        }
        Self::map(file, count)
    }

    fn map(file: File, count: usize) -> io::Result<Self> {
        let size = count * size_of::<AtomicU32>();
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: no address is requested, so the kernel chooses a free range; no existing mapping is affected.
        let memory = unsafe { mmap(ptr::null_mut(), size, access, MapFlags::SHARED, &file, 0)? };
        let memory = NonNull::new(memory.cast()).ok_or(io::ErrorKind::AddrNotAvailable)?;
        let guard = MappingGuard::new(memory.addr().get(), size, file.as_raw_fd());
        Ok(Self { memory, count, guard: Some(guard), file })
    }

    /// The open file.
    pub(crate) fn file(&self) -> &File {
        &self.file
    }

    /// Device and number of the file; `None` if the system refuses.
    pub(crate) fn id(&self) -> Option<(u64, u64)> {
        self.file.metadata().ok().map(|file| (file.dev(), file.ino()))
    }

    fn size(&self) -> usize {
        self.count * size_of::<AtomicU32>()
    }
}

// SAFETY: the mapping belongs to the process, not to a thread; only `drop` unmaps it, and every access to it is atomic.
unsafe impl Send for SharedWords {}

impl Deref for SharedWords {
    type Target = [AtomicU32];

    fn deref(&self) -> &[AtomicU32] {
        // SAFETY: the mapping begins at a page, is `count` words long, and is unmapped only by `drop`, which no borrow of `self`
        // outlives. Any bits are a valid `AtomicU32`, and other processes may write through their mappings at the same time,
        // since every access is atomic. If the file is shortened, the access is repeated by the guard of the mapping.
        unsafe { std::slice::from_raw_parts(self.memory.as_ptr(), self.count) }
    }
}

impl Drop for SharedWords {
    fn drop(&mut self) {
        // Another mapping may get this address.
        self.guard = None;
        // SAFETY: address and size are those of the mapping made by `map`, and no borrow of it outlives `self`.
        let unmapped = unsafe { munmap(self.memory.as_ptr().cast::<c_void>(), self.size()) };
        debug_assert!(unmapped.is_ok(), "{unmapped:?}");
    }
}

/// Size of `count` words \[bytes\].
fn size(count: usize) -> u64 {
    (count * size_of::<AtomicU32>()) as u64
}

/// Restores the size of the file of `count` words at `path`; returns whether the size was different. An empty file is left alone: it is
/// just being created.
///
/// # Errors
/// The file cannot be opened, or the system refuses.
pub(crate) fn restore_size(path: &Path, count: usize) -> io::Result<bool> {
    let file = open_private(path, false)?;
    match file.metadata()?.len() {
        0 => return Ok(false),
        present if present == size(count) => return Ok(false),
        longer if longer > size(count) => file.set_len(size(count))?,
        _ => fallocate(&file, FallocateFlags::empty(), 0, size(count))?,
    }
    Ok(true)
}

/// Opens a file of this user without following a link, or creates it if `creates`.
fn open_private(path: &Path, creates: bool) -> io::Result<File> {
    let flags = (OFlags::NOFOLLOW | OFlags::CLOEXEC).bits().cast_signed();
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(creates).truncate(false).mode(0o600).custom_flags(flags);
    let file = options.open(path)?;
    if file.metadata()?.uid() != rustix::process::geteuid().as_raw() {
        return Err(io::ErrorKind::PermissionDenied.into());
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::*;

    #[test]
    fn words_are_shared_by_path_and_of_fixed_size() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("words");
        let (one, other) =
            (SharedWords::open(&path, 3).unwrap(), SharedWords::open(&path, 3).unwrap());
        one[2].store(7, Ordering::Relaxed);
        assert_eq!((other.len(), other[2].load(Ordering::Relaxed)), (3, 7));
        assert_eq!(SharedWords::open(&path, 4).unwrap_err().kind(), io::ErrorKind::InvalidData);
        assert_eq!(std::fs::metadata(&path).unwrap().mode() & 0o777, 0o600);
        drop(one);
        assert_eq!(other[2].load(Ordering::Relaxed), 7);
    }

    #[test]
    fn f69_words_of_a_shortened_file_are_zero_and_shared_again() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("words");
        let (one, other) =
            (SharedWords::open(&path, 3).unwrap(), SharedWords::open(&path, 3).unwrap());
        for round in 1..=3 {
            one[1].store(7, Ordering::Relaxed);
            OpenOptions::new().write(true).open(&path).unwrap().set_len(0).unwrap();
            assert_eq!(other[1].load(Ordering::Relaxed), 0, "{round}");
            one[1].fetch_add(1, Ordering::Relaxed);
            assert_eq!(other[1].load(Ordering::Relaxed), 1, "{round}");
            let shortened = take_shortened();
            assert!(shortened.contains(&(path.clone(), true)), "{shortened:?}");
        }
    }

    #[test]
    fn a_link_is_not_followed() {
        let directory = tempfile::tempdir().unwrap();
        let (target, link) = (directory.path().join("target"), directory.path().join("link"));
        std::fs::write(&target, "").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        assert!(SharedWords::open(&link, 1).is_err());
        assert_eq!(std::fs::metadata(&target).unwrap().len(), 0);
    }
}
