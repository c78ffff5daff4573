//! Law, trajectory and changed settings of a running daemon, asked of it by an observer.

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, OperatorCommand};
use oqtal_bus::message::{ControlRequestV1, EventV1};
use oqtal_bus::text::LongText;
use oqtal_bus::time::{Span, Time};

/// Time between two questions of an observer.
const PERIOD: Span = Span::from_millis(1000);
/// Time-out of the question; the daemon's background thread answers it, not its loop.
const TIMEOUT: Span = Span::from_millis(50);

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
        ask(bus)?.lines().next().map(str::to_owned)
    }
}

/// Event with the settings that were changed before an observation began; `None` without one, and if no daemon answers.
pub fn changed_before(bus: &Bus) -> Option<EventV1> {
    let text = ask(bus)?;
    let (_, changed) = text.split_once('\n')?;
    let command = OperatorCommand::Set.code();
    let base = EventV1 { time: Time::now(), command, ..EventV1::default() };
    let ControlRequestV1 { process, user, program, .. } = request();
    let text = LongText::of_lines(changed.lines())?;
    Some(EventV1 { process, user, program, text, ..base })
}

/// The daemon's answer: law and trajectory in the first line, below it the changed settings.
fn ask(bus: &Bus) -> Option<String> {
    let client = bus.control_client().ok()?;
    let response = client.ask(request(), TIMEOUT).ok()??;
    (response.answer == Answer::Done.code()).then(|| response.text.as_str().to_owned())
}

fn request() -> ControlRequestV1 {
    ControlRequestV1::of(OperatorCommand::Get).by("oqtal")
}
