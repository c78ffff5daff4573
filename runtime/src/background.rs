//! The background thread of a process: logs, health messages, operator requests, opening and closing of ports. It does all work
//! that may block and must not run on the real-time thread.

use std::time::Duration;

use crate::context::ProcessContext;
use crate::exit::{Exit, Failure};

/// Time between two polls of the background thread.
const POLL_PERIOD: Duration = Duration::from_millis(5);

/// Work of a background thread.
pub trait BackgroundWorker {
    /// Handles what has arrived since the last call.
    fn poll(&mut self);
}

/// Work of two background threads on one.
impl<A: BackgroundWorker, B: BackgroundWorker> BackgroundWorker for (A, B) {
    fn poll(&mut self) {
        self.0.poll();
        self.1.poll();
    }
}

/// Executes `realtime` on the calling thread, beside a background thread. `open` makes the worker on the background thread, since
/// bus ports stay on the thread that opens them. `realtime` starts once the worker is open. The background thread ends after
/// `realtime`, after a last poll.
///
/// # Errors
/// The worker could not be opened, or the error of `realtime`.
pub fn with_background<W: BackgroundWorker>(
    context: &ProcessContext,
    open: impl FnOnce() -> Result<W, Failure> + Send,
    realtime: impl FnOnce() -> Result<(), Failure>,
) -> Result<(), Failure> {
    std::thread::scope(|threads| {
        let (opened, is_open) = crossbeam_channel::bounded(1);
        // Set when the real-time loop ends, also after a panic.
        let _stop = context.stop.set_on_drop();
        threads.spawn(move || match open() {
            Ok(mut worker) => {
                let _ = opened.send(Ok(()));
                while !context.stop.is_set() {
                    worker.poll();
                    context.health.count_poll();
                    std::thread::sleep(POLL_PERIOD);
                }
                worker.poll();
            }
            Err(failure) => {
                let _ = opened.send(Err(failure));
            }
        });
        match is_open.recv() {
            Ok(opened) => opened.and_then(|()| realtime()),
            Err(_) => Err(Failure::new(Exit::Internal, "the background thread did not start")),
        }
    })
}
