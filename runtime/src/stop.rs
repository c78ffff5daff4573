//! Stop flag of a process.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use oqtal_bus::time::Span;

/// Maximum period at which a waiting thread checks its stop flag.
pub(crate) const STOP_CHECK: Span = Span::from_millis(20);

/// Flag set by a signal; the process then ends its loop in order.
#[derive(Clone, Debug, Default)]
pub struct StopFlag(Arc<AtomicBool>);

impl StopFlag {
    /// Requests the end of the process.
    pub fn set(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// Whether the end of the process was requested.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }

    /// The flag itself, for a signal handler.
    pub(crate) fn shared(&self) -> Arc<AtomicBool> {
        self.0.clone()
    }

    /// Requests the end of the process when the returned guard goes out of scope, also after a panic.
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
