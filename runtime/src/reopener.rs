//! Opening of a lost port or connection: attempts after growing pauses, each on a separate thread, because an attempt may block for longer
//! than the service's watchdog allows the background thread.

use std::fmt::Display;
use std::thread;

use crossbeam_channel::{Receiver, TryRecvError, bounded};
use oqtal_bus::time::{Span, Time};

/// Pause before the first attempt.
const SHORTEST_PAUSE: Span = Span::from_millis(100);
/// Duration of an attempt above which it is logged, once per search.
const LONG_ATTEMPT: Span = Span::from_millis(10_000);
/// Longest pause between two attempts.
const LONGEST_PAUSE: Span = Span::from_millis(2000);

/// Search for a lost port or connection of type `T`; polled by the background thread.
#[derive(Debug)]
pub struct Reopener<T> {
    /// Duration of a good connection: after one, the next search begins with the shortest pause.
    good_time: Span,
    /// Instant of the next attempt, or of the present one; `None` while nothing is lost.
    next: Option<Time>,
    /// Result of the present attempt.
    attempt: Option<Receiver<Result<T, String>>>,
    pause: Span,
    opened_at: Time,
    /// Reason of the last failure since a success, which was logged.
    last_reason: String,
    /// Whether a long attempt was logged since a success.
    is_long_logged: bool,
}

impl<T: Send + 'static> Reopener<T> {
    /// Search that has not begun. Pauses grow over connections that are lost within `good_time`.
    pub fn new(good_time: Span) -> Self {
        Self {
            good_time,
            next: None,
            attempt: None,
            pause: Span::ZERO,
            opened_at: Time::UNSET,
            last_reason: String::new(),
            is_long_logged: false,
        }
    }

    /// Begins to search.
    pub fn begin(&mut self, now: Time) {
        let was_good = !self.opened_at.is_set() || now.since(self.opened_at) >= self.good_time;
        self.pause = if was_good { SHORTEST_PAUSE } else { self.grown() };
        self.next = Some(now + self.pause);
    }

    /// Starts an attempt, `open`, if one is due; returns what an earlier one has opened. Does not block. A reason for a failure is
    /// logged once.
    pub fn poll<E: Display>(
        &mut self,
        now: Time,
        open: impl FnOnce() -> Result<T, E> + Send + 'static,
    ) -> Option<T> {
        let Some(attempt) = &self.attempt else {
            if self.next.is_some_and(|next| now >= next) {
                self.attempt = Some(spawn_attempt(open));
            }
            return None;
        };
        let result = match attempt.try_recv() {
            Err(TryRecvError::Empty) => {
                let is_long = self.next.is_some_and(|since| now.since(since) >= LONG_ATTEMPT);
                if is_long && !self.is_long_logged {
                    tracing::warn!("opening takes longer than 10 s");
                    self.is_long_logged = true;
                }
                return None;
            }
            Err(TryRecvError::Disconnected) => {
                Err("the thread that opens it could not be started, or failed".to_owned())
            }
            Ok(result) => result,
        };
        self.attempt = None;
        match result {
            Ok(opened) => {
                (self.next, self.opened_at) = (None, now);
                self.last_reason.clear();
                self.is_long_logged = false;
                Some(opened)
            }
            Err(reason) => {
                if reason != self.last_reason {
                    tracing::warn!("{reason}");
                    self.last_reason = reason;
                }
                self.pause = self.grown();
                self.next = Some(now + self.pause);
                None
            }
        }
    }

    fn grown(&self) -> Span {
        self.pause.max(SHORTEST_PAUSE).scaled(2.0).min(LONGEST_PAUSE)
    }
}

/// Executes `open` on a thread of its own; nothing is sent if that thread cannot be started.
fn spawn_attempt<T: Send + 'static, E: Display>(
    open: impl FnOnce() -> Result<T, E> + Send + 'static,
) -> Receiver<Result<T, String>> {
    let (result, attempt) = bounded(1);
    let open = move || {
        // The process may have ended its search.
        let _ = result.send(open().map_err(|error| error.to_string()));
    };
    let _ = thread::Builder::new().name("open".to_owned()).spawn(open);
    attempt
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    const GOOD_TIME: Span = Span::from_millis(5000);

    /// Result of the attempt that is due at `now`.
    fn attempt(
        search: &mut Reopener<u8>,
        now: Time,
        result: Result<u8, &'static str>,
    ) -> Option<u8> {
        assert_eq!(search.poll(now, move || result), None);
        while search.attempt.as_ref().unwrap().is_empty() {
            thread::yield_now();
        }
        search.poll(now, || Err("nothing is due"))
    }

    #[test]
    fn attempts_have_growing_pauses_of_two_seconds_at_most() {
        let mut search = Reopener::new(GOOD_TIME);
        let (mut now, mut pauses) = (Time::VIRTUAL_START, Vec::new());
        search.begin(now);
        for _ in 0..7 {
            let next = search.next.unwrap();
            pauses.push(next.since(now).nanos() / 1_000_000);
            now = next;
            assert_eq!(attempt(&mut search, now, Err("none")), None);
        }
        assert_eq!(pauses, [100, 200, 400, 800, 1600, 2000, 2000]);
    }

    #[test]
    fn a_connection_that_is_lost_at_once_is_retried_after_a_growing_pause() {
        let mut search = Reopener::new(GOOD_TIME);
        let mut now = Time::VIRTUAL_START;
        let mut pauses = Vec::new();
        for held in [10, 10, 5000, 10] {
            search.begin(now);
            let next = search.next.unwrap();
            pauses.push(next.since(now).nanos() / 1_000_000);
            assert_eq!(attempt(&mut search, next, Ok(7)), Some(7));
            assert_eq!(search.poll(next + GOOD_TIME, || Ok::<_, String>(8)), None, "it is open");
            now = next + Span::from_millis(held);
        }
        assert_eq!(pauses, [100, 200, 400, 100]);
    }

    #[test]
    fn f15_a_poll_does_not_wait_for_an_attempt() {
        let mut search = Reopener::new(GOOD_TIME);
        let now = Time::VIRTUAL_START;
        search.begin(now);
        let due = search.next.unwrap();
        let (answer, answered) = bounded::<u8>(1);
        let (asked, is_asked) = bounded(1);
        let open = move || {
            asked.send(()).unwrap();
            answered.recv_timeout(Duration::from_secs(60))
        };
        assert_eq!(search.poll(due, open), None);
        is_asked.recv().unwrap();
        assert_eq!(search.poll(due, || Ok::<_, String>(8)), None, "one attempt at a time");
        answer.send(7).expect("the attempt is being made");
        while search.attempt.as_ref().unwrap().is_empty() {
            thread::yield_now();
        }
        assert_eq!(search.poll(due, || Ok::<_, String>(8)), Some(7));
    }

    #[test]
    fn the_duration_and_the_reason_of_failed_attempts_are_logged_once_each() {
        let mut search = Reopener::<u8>::new(GOOD_TIME);
        search.begin(Time::VIRTUAL_START);
        for (reason, result) in [("", Err("none")), ("none", Err("none")), ("none", Ok(7))] {
            let due = search.next.unwrap();
            let (answer, answered) = bounded(1);
            assert_eq!(search.poll(due, move || answered.recv().unwrap()), None);
            let late = due + LONG_ATTEMPT;
            assert_eq!(search.poll(late, || Err("one attempt at a time")), None);
            assert_eq!((search.last_reason.as_str(), search.is_long_logged), (reason, true));
            answer.send(result).unwrap();
            while search.attempt.as_ref().unwrap().is_empty() {
                thread::yield_now();
            }
            assert_eq!(search.poll(late, || Err("nothing is due")), result.ok());
        }
        assert_eq!((search.last_reason.as_str(), search.is_long_logged), ("", false));
    }
}
