//! Commands of a client, as text.

use std::fmt;
use std::str::FromStr;

use super::component::ComponentSet;
use super::selection::ParameterSelection;
use super::stream_request::{StreamRequest, parse_components};
use super::version::QtmVersion;

/// Command of a client. Names are read in any case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum QtmCommand {
    /// `Version n.n`: sets the version of the connection.
    SetVersion(QtmVersion),
    /// `Version`: asks for the version of the connection.
    Version,
    /// `QTMVersion`: asks for the version of the server.
    ServerVersion,
    /// `ByteOrder`.
    ByteOrder,
    /// `GetState`: asks for an event packet with the state. `GetLastEvent` in old versions.
    State,
    /// `GetParameters`.
    Parameters(ParameterSelection),
    /// `GetCurrentFrame`.
    CurrentFrame(ComponentSet),
    /// `StreamFrames`.
    Stream(StreamRequest),
    /// `StreamFrames Stop`.
    StreamStop,
    /// `TakeControl`, with a password or an empty one.
    TakeControl(String),
    /// `ReleaseControl`.
    ReleaseControl,
    /// `New`: opens a measurement.
    New,
    /// `Close`: closes the measurement.
    Close,
    /// `Start`: begins a capture.
    Start,
    /// `Start RTFromFile`: plays the measurement that is loaded.
    StartFromFile,
    /// `Stop`: ends the capture or the playing.
    Stop,
    /// `Load`: opens a recorded measurement.
    Load(String),
    /// `Save`: saves the capture.
    Save(String),
    /// `Trig`: an external trigger.
    Trigger,
    /// `SetQTMEvent` or `Event`: a mark in the capture.
    SetEvent(String),
}

/// Error: the text is not a command.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not a command of the RT protocol")]
pub struct InvalidQtmCommand(String);

impl QtmCommand {
    /// Whether only the client in control may give the command.
    pub fn is_privileged(&self) -> bool {
        matches!(
            self,
            Self::New
                | Self::Close
                | Self::Start
                | Self::StartFromFile
                | Self::Stop
                | Self::Load(_)
                | Self::Save(_)
                | Self::Trigger
                | Self::SetEvent(_)
        )
    }

    fn parse(text: &str) -> Option<Self> {
        let mut words = text.split_whitespace();
        let name = words.next()?.to_ascii_lowercase();
        // An argument may have blanks, and quotation marks around it.
        let argument = || {
            let rest = text.trim_start()[name.len()..].trim();
            rest.trim_matches('"').to_owned()
        };
        Some(match name.as_str() {
            "version" => match words.next() {
                Some(version) => Self::SetVersion(version.parse().ok()?),
                None => Self::Version,
            },
            "qtmversion" => Self::ServerVersion,
            "byteorder" => Self::ByteOrder,
            "getstate" | "getlastevent" => Self::State,
            "getparameters" => Self::Parameters(
                words.try_fold(ParameterSelection::default(), ParameterSelection::with)?,
            ),
            "getcurrentframe" => Self::CurrentFrame(parse_components(words)?),
            "streamframes" if argument().eq_ignore_ascii_case("stop") => Self::StreamStop,
            "streamframes" => Self::Stream(StreamRequest::parse(words)?),
            "takecontrol" => Self::TakeControl(argument()),
            "releasecontrol" => Self::ReleaseControl,
            "new" => Self::New,
            "close" => Self::Close,
            "start" if argument().eq_ignore_ascii_case("rtfromfile") => Self::StartFromFile,
            "start" => Self::Start,
            "stop" => Self::Stop,
            "load" => Self::Load(argument()),
            "save" => Self::Save(argument()),
            "trig" => Self::Trigger,
            "setqtmevent" | "event" => Self::SetEvent(argument()),
            _ => return None,
        })
    }
}

impl FromStr for QtmCommand {
    type Err = InvalidQtmCommand;

    fn from_str(text: &str) -> Result<Self, InvalidQtmCommand> {
        Self::parse(text).ok_or_else(|| InvalidQtmCommand(text.chars().take(80).collect()))
    }
}

impl fmt::Display for QtmCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SetVersion(version) => write!(f, "Version {version}"),
            Self::Version => f.write_str("Version"),
            Self::ServerVersion => f.write_str("QTMVersion"),
            Self::ByteOrder => f.write_str("ByteOrder"),
            Self::State => f.write_str("GetState"),
            Self::Parameters(selection) => write!(f, "GetParameters {selection}"),
            Self::CurrentFrame(components) => write!(f, "GetCurrentFrame {components}"),
            Self::Stream(request) => write!(f, "StreamFrames {request}"),
            Self::StreamStop => f.write_str("StreamFrames Stop"),
            Self::TakeControl(password) => write!(f, "TakeControl {password}"),
            Self::ReleaseControl => f.write_str("ReleaseControl"),
            Self::New => f.write_str("New"),
            Self::Close => f.write_str("Close"),
            Self::Start => f.write_str("Start"),
            Self::StartFromFile => f.write_str("Start RTFromFile"),
            Self::Stop => f.write_str("Stop"),
            Self::Load(file) => write!(f, "Load \"{file}\""),
            Self::Save(file) => write!(f, "Save \"{file}\""),
            Self::Trigger => f.write_str("Trig"),
            Self::SetEvent(label) => write!(f, "SetQTMEvent \"{label}\""),
        }
    }
}
