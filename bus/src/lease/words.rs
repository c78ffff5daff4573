//! The state of a lease of a port, wherever its word is. `bus/loom` executes every interleaving of this file.
//!
//! ```text
//!            offer                take
//!   Closed ─────────▶ Offered ─────────▶ Taken
//!    ▲ ▲                │  ▲               │ │
//!    │ └──── close ─────┘  └──── release ──┘ │ release, a frame written in part
//!    └──────────────── close ◀─────────────── Spoilt
//! ```

use crate::atomic::{AtomicU32, Ordering};

/// The owner may write, and nobody else; also the value of a new word.
const CLOSED: u32 = 0;
/// The tenant may take the port.
const OFFERED: u32 = 1;
/// The tenant is writing a frame.
const TAKEN: u32 = 2;
/// The tenant has written a frame in part.
const SPOILT: u32 = 3;

/// State of a port that its owner closed to the tenant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClosedPort {
    /// The port was closed before.
    Before,
    /// The port was offered: the tenant may have written frames since.
    Whole,
    /// The last frame of the tenant may be incomplete.
    Spoilt,
}

/// Offers the port to the tenant; the owner does not write until it has closed the port again.
pub(crate) fn offer(state: &AtomicU32) {
    state.store(OFFERED, Ordering::Release);
}

/// Closes the port to the tenant; `None` while the tenant is writing.
pub(crate) fn close(state: &AtomicU32) -> Option<ClosedPort> {
    let closed = state.compare_exchange(OFFERED, CLOSED, Ordering::AcqRel, Ordering::Acquire);
    match closed {
        Ok(_) => Some(ClosedPort::Whole),
        Err(CLOSED) => Some(ClosedPort::Before),
        Err(TAKEN) => None,
        // `SPOILT`, or an unknown value: the tenant no longer changes it.
        Err(_) => Some(seize(state)),
    }
}

/// Closes the port to a tenant that has ended, also in the middle of a frame.
pub(crate) fn seize(state: &AtomicU32) -> ClosedPort {
    match state.swap(CLOSED, Ordering::AcqRel) {
        CLOSED => ClosedPort::Before,
        OFFERED => ClosedPort::Whole,
        _ => ClosedPort::Spoilt,
    }
}

/// Takes the port for one frame; returns whether it was offered.
pub(crate) fn take(state: &AtomicU32) -> bool {
    state.compare_exchange(OFFERED, TAKEN, Ordering::AcqRel, Ordering::Relaxed).is_ok()
}

/// Returns the taken port; `is_whole` is whether its last frame was written completely.
pub(crate) fn release(state: &AtomicU32, is_whole: bool) {
    state.store(if is_whole { OFFERED } else { SPOILT }, Ordering::Release);
}
