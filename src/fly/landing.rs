//! A landing that an operator requested by an interrupt: it is requested until the daemon confirms it.

use std::sync::mpsc::{Receiver, TryRecvError, channel};

use oqtal_bus::code::OperatorCommand;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_operator::end_flight;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::{beside, say};

/// Time within which the daemon must confirm a landing. Its processes must not end before: the vehicle would fall.
const CONFIRMED_WITHIN: Span = Span::from_millis(10_000);

/// A requested landing. `R` requests it once more, and returns a channel that receives whether the daemon confirmed it.
#[derive(Debug)]
pub struct Landing<R> {
    request: R,
    requested_at: Time,
    /// The answer to the present request; `None` once the daemon confirmed the landing.
    answer: Option<Receiver<bool>>,
    is_wait_told: bool,
}

/// Requests a landing at `paths` on a separate thread, so that a stop need not wait for the answer.
pub fn request(paths: &InstancePaths) -> Receiver<bool> {
    let (answers, answer) = channel();
    let paths = paths.clone();
    beside(move || {
        // Fails once the flight has ended.
        let _ = answers.send(end_flight(&paths, OperatorCommand::Land));
    });
    answer
}

impl<R: Fn() -> Receiver<bool>> Landing<R> {
    /// Requests a landing at `now`.
    pub fn begin(request: R, now: Time) -> Self {
        let answer = Some(request());
        Self { request, requested_at: now, answer, is_wait_told: false }
    }

    /// Requests the landing again if the daemon has not confirmed it.
    ///
    /// # Errors
    /// The daemon has not confirmed it within [`CONFIRMED_WITHIN`] (exit code 1).
    pub fn check(&mut self, now: Time) -> Result<(), Failure> {
        let bound_s = CONFIRMED_WITHIN.seconds();
        match self.answer.as_ref().map(Receiver::try_recv) {
            None | Some(Err(TryRecvError::Empty)) => {}
            Some(Ok(true)) => self.answer = None,
            Some(Ok(false) | Err(TryRecvError::Disconnected)) => {
                if now.since(self.requested_at) >= CONFIRMED_WITHIN {
                    let message = format!(
                        "the daemon has not confirmed the landing within {bound_s} s: the processes of the flight end"
                    );
                    return Err(Failure::new(Exit::Flight, message));
                }
                if !std::mem::replace(&mut self.is_wait_told, true) {
                    say(&format!(
                        "oqtal: waits up to {bound_s} s until the daemon confirms the landing; Ctrl-C stops the motors"
                    ));
                }
                self.answer = Some((self.request)());
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    /// A landing whose request number `confirmed` is confirmed, with the number of requests so far.
    fn landing(confirmed: u32, count: &Cell<u32>) -> Landing<impl Fn() -> Receiver<bool>> {
        let request = move || {
            let (answers, answer) = channel();
            count.set(count.get() + 1);
            answers.send(count.get() == confirmed).unwrap();
            answer
        };
        Landing::begin(request, at(0))
    }

    #[test]
    fn a_landing_is_requested_until_it_is_confirmed() {
        let count = Cell::new(0);
        let mut landing = landing(3, &count);
        for (millis, requests) in [(950, 2), (1900, 3), (2850, 3), (60_000, 3)] {
            landing.check(at(millis)).unwrap();
            assert_eq!(count.get(), requests, "{millis} ms");
        }
    }

    #[test]
    fn a_landing_that_is_never_confirmed_ends_after_its_bound() {
        let count = Cell::new(0);
        let mut landing = landing(0, &count);
        landing.check(at(9999)).unwrap();
        let failure = landing.check(at(10_000)).unwrap_err();
        assert!(failure.message.contains("within 10 s"), "{failure}");
    }
}
