//! Work without the interpreter's lock. Signals, such as Ctrl-C and the stop button of a notebook, end it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use oqtal_bus::time::{Span, Time};
use oqtal_lab::progress::Progress;
use oqtal_runtime::process::{Exit, Failure};
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;

use crate::error;

/// Period at which signals are processed and progress is reported.
const POLL_PERIOD: Duration = Duration::from_millis(20);
/// The same as a span of time.
const POLL_SPAN: Span = Span::from_millis(20);

/// Progress of a study, shared with its threads.
#[derive(Default)]
struct Shared {
    is_cancelled: Arc<AtomicBool>,
    /// Name of the task, steps done, all steps.
    latest: Mutex<Option<(String, u64, u64)>>,
}

/// Executes `work` without the interpreter's lock in this thread; a panic becomes an exception.
pub fn detached<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, Failure> + Send,
) -> PyResult<T> {
    py.detach(|| caught(work)).unwrap_or_else(|panic| Err(error::of_panic(&*panic)))
}

/// Panics, in this thread or in those of a study: the tests look at the exception.
#[cfg(debug_assertions)]
#[pyfunction]
fn panic(py: Python<'_>, in_study: bool) -> PyResult<()> {
    let work = || panic!("by hand");
    if in_study { study(py, None, 2, |_| work()) } else { detached(py, work) }
}

/// Registers the function of the tests.
#[cfg(debug_assertions)]
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(panic, module)?)
}

/// Executes `work` with panics caught.
fn caught<T>(
    work: impl FnOnce() -> Result<T, Failure>,
) -> Result<PyResult<T>, Box<dyn std::any::Any + Send>> {
    error::catch_panics_of_thread(true);
    let result = catch_unwind(AssertUnwindSafe(work));
    error::catch_panics_of_thread(false);
    Ok(result?.map_err(error::raised))
}

/// Executes `work` without the interpreter's lock on a thread of its own; a signal sets the flag that `work` receives, and ends the call
/// without waiting for the thread.
pub fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    let cancelled = Arc::new(AtomicBool::new(false));
    let (of_thread, (finished, result)) = (Arc::clone(&cancelled), channel());
    std::thread::spawn(move || {
        // The caller may have been interrupted.
        let _ = finished.send(caught(|| work(&of_thread)));
    });
    py.detach(move || {
        loop {
            match result.recv_timeout(POLL_PERIOD) {
                Ok(result) => return result.unwrap_or_else(|panic| Err(error::of_panic(&*panic))),
                Err(RecvTimeoutError::Timeout) => {
                    let checked = Python::attach(|py| py.check_signals());
                    checked.inspect_err(|_| cancelled.store(true, Ordering::Relaxed))?;
                }
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(error::of_panic(&"the thread has ended"));
                }
            }
        }
    })
}

/// Executes the study `work` without the interpreter's lock, on `threads` threads of its own, by default one for each processor; calls
/// `progress` with the name of the task, the steps done, and all steps.
pub fn study<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    threads: usize,
    work: impl FnOnce(&Progress) -> Result<T, Failure> + Send,
) -> PyResult<T> {
    let shared = Arc::new(Shared::default());
    let told = progress.map(|progress| progress.clone().unbind());
    py.detach(|| {
        let (finished, over) = channel();
        std::thread::scope(|scope| {
            let watched = watched(&shared);
            let worker = scope.spawn(move || {
                let result = on_threads(threads, || caught(|| work(&watched)));
                // The receiver waits in any case.
                let _ = finished.send(());
                result
            });
            let stopped = wait(&shared, &over, told.as_ref());
            let result = worker.join().unwrap_or_else(Err);
            match (stopped, result) {
                (Some(stopped), _) => Err(stopped),
                (None, Ok(result)) => result,
                (None, Err(panic)) => Err(error::of_panic(&*panic)),
            }
        })
    })
}

/// Progress that records the latest step, of a study that can be cancelled.
fn watched(shared: &Arc<Shared>) -> Progress {
    let (shared, is_cancelled) = (Arc::clone(shared), Arc::clone(&shared.is_cancelled));
    let watch = move |name: &str, done, all| {
        *shared.latest.lock().unwrap_or_else(PoisonError::into_inner) =
            Some((name.to_owned(), done, all));
    };
    Progress::watched(Box::new(watch), is_cancelled)
}

/// Executes `work` in a pool of its own: after a fork the threads of a shared one are gone.
fn on_threads<T: Send>(
    threads: usize,
    work: impl FnOnce() -> Result<PyResult<T>, Box<dyn std::any::Any + Send>> + Send,
) -> Result<PyResult<T>, Box<dyn std::any::Any + Send>> {
    let catch = |_| error::catch_panics_of_thread(true);
    match ThreadPoolBuilder::new().num_threads(threads).start_handler(catch).build() {
        Ok(pool) => pool.install(work),
        Err(error) => Ok(Err(error::raised(Failure::new(Exit::System, error.to_string())))),
    }
}

/// Waits for the end of a study; returns the exception that cancelled it, raised by a signal or by `progress`.
fn wait(
    shared: &Shared,
    over: &std::sync::mpsc::Receiver<()>,
    progress: Option<&Py<PyAny>>,
) -> Option<PyErr> {
    let mut stopped = None;
    while let Err(RecvTimeoutError::Timeout) = over.recv_timeout(POLL_PERIOD) {
        if stopped.is_none() {
            stopped = Python::attach(|py| poll(py, shared, progress)).err();
            shared.is_cancelled.store(stopped.is_some(), Ordering::Relaxed);
        }
    }
    stopped.or_else(|| Python::attach(|py| poll(py, shared, progress)).err())
}

/// Processes signals, and reports the latest step.
fn poll(py: Python<'_>, shared: &Shared, progress: Option<&Py<PyAny>>) -> PyResult<()> {
    py.check_signals()?;
    let latest = shared.latest.lock().unwrap_or_else(PoisonError::into_inner).take();
    if let (Some(progress), Some((name, done, all))) = (progress, latest) {
        progress.call1(py, (name, done, all))?;
    }
    Ok(())
}

/// Poll of signals during a flight, at most once in a period.
#[derive(Debug)]
pub struct SignalPoll {
    due: Time,
    /// The exception that a signal raised.
    pub raised: Option<PyErr>,
}

impl SignalPoll {
    /// The first poll is due at once.
    pub fn new() -> Self {
        Self { due: Time::UNSET, raised: None }
    }

    /// Whether a signal has raised an exception.
    pub fn is_raised(&mut self) -> bool {
        let now = Time::now();
        if self.raised.is_none() && now >= self.due {
            self.due = now + POLL_SPAN;
            self.raised = Python::attach(|py| py.check_signals()).err();
        }
        self.raised.is_some()
    }
}
