//! A job that may take too long, such as reading a file of another machine or of the kernel, in a thread of its own.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// Most jobs that may run at once \[-\]: one that blocks keeps its thread.
const MOST_RUNNING: usize = 32;
/// Number of running jobs \[-\].
static RUNNING: AtomicUsize = AtomicUsize::new(0);

/// The result of `job`, for which this thread waits for at most `timeout`.
///
/// # Errors
/// The job has not ended by then, or no thread could be started for it.
pub(crate) fn in_time<T: Send + 'static>(
    timeout: Duration,
    job: impl FnOnce() -> T + Send + 'static,
) -> Result<T, String> {
    let (sender, result) = crossbeam_channel::bounded(1);
    if RUNNING.fetch_add(1, Ordering::Relaxed) >= MOST_RUNNING {
        RUNNING.fetch_sub(1, Ordering::Relaxed);
        return Err(format!(
            "was not begun: {MOST_RUNNING} others have not ended; restart the daemon after the flight"
        ));
    }
    let run = move || {
        let result = job();
        RUNNING.fetch_sub(1, Ordering::Relaxed);
        let _ = sender.send(result);
    };
    if let Err(error) = std::thread::Builder::new().name("timed-job".to_owned()).spawn(run) {
        RUNNING.fetch_sub(1, Ordering::Relaxed);
        return Err(error.to_string());
    }
    let late = |_| format!("did not end within {} s", timeout.as_secs_f64());
    result.recv_timeout(timeout).map_err(late)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_that_blocks_is_left_behind_and_another_one_runs() {
        let (release, blocked) = crossbeam_channel::bounded::<()>(0);
        let waits = move || blocked.recv().is_ok();
        let late = in_time(Duration::from_millis(20), waits).unwrap_err();
        assert_eq!(late, "did not end within 0.02 s");
        assert_eq!(in_time(Duration::from_secs(60), || 7), Ok(7));
        drop(release);
    }
}
