//! A recording as samples for a sink, and as a flight.

use std::collections::BTreeMap;

use oqtal_bus::message::Message;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Sample, Topic, TopicVisitor};
use oqtal_config::{ClockKind, Config};

use super::cdr;
use super::channel::schema_id;
use super::closing::ClosingFacts;
use super::file::{RecordedChannel, RecordedMessage, RecordingFile, RecordingFileError};
use crate::flight::{Flight, Outcome};
use crate::recorder::Recorder;
use crate::sink::{Reception, Sink};

/// Flight of a recording, identical to the record made by the flight recorder.
///
/// # Errors
/// The recording is of a version with other message definitions, or has no valid configuration.
pub fn flight(file: &RecordingFile) -> Result<Flight, RecordingFileError> {
    let config = config(file)?;
    let mut recorder = Recorder::new(&config);
    play(file, &mut recorder)?;
    let ClosingFacts { command_path, outcome, speed_factor, daemon, lost_requests } =
        ClosingFacts::read(file);
    let open = if config.safety.observe_only { Outcome::Observed } else { Outcome::Unfinished };
    // Without its closing facts, the duration of a flight in virtual time is not known.
    let unclosed = if config.clock.kind == ClockKind::Real { 1.0 } else { f64::NAN };
    let flight = recorder.finish(outcome.unwrap_or(open), speed_factor.unwrap_or(unclosed));
    let command_path = command_path.unwrap_or(flight.command_path);
    // The recorder reports a flight that was landed because it lasted too long as landed.
    let is_late = outcome == Some(Outcome::Timeout) && flight.outcome == Outcome::Landed;
    let outcome = if is_late { Outcome::Timeout } else { flight.outcome };
    Ok(Flight { command_path, outcome, daemon, lost_requests, ..flight })
}

/// The effective configuration of a recording.
///
/// # Errors
/// The recording has no configuration, or one that this version rejects.
pub fn config(file: &RecordingFile) -> Result<Config, RecordingFileError> {
    let name = format!("{} (config.toml)", file.path.display());
    Config::parse(&name, &file.config_text()?, &[])
        .map_err(|error| file.other_version(&format!("configuration ({error})")))
}

/// Passes every message of a topic to `sink`, in recording order.
///
/// # Errors
/// A topic was recorded with another message definition.
pub fn play(file: &RecordingFile, sink: &mut dyn Sink) -> Result<(), RecordingFileError> {
    let topics: BTreeMap<String, ObservedTopic> =
        ObservedTopic::all().map(|topic| (topic.to_string(), topic)).collect();
    let offset = Span::from_nanos(file.wall_offset_ns());
    for message in &file.messages {
        let Some(channel) = file.channels.get(&message.channel) else { continue };
        let Some(topic) = topics.get(&channel.topic) else { continue };
        let received_at = Time::from_nanos(message.log_time) - offset;
        let is_known = topic.visit(Playback { channel, message, received_at, sink });
        if !is_known {
            let what = format!("definition of the messages of `{topic}`");
            return Err(file.other_version(&what));
        }
    }
    Ok(())
}

/// Passes a message to a sink; returns `false` if it has another definition.
struct Playback<'a> {
    channel: &'a RecordedChannel,
    message: &'a RecordedMessage,
    received_at: Time,
    sink: &'a mut dyn Sink,
}

impl TopicVisitor for Playback<'_> {
    type Output = bool;

    fn visit<M: Message>(
        self,
        _: &Topic<M>,
        sample: impl for<'a> Fn(&'a M) -> Sample<'a> + 'static,
    ) -> bool {
        let Self { channel, message, received_at, sink } = self;
        let agrees = channel.definition == schema_id::<M>();
        let decoded = if agrees { cdr::decode::<M>(&message.data) } else { None };
        if let Some((header, body)) = &decoded {
            sink.sample(&Reception { header: *header, received_at }, sample(body));
        }
        decoded.is_some()
    }
}
