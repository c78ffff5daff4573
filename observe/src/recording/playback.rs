//! A recording as samples for a sink, and as a flight.

use oqtal_bus::message::{Header, Message};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;

use super::cdr;
use super::channel::{Channel, schema_id};
use super::closing::ClosingFacts;
use super::file::{RecordedMessage, RecordingFile, RecordingFileError};
use crate::flight::{Flight, Outcome};
use crate::recorder::Recorder;
use crate::sink::{ObservedTopic, Reception, Sink};

/// The flight of a recording, as the flight recorder made it when it was flown.
///
/// # Errors
/// The recording has other message definitions or no valid configuration.
pub fn flight(file: &RecordingFile) -> Result<Flight, RecordingFileError> {
    let config = config(file)?;
    let mut recorder = Recorder::new(&config);
    play(file, &mut recorder)?;
    let ClosingFacts { command_path, outcome, speed_factor, daemon } = ClosingFacts::read(file);
    let flight = recorder.finish(outcome.unwrap_or(Outcome::Unfinished), speed_factor);
    Ok(Flight { command_path, daemon, ..flight })
}

/// The effective configuration of a recording.
///
/// # Errors
/// The recording has no configuration, or one that this version does not accept.
pub fn config(file: &RecordingFile) -> Result<Config, RecordingFileError> {
    let name = format!("{} (config.toml)", file.path.display());
    Config::parse(&name, &file.config_text()?, &[])
        .map_err(|error| file.other_version(&format!("configuration ({error})")))
}

/// Passes every message of a topic to `sink`, in the order in which they were recorded.
///
/// # Errors
/// A topic was recorded with another message definition.
pub fn play(file: &RecordingFile, sink: &mut impl Sink) -> Result<(), RecordingFileError> {
    let topics: Vec<(String, ObservedTopic)> = Channel::all()
        .filter_map(|channel| match channel {
            Channel::Topic(topic) => Some((topic.to_string(), topic)),
            _ => None,
        })
        .collect();
    let find = |name: &str| topics.iter().find(|(known, _)| known == name).map(|(_, topic)| *topic);
    let offset = Span::from_nanos(file.wall_offset_ns());
    for message in &file.messages {
        let topic = file.channels.get(&message.channel).and_then(|channel| find(&channel.topic));
        let Some(topic) = topic else { continue };
        let received_at = Time::from_nanos(message.log_time) - offset;
        Played { file, message, received_at }.pass(topic, sink)?;
    }
    Ok(())
}

/// A message on its way to a sink.
struct Played<'a> {
    file: &'a RecordingFile,
    message: &'a RecordedMessage,
    received_at: Time,
}

impl Played<'_> {
    fn pass(&self, topic: ObservedTopic, sink: &mut impl Sink) -> Result<(), RecordingFileError> {
        match topic {
            ObservedTopic::Truth => self.decoded().map(|(r, m)| sink.truth(&r, &m)),
            ObservedTopic::Pose => self.decoded().map(|(r, m)| sink.pose(&r, &m)),
            ObservedTopic::Command => self.decoded().map(|(r, m)| sink.command(&r, &m)),
            ObservedTopic::Vehicle => self.decoded().map(|(r, m)| sink.vehicle(&r, &m)),
            ObservedTopic::Telemetry => self.decoded().map(|(r, m)| sink.telemetry(&r, &m)),
            ObservedTopic::Input => self.decoded().map(|(r, m)| sink.input(&r, &m)),
            ObservedTopic::PoseRead => self.decoded().map(|(r, m)| sink.pose_read(&r, &m)),
            ObservedTopic::VehicleRead => self.decoded().map(|(r, m)| sink.vehicle_read(&r, &m)),
            ObservedTopic::Health(role) => self.decoded().map(|(r, m)| sink.health(&r, role, &m)),
        }
    }

    fn decoded<M: Message>(&self) -> Result<(Reception, M), RecordingFileError> {
        let channel = &self.file.channels[&self.message.channel];
        let agrees = channel.definition == schema_id::<M>();
        let decoded: Option<(Header, M)> =
            if agrees { cdr::decode(&self.message.data) } else { None };
        let Some((header, body)) = decoded else {
            let what = format!("definition of the messages of `{}`", channel.topic);
            return Err(self.file.other_version(&what));
        };
        Ok((Reception { header, received_at: self.received_at }, body))
    }
}
