//! Shared words whose file was shortened: an access to them raises SIGBUS, which would end the process.
//!
//! The signal handler restores the size of the file, and the access is repeated: the words are zero, and shared as before. If there is no
//! memory for the file, the process continues with a private page. A SIGBUS at any other address ends the process.

use std::ffi::{c_int, c_void};
use std::path::PathBuf;
use std::ptr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicI32, AtomicU8, AtomicUsize, Ordering};

/// Maximum number of mappings that are guarded \[-\]; a daemon has about twenty.
const SLOTS: usize = 256;

/// Value of [`Slot::begin`] of a free slot, and of one that is being filled.
const FREE: usize = 0;
const RESERVED: usize = 1;

/// State of a slot: the file has its full size.
const WHOLE: u8 = 0;
/// State of a slot: the file was shortened and has been restored to its full size.
const RESTORED: u8 = 1;
/// State of a slot: the file was shortened and could not be restored; this process uses a private page instead.
const LOST: u8 = 2;

/// A guarded mapping.
struct Slot {
    begin: AtomicUsize,
    size: AtomicUsize,
    file: AtomicI32,
    state: AtomicU8,
}

static GUARDED: [Slot; SLOTS] = [const {
    Slot {
        begin: AtomicUsize::new(FREE),
        size: AtomicUsize::new(0),
        file: AtomicI32::new(-1),
        state: AtomicU8::new(WHOLE),
    }
}; SLOTS];

/// Action for SIGBUS before the handler was installed.
static PREVIOUS: OnceLock<libc::sigaction> = OnceLock::new();

/// Guard of a mapping, until it is dropped.
#[derive(Debug)]
pub(super) struct MappingGuard(Option<usize>);

impl MappingGuard {
    /// Guards `size` bytes at the address `begin`, mapped from the open file `file`. Without a free slot the mapping is not
    /// guarded.
    pub(super) fn new(begin: usize, size: usize, file: c_int) -> Self {
        install();
        let take = |slot: &Slot| {
            slot.begin.compare_exchange(FREE, RESERVED, Ordering::AcqRel, Ordering::Relaxed).is_ok()
        };
        let free = GUARDED.iter().position(take);
        if let Some(slot) = free.map(|number| &GUARDED[number]) {
            slot.size.store(size, Ordering::Relaxed);
            slot.file.store(file, Ordering::Relaxed);
            slot.state.store(WHOLE, Ordering::Relaxed);
            slot.begin.store(begin, Ordering::Release);
        }
        Self(free)
    }
}

impl Drop for MappingGuard {
    fn drop(&mut self) {
        if let Some(number) = self.0 {
            GUARDED[number].begin.store(FREE, Ordering::Release);
        }
    }
}

/// Files of this process that were shortened since the last call, each with whether its size was restored.
pub(crate) fn take_shortened() -> Vec<(PathBuf, bool)> {
    let shortened = GUARDED.iter().filter_map(|slot| {
        let is_used = slot.begin.load(Ordering::Acquire) > RESERVED;
        let state = if is_used { slot.state.swap(WHOLE, Ordering::Relaxed) } else { WHOLE };
        let link = format!("/proc/self/fd/{}", slot.file.load(Ordering::Relaxed));
        (state != WHOLE).then(|| (std::fs::read_link(link).unwrap_or_default(), state == RESTORED))
    });
    shortened.collect()
}

/// Installs the handler once.
fn install() {
    PREVIOUS.get_or_init(|| {
        // SAFETY: `sigaction` is plain data for which all zeros is a valid value; both pointers are valid for the calls. The
        // handler has the signature that SA_SIGINFO demands, and calls only functions that are safe in a signal handler.
        unsafe {
            let mut previous: libc::sigaction = std::mem::zeroed();
            libc::sigaction(libc::SIGBUS, ptr::null(), &raw mut previous);
            let mut action: libc::sigaction = std::mem::zeroed();
            action.sa_sigaction =
                handle as extern "C" fn(c_int, *mut libc::siginfo_t, *mut c_void) as usize;
            action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK | libc::SA_NODEFER;
            libc::sigaction(libc::SIGBUS, &raw const action, ptr::null_mut());
            previous
        }
    });
}

/// Handles SIGBUS at a guarded mapping; otherwise restores the previous action, under which the access is repeated.
extern "C" fn handle(signal: c_int, info: *mut libc::siginfo_t, _context: *mut c_void) {
    // SAFETY: the kernel passes valid information of a SIGBUS, which has an address.
    let address = unsafe { (*info).si_addr() } as usize;
    let at = |slot: &&Slot| {
        let begin = slot.begin.load(Ordering::Acquire);
        begin > RESERVED && (begin..begin + slot.size.load(Ordering::Relaxed)).contains(&address)
    };
    // SAFETY: the location of `errno` is valid for this thread; the interrupted code must find it unchanged.
    let errno = unsafe { *libc::__errno_location() };
    match GUARDED.iter().find(at) {
        Some(slot) if restore(slot) => {}
        _ => {
            let default = libc::SIG_DFL;
            // SAFETY: the previous action was returned by the kernel; without it, all zeros is the default action.
            unsafe {
                let mut action: libc::sigaction = std::mem::zeroed();
                action.sa_sigaction = default;
                let action = PREVIOUS.get().copied().unwrap_or(action);
                libc::sigaction(signal, &raw const action, ptr::null_mut());
            }
        }
    }
    // SAFETY: as above.
    unsafe { *libc::__errno_location() = errno };
}

/// Makes the mapping of `slot` accessible; false if the system refuses.
fn restore(slot: &Slot) -> bool {
    let (begin, size) = (slot.begin.load(Ordering::Acquire), slot.size.load(Ordering::Relaxed));
    let length = libc::off_t::try_from(size).unwrap_or(0);
    // SAFETY: the file is open as long as its mapping is guarded, and no memory of this process changes.
    if unsafe { libc::fallocate(slot.file.load(Ordering::Relaxed), 0, 0, length) } == 0 {
        slot.state.store(RESTORED, Ordering::Relaxed);
        return true;
    }
    let (access, kind) = (
        libc::PROT_READ | libc::PROT_WRITE,
        libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED,
    );
    // SAFETY: the range is that of a mapping of this process, which is inaccessible; zeros are valid words.
    let page = unsafe { libc::mmap(begin as *mut c_void, size, access, kind, -1, 0) };
    slot.state.store(LOST, Ordering::Relaxed);
    page != libc::MAP_FAILED
}
