//! Count and size of heap allocations, for tests of their bounds. A test program that includes this file has its allocator.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// Allocator that counts the allocations of each thread, and the bytes in use.
struct Counting;

thread_local! {
    static TAKEN: Cell<u64> = const { Cell::new(0) };
    static BYTES: Cell<i64> = const { Cell::new(0) };
    static MOST_BYTES: Cell<i64> = const { Cell::new(0) };
}

fn count(bytes: i64) {
    // The counters of a thread that is ending no longer exist.
    let _ = TAKEN.try_with(|taken| taken.set(taken.get() + 1));
    let _ = BYTES.try_with(|used| used.set(used.get() + bytes));
    let _ = MOST_BYTES.try_with(|most| most.set(most.get().max(BYTES.get())));
}

// SAFETY: every call goes to the system's allocator unchanged; counting touches no heap, since the counters are constant
// initialised thread locals without destructors.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as i64);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        let _ = BYTES.try_with(|used| used.set(used.get() - layout.size() as i64));
        // SAFETY: the caller keeps the contract of `dealloc`; the memory came from `System`.
        unsafe { System.dealloc(memory, layout) }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size as i64 - layout.size() as i64);
        // SAFETY: the caller keeps the contract of `realloc`; the memory came from `System`.
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static HEAP: Counting = Counting;

/// Number of heap allocations made by `work`, and its result.
#[allow(dead_code, reason = "not every program measures both")]
pub fn allocations<T>(work: impl FnOnce() -> T) -> (u64, T) {
    let before = TAKEN.get();
    let result = work();
    (TAKEN.get() - before, result)
}

/// Greatest number of bytes that `work` had in use at a time, and its result.
#[allow(dead_code, reason = "not every program measures both")]
pub fn most_bytes<T>(work: impl FnOnce() -> T) -> (u64, T) {
    let before = BYTES.get();
    MOST_BYTES.set(before);
    let result = work();
    ((MOST_BYTES.get() - before).unsigned_abs(), result)
}
