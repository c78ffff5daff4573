//! Atomic words of the protocols in shared memory. `bus/loom` replaces this file to execute every interleaving of their threads.

pub(crate) use std::sync::atomic::{AtomicU32, Ordering};
