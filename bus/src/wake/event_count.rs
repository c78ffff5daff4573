//! Event count: a word that a notifier increments, and on which listeners sleep while it is unchanged. The functions that sleep and wake up
//! are arguments. `bus/loom` executes every interleaving of this file.

use std::cell::Cell;

use crate::atomic::{AtomicU32, Ordering};

/// Counts an event, then wakes all sleepers.
pub(crate) fn notify<E>(
    count: &AtomicU32,
    wake: impl FnOnce(&AtomicU32) -> Result<(), E>,
) -> Result<(), E> {
    count.fetch_add(1, Ordering::Release);
    wake(count)
}

/// Sleeps if no event was counted since `seen`, which it then updates; returns whether there was one. `sleep` must return at once if the
/// count differs from the number that it is passed, and may return early.
pub(crate) fn wait<E>(
    count: &AtomicU32,
    seen: &Cell<u32>,
    sleep: impl FnOnce(&AtomicU32, u32) -> Result<(), E>,
) -> Result<bool, E> {
    if count.load(Ordering::Acquire) == seen.get() {
        sleep(count, seen.get())?;
    }
    let now = count.load(Ordering::Acquire);
    Ok(seen.replace(now) != now)
}
