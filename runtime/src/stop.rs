//! The flag that asks a process to end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use oqtal_bus::time::Span;

/// A waiting thread checks its stop flag at least this often.
pub(crate) const STOP_CHECK: Span = Span::from_millis(20);

/// Set by a signal; the process then ends its loop in good order.
#[derive(Clone, Debug, Default)]
pub struct StopFlag(Arc<AtomicBool>);

impl StopFlag {
    /// Asks the process to end.
    pub fn set(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// Whether the process was asked to end.
    #[must_use]
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }

    /// Asks the process to end when the returned guard goes out of scope, also by a panic.
    #[must_use]
    pub fn set_on_drop(&self) -> SetOnDrop {
        SetOnDrop(self.clone())
    }
}

/// Sets a [`StopFlag`] when it goes out of scope.
#[derive(Debug)]
pub struct SetOnDrop(StopFlag);

impl Drop for SetOnDrop {
    fn drop(&mut self) {
        self.0.set();
    }
}
