//! Law, trajectory and changed settings of a running daemon, asked of it by an observer.

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, OperatorCommand};
use oqtal_bus::message::{ControlRequestV1, EventV1};
use oqtal_bus::text::LongText;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;

/// Time between two questions of an observer.
const PERIOD: Span = Span::from_millis(1000);
/// Time-out of the question; the daemon's background thread answers it, not its loop.
const TIMEOUT: Span = Span::from_millis(50);
/// Time-out of the question on whose answer a result depends.
const RESULT_TIMEOUT: Span = Span::from_millis(2000);

/// No complete answer to the question for the changed settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoAnswer {
    /// No daemon runs.
    NoDaemon,
    /// A daemon runs, but did not answer in time.
    Silent,
    /// More settings were changed than an answer can name.
    Incomplete,
}

/// Asks the daemon for its law and trajectory, at most once a second.
#[derive(Debug, Default)]
pub struct LawQuery {
    asked_at: Option<Time>,
}

impl LawQuery {
    /// Law and trajectory as text, at most once a second; `None` in between, and if no daemon answers.
    pub fn poll(&mut self, bus: &Bus, now: Time) -> Option<String> {
        if self.asked_at.is_some_and(|at| now.since(at) < PERIOD) {
            return None;
        }
        self.asked_at = Some(now);
        ask(bus, TIMEOUT)?.lines().next().map(str::to_owned)
    }
}

/// Event with the settings that were changed before an observation began; `None` if none were. Waits for a daemon that runs.
///
/// # Errors
/// No daemon answers, or not with all settings.
pub fn changed_before(bus: &Bus) -> Result<Option<EventV1>, NoAnswer> {
    let (timeout, reason) = match bus.holder(&Role::Daemon.health()) {
        Ok(None) => (TIMEOUT, NoAnswer::NoDaemon),
        _ => (RESULT_TIMEOUT, NoAnswer::Silent),
    };
    let answer = ask(bus, timeout).ok_or(reason)?;
    let Some((_, changed)) = answer.split_once('\n') else { return Ok(None) };
    if !changed.lines().skip(1).all(|line| line.contains('=')) {
        return Err(NoAnswer::Incomplete);
    }
    let command = OperatorCommand::Set.code();
    let base = EventV1 { time: Time::now(), command, ..EventV1::default() };
    let ControlRequestV1 { process, user, program, .. } = request();
    let text = LongText::of_lines(changed.lines()).ok_or(reason)?;
    Ok(Some(EventV1 { process, user, program, text, ..base }))
}

/// The daemon's answer: law and trajectory in the first line, below it the changed settings.
fn ask(bus: &Bus, timeout: Span) -> Option<String> {
    let client = bus.control_client().ok()?;
    let response = client.ask(request(), timeout).ok()??;
    (response.answer == Answer::Done.code()).then(|| response.text.as_str().to_owned())
}

fn request() -> ControlRequestV1 {
    ControlRequestV1::of(OperatorCommand::Get).by("oqtal")
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::paths::InstancePaths;
    use oqtal_bus::transport::Transport;

    #[test]
    fn no_answer_does_not_mean_that_nothing_was_changed() {
        let root = tempfile::tempdir().unwrap();
        let bus = Bus::open(&InstancePaths::new("answer", Some(root.path())).unwrap()).unwrap();
        assert_eq!(changed_before(&bus).map(drop), Err(NoAnswer::NoDaemon));
        // A daemon whose background thread does not run.
        let _daemon = bus.writer(&Role::Daemon.health()).unwrap();
        assert_eq!(changed_before(&bus).map(drop), Err(NoAnswer::Silent));
    }
}
