//! Failures and panics as Python exceptions: the classes of `oqtal.errors`.

use std::any::Any;
use std::cell::Cell;
use std::sync::Mutex;

use oqtal_runtime::process::{Exit, Failure};
use pyo3::prelude::*;
use pyo3::types::PyType;

/// Message of the last panic in work for Python.
static LAST_PANIC: Mutex<Option<String>> = Mutex::new(None);

thread_local! {
    /// Whether a panic of this thread becomes an exception and is not printed.
    static IS_CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Class of `oqtal.errors` for an exit code of the program.
fn class_of(exit: Exit) -> &'static str {
    match exit {
        Exit::Ok | Exit::Internal => "InternalError",
        Exit::Flight => "FlightError",
        Exit::Usage => "UsageError",
        Exit::Data => "DataError",
        Exit::System => "SystemFailure",
        Exit::Peer => "PeerError",
        Exit::Version => "VersionError",
        Exit::Permission => "AccessError",
        Exit::Config => "ConfigError",
    }
}

/// Exception for `failure`, with its message.
pub fn raised(failure: Failure) -> PyErr {
    of_class(class_of(failure.exit), failure.message)
}

/// Exception of the class `name` of `oqtal.errors`.
pub fn of_class(name: &str, message: String) -> PyErr {
    Python::attach(|py| {
        let class = py.import("oqtal.errors").and_then(|errors| errors.getattr(name));
        match class.and_then(|class| Ok(class.cast_into::<PyType>()?)) {
            Ok(class) => PyErr::from_type(class, message),
            Err(error) => error,
        }
    })
}

/// Exception for a misuse of an argument.
pub fn usage(message: impl Into<String>) -> PyErr {
    of_class("UsageError", message.into())
}

/// Keeps the message of a panic in work for Python instead of printing it; other panics are printed as before.
pub fn install_panic_hook() {
    let before = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if IS_CAUGHT.get() {
            let mut last = LAST_PANIC.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            *last = Some(panic.to_string());
        } else {
            before(panic);
        }
    }));
}

/// Marks this thread: its panics become exceptions and are not printed.
pub fn catch_panics_of_thread(is_caught: bool) {
    IS_CAUGHT.set(is_caught);
}

/// Exception for a panic that ended work for Python.
pub fn of_panic(_payload: &(dyn Any + Send)) -> PyErr {
    of_class("InternalError", last_panic())
}

/// Message of the last panic in work for Python.
pub fn last_panic() -> String {
    let mut last = LAST_PANIC.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let message = last.take().unwrap_or_else(|| "the computation panicked".to_owned());
    format!("{message}; please report this as a defect of oqtal")
}
