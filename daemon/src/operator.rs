//! Requests of operators: from the background thread, which checks them, to the loop, which executes them between two turns.

mod answer;
mod loop_handle;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use oqtal_bus::code::{Answer, Cause, Mode, OperatorCommand};
use oqtal_bus::message::{AS_STARTED, ControlRequestV1, ControlResponseV1, EventV1};
use oqtal_bus::text::LongText;
use oqtal_bus::time::Time;
use oqtal_config::Config;
use oqtal_runtime::handoff::{BackgroundHandle, handoff};

use crate::condition::{Condition, Followed};
use crate::cycle::FirstFlight;
use crate::live::{LiveSettings, PreparedChange};
use crate::refusal::require_braking;
use crate::timed_job::in_time;

use answer::{
    event, first_lines, publish_answered, refused, refused_event, unchanged_text, with_place,
    with_reason, with_warnings,
};
pub use loop_handle::{LoopHandle, LoopRequest};
use loop_handle::{NumberedReply, NumberedRequest, RequestNumber, Validity};

/// Time-out of the loop's reply; an operator's request without a reply is then answered with "accepted".
const REPLY_TIMEOUT: Duration = Duration::from_millis(60);

/// Longest time in which warnings of a change are found. With the reading of a file it stays within the second of the watchdog.
const WARNING_TIMEOUT: Duration = Duration::from_millis(400);

/// Requests of operators, on the background thread's side of the hand-off.
#[derive(Debug)]
pub struct OperatorRequests {
    queues: BackgroundHandle<Condition, NumberedRequest, NumberedReply>,
    configs_differ: Arc<AtomicBool>,
    count: RequestNumber,
    /// The last known condition of the loop.
    pub(crate) last: Condition,
    /// Whether the law is external, and none is connected.
    pub(crate) lacks_law: bool,
    /// Warning about the rate of the poses.
    pub(crate) warning: Option<String>,
    config_hash: u64,
    /// Settings of the daemon; `None` without its background thread.
    pub(crate) settings: Option<LiveSettings>,
    /// Number of requests that change a flight or its settings so far.
    events: u64,
    /// Course of the present flight, as text, if it may differ from the configured one: set by an operator, or kept when the settings
    /// changed.
    course: Option<String>,
    /// Instant until which the last request for a flight may be executed.
    flight_until: Time,
}

/// The configured course, in words.
fn configured_course(config: &Config) -> String {
    let kind = config.value("trajectory.kind").unwrap_or_default();
    format!("trajectory {}", kind.trim_matches('"'))
}

/// Both ends.
pub fn loop_handoff() -> (LoopHandle, OperatorRequests) {
    let (realtime, background) = handoff();
    let differ = Arc::new(AtomicBool::new(false));
    (
        LoopHandle::new(realtime, Arc::clone(&differ)),
        OperatorRequests {
            queues: background,
            configs_differ: differ,
            count: 0,
            last: Condition::default(),
            lacks_law: false,
            warning: None,
            config_hash: 0,
            settings: None,
            events: 0,
            course: None,
            flight_until: Time::UNSET,
        },
    )
}

/// The warnings that `job` finds in time; else a line that says so.
fn within_time(job: impl FnOnce() -> Vec<String> + Send + 'static) -> Vec<String> {
    in_time(WARNING_TIMEOUT, job).unwrap_or_else(|reason| {
        vec![format!("the search for warnings {reason}; `oqtal check` has them for a file")]
    })
}

impl OperatorRequests {
    /// Tells the loop whether the processes of the instance run with different configurations.
    pub fn note_configs_differ(&self, differ: bool) {
        self.configs_differ.store(differ, Ordering::Relaxed);
    }

    /// Takes in and logs the changes of the condition.
    pub(crate) fn take_changes(&mut self) {
        for condition in self.queues.notes() {
            if condition.is_logged_after(&self.last) {
                condition.log();
            }
            if condition.first_flight == FirstFlight::Refused
                && self.last.first_flight != FirstFlight::Refused
            {
                tracing::warn!(
                    "no take-off at start: the vehicle is not simulated; arm it when everybody is clear"
                );
            }
            self.last = condition;
        }
    }

    /// These requests, for a daemon with the configuration hash `config_hash` and these settings.
    pub(crate) fn with_settings(self, config_hash: u64, settings: LiveSettings) -> Self {
        Self { config_hash, settings: Some(settings), ..self }
    }

    /// The reply of a loop in the last known condition.
    fn present(&self, answer: Answer) -> ControlResponseV1 {
        let Condition { mode, state, cause, obstacles, .. } = self.last;
        let (answer, config_hash) = (answer.code(), self.config_hash);
        let text = LongText::EMPTY;
        ControlResponseV1 { answer, mode, state, cause, config_hash, obstacles, text }
    }

    /// Answers a request: checks it, passes it to the loop, and waits for the reply. `publish` receives the events.
    pub(crate) fn ask(
        &mut self,
        request: ControlRequestV1,
        publish: &mut dyn FnMut(EventV1),
    ) -> ControlResponseV1 {
        let Some(command) = OperatorCommand::from_code(request.command) else {
            return self.present(Answer::Refused);
        };
        let is_other = request.config_hash != 0 && request.config_hash != self.config_hash;
        if is_other && command.begins_flight() {
            let response = refused(Cause::OtherConfig, self.present(Answer::Refused));
            return self.refuse(&request, response, publish);
        }
        if command.begins_flight() {
            return self.begin(command, &request, publish);
        }
        if command.changes_flight() {
            return self.change(command, &request, publish);
        }
        if command == OperatorCommand::Get {
            return self.get(request.text.as_str());
        }
        let is_status = command == OperatorCommand::Status;
        let event = if is_status { 0 } else { self.next_event() };
        let response =
            self.pass_on(LoopRequest::Operator { command, event }, Validity::of(&request));
        if is_status {
            self.take_changes();
            let law = self.law_and_trajectory(response.mode);
            let pending = self.last.first_flight.pending_text().map(str::to_owned);
            let text = first_lines(&[law].into_iter().chain(pending).collect::<Vec<_>>());
            return ControlResponseV1 { text, ..response };
        }
        publish_answered(&request, event, &response, publish);
        response
    }

    /// Publishes the refusal `response` of a request that does not reach the loop.
    fn refuse(
        &mut self,
        request: &ControlRequestV1,
        response: ControlResponseV1,
        publish: &mut dyn FnMut(EventV1),
    ) -> ControlResponseV1 {
        publish_answered(request, self.next_event(), &response, publish);
        response
    }

    /// Number of the next request on topic `event`.
    fn next_event(&mut self) -> u64 {
        self.events += 1;
        self.events
    }

    /// Law and trajectory of the present flight; in the `mode` "disarmed", those of the next one. The law alone of a daemon that only
    /// observes.
    fn law_and_trajectory(&self, mode: u8) -> String {
        let Some(settings) = &self.settings else { return String::new() };
        let config = settings.present();
        let law = self.last.law(config, mode, self.lacks_law);
        if config.safety.observe_only {
            return law;
        }
        let in_flight = self.course.clone().filter(|_| mode != Mode::Disarmed.code());
        let course = in_flight.unwrap_or_else(|| configured_course(config));
        let course = match self.last.followed {
            _ if mode == Mode::Landing.code() => "landing".to_owned(),
            Followed::Planner => "references of a planner".to_owned(),
            Followed::Ended => "at the end of the references".to_owned(),
            Followed::End => format!("{course}, at its end"),
            Followed::Ignored => {
                format!("{course}; references of a planner are ignored until they pause")
            }
            Followed::Course => course,
        };
        let refusal = self.last.refusal().map(|refusal| format!("set-point refused: {refusal}"));
        let notes = refusal.into_iter().chain(self.warning.clone());
        notes.fold(format!("{law}, {course}"), |text, note| format!("{text}; {note}"))
    }

    /// Forwards a request for a flight; the answer, and an event for recordings that began later, name the settings that were changed since
    /// the start. The answer also says that no external law is connected.
    fn begin(
        &mut self,
        command: OperatorCommand,
        request: &ControlRequestV1,
        publish: &mut dyn FnMut(EventV1),
    ) -> ControlResponseV1 {
        let changed = first_lines(&self.changed());
        if !changed.is_empty() && request.text.as_str() == AS_STARTED {
            let present = self.present(Answer::Refused);
            let response =
                refused(Cause::OtherConfig, ControlResponseV1 { text: changed, ..present });
            return self.refuse(request, response, publish);
        }
        let event = self.next_event();
        let response =
            self.pass_on(LoopRequest::Operator { command, event }, Validity::of(request));
        if response.answer == Answer::Refused.code() {
            publish_answered(request, event, &response, publish);
            return response;
        }
        (self.course, self.flight_until) = (None, request.valid_until);
        let response = ControlResponseV1 { text: changed, ..response };
        publish_answered(request, event, &response, publish);
        let settings = self.settings.as_ref().filter(|_| self.lacks_law);
        let Some(config) = settings.map(LiveSettings::present) else { return response };
        let law = self.last.law(config, Mode::Disarmed.code(), true);
        ControlResponseV1 { text: first_lines(&[vec![law], self.changed()].concat()), ..response }
    }

    fn changed(&self) -> Vec<String> {
        self.settings.as_ref().map_or_else(Vec::new, LiveSettings::changed)
    }

    /// Reports the value of the setting `key`; without a key, the law and trajectory that fly, and the settings changed since the start.
    fn get(&self, key: &str) -> ControlResponseV1 {
        let present = self.present(Answer::Done);
        if key.is_empty() {
            let lines = [vec![self.law_and_trajectory(present.mode)], self.changed()].concat();
            return ControlResponseV1 { text: first_lines(&lines), ..present };
        }
        match self.settings.as_ref().map(|settings| settings.get(key)) {
            Some(Ok(value)) => ControlResponseV1 { text: LongText::new(&value), ..present },
            Some(Err(refusal)) => with_reason(&refusal, present),
            None => self.present(Answer::Refused),
        }
    }

    /// Prepares a change and passes it to the loop; its events go to `publish`.
    fn change(
        &mut self,
        command: OperatorCommand,
        request: &ControlRequestV1,
        publish: &mut dyn FnMut(EventV1),
    ) -> ControlResponseV1 {
        let number = self.next_event();
        let Some(settings) = &self.settings else { return self.present(Answer::Refused) };
        let mut event = EventV1 { number, ..event(request, Answer::Accepted) };
        let is_flying = Mode::from_code(self.last.mode).is_some_and(Mode::commands_motors);
        let prepared = settings.prepare(command, request).and_then(|prepared| {
            let next = prepared.next_config().filter(|_| is_flying);
            next.map_or(Ok(()), |next| require_braking(settings.present(), next))?;
            Ok(prepared)
        });
        let response = match prepared {
            Err(refusal) => with_reason(&refusal, self.present(Answer::Refused)),
            Ok(mut prepared) if settings.are_unchanged_by(&prepared) => {
                self.settings.iter_mut().for_each(|settings| settings.commit(&mut prepared));
                let text = unchanged_text(request, &prepared.text);
                return ControlResponseV1 { text, ..self.present(Answer::Done) };
            }
            // Settings that come late would surprise in another phase of the flight.
            Ok(_) if self.queues.is_full() || Validity::of(request).is_over() => {
                refused(Cause::Expired, self.present(Answer::Refused))
            }
            Ok(prepared) => {
                let is_of_settings = prepared.changes_settings();
                let warnings = settings.new_warnings(&prepared);
                // A change of settings does not change the course of a flight under way.
                if is_flying {
                    self.course.get_or_insert_with(|| configured_course(settings.present()));
                }
                event.text = prepared.text;
                publish(event);
                let response = self.hand_over(prepared, &event, Validity::of(request));
                // The flight does not wait for the warnings, and neither do later requests for long.
                let found = if is_of_settings { within_time(warnings) } else { warnings() };
                with_warnings(response, &found)
            }
        };
        if response.answer == Answer::Refused.code() {
            publish(refused_event(event, &response));
        }
        response
    }

    /// Passes a change to the loop. Settings do not expire: those of the loop and of this thread must agree.
    fn hand_over(
        &mut self,
        mut prepared: PreparedChange,
        event: &EventV1,
        validity: Validity,
    ) -> ControlResponseV1 {
        let is_of_settings = prepared.changes_settings();
        if let Some(settings) = &mut self.settings {
            settings.commit(&mut prepared);
        }
        let command = OperatorCommand::from_code(event.command).unwrap_or(OperatorCommand::Set);
        let change = LoopRequest::Change { command, event: event.number, change: prepared.change };
        let until = if is_of_settings { Time::UNSET } else { validity.until };
        let response = self.pass_on(change, Validity { until, ..validity });
        let response = match command {
            OperatorCommand::Trajectory => {
                with_place(response, || self.settings.as_ref()?.place_for(event.text.as_str()))
            }
            _ => response,
        };
        if response.answer != Answer::Refused.code() {
            self.course = match command {
                OperatorCommand::Trajectory => Some(format!("trajectory {}", event.text.as_str())),
                OperatorCommand::Goto | OperatorCommand::Hover => Some(command.to_string()),
                _ => self.course.take(),
            };
        }
        let text = if is_of_settings { event.text } else { response.text };
        ControlResponseV1 { text, ..response }
    }

    /// Passes a request to the loop and waits for the reply, at most [`REPLY_TIMEOUT`], since the loop may hang. A request without a reply
    /// is reported as accepted, or as refused if it needs a flight and none is under way or expected; it stays in the queue either way.
    fn pass_on(&mut self, request: LoopRequest, validity: Validity) -> ControlResponseV1 {
        self.count += 1;
        let has_flight = self.last.has_flight() || Time::now() < self.flight_until;
        let is_idle = request.name().0.needs_flight() && !has_flight;
        let (config_hash, reply) = (self.config_hash, |answer| self.present(answer));
        if self.queues.send((self.count, request, validity)).is_err() {
            return reply(Answer::Refused);
        }
        let timeout = crossbeam_channel::after(REPLY_TIMEOUT);
        loop {
            crossbeam_channel::select! {
                recv(self.queues.replies()) -> answer => match answer {
                    Ok((number, response, _)) if number == self.count => {
                        return ControlResponseV1 { config_hash, ..response };
                    }
                    // The late reply to an earlier request.
                    Ok(_) => {}
                    Err(_) => return reply(Answer::Refused),
                },
                recv(timeout) -> _ => return match is_idle {
                    true => refused(Cause::WrongMode, reply(Answer::Refused)),
                    false => reply(Answer::Accepted),
                },
            }
        }
    }
}

#[cfg(test)]
mod tests;
