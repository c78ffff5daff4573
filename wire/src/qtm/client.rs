//! The client's end of a connection: greeting, version, parameters, stream, in this order.

use super::command::QtmCommand;
use super::component::{ComponentKind, ComponentSet};
use super::data::DataPacket;
use super::event::QtmEvent;
use super::packet::{MAX_FROM_SERVER, QtmPacket, QtmPacketError, QtmStream};
use super::selection::ParameterSelection;
use super::stream_request::{StreamRate, StreamRequest, StreamTarget};
use super::version::QtmVersion;
use super::writer::QtmWriter;
use crate::bytes::{ByteOrder, OUTPUT_BYTES, flush};
use crate::text::printable;

/// Longest command of a client \[bytes\].
const MAX_COMMAND_BYTES: usize = 256;

/// Options of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QtmClientOptions {
    /// Byte order, that of the port.
    pub order: ByteOrder,
    /// Version requested first.
    pub newest: QtmVersion,
    /// Oldest version requested if the server refuses newer ones.
    pub oldest: QtmVersion,
    /// The stream.
    pub stream: StreamRequest,
}

impl Default for QtmClientOptions {
    fn default() -> Self {
        Self {
            order: ByteOrder::Little,
            newest: QtmVersion::new(1, 25),
            oldest: QtmVersion::OLDEST,
            stream: StreamRequest {
                rate: StreamRate::AllFrames,
                target: StreamTarget::Tcp,
                components: ComponentSet::new().with(ComponentKind::BodiesResidual),
            },
        }
    }
}

/// Meaning of a packet of the server.
#[derive(Clone, Debug, PartialEq)]
pub enum QtmClientEvent<'a> {
    /// The handshake continues; there may be bytes to send.
    Handshake,
    /// Parameters as XML, for [`QtmParameters::from_xml`](super::QtmParameters::from_xml): names of the bodies, rate.
    Parameters(&'a str),
    /// A frame, if the stream uses TCP.
    Frame(DataPacket<'a>),
    /// The server is not measuring; the stream is requested again when it does.
    NoData,
    /// An event. Parameters and stream are requested again if they may have changed.
    Event(QtmEvent),
}

/// Error that ends a connection.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum QtmClientError {
    /// Bytes that are not packets.
    #[error(transparent)]
    Packet(#[from] QtmPacketError),
    /// Server of another kind, with its first text, made printable.
    #[error("the server is not QTM: it answers `{0}`")]
    NotQtm(String),
    /// Server that is too old or too new.
    #[error("the server supports no version of the RT protocol from {oldest} to {newest}")]
    Version {
        /// Oldest requested version.
        oldest: QtmVersion,
        /// Newest requested version.
        newest: QtmVersion,
    },
    /// Refusal, with the printable text of the server.
    #[error("the server refuses: {0}")]
    Refused(String),
}

/// Next message that the client waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Greeting,
    Version(QtmVersion),
    Established,
}

/// The client's end of a connection: bytes of the server in, events and bytes to the server out.
///
/// Give received bytes to [`QtmClient::receive`], call [`QtmClient::poll`] until it returns `None`, send what
/// [`QtmClient::take_output`] returns, or [`QtmClient::flush`] gives: between two events of the server it does not allocate. Datagrams are parsed by [`QtmPacket::parse`].
#[derive(Clone, Debug)]
pub struct QtmClient {
    stream: QtmStream,
    dialogue: Dialogue,
}

#[derive(Clone, Debug)]
struct Dialogue {
    options: QtmClientOptions,
    stage: Stage,
    /// Whether the stream is requested with the next parameters.
    starts_stream: bool,
    output: Vec<u8>,
}

impl QtmClient {
    /// Client at the beginning of a connection.
    pub fn new(options: QtmClientOptions) -> Self {
        let stream = QtmStream::new(options.order, MAX_FROM_SERVER);
        let output = Vec::with_capacity(OUTPUT_BYTES);
        let dialogue = Dialogue { options, stage: Stage::Greeting, starts_stream: false, output };
        Self { stream, dialogue }
    }

    /// Takes received bytes.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.stream.push(bytes);
    }

    /// The next event; `None` if more bytes are needed.
    ///
    /// # Errors
    /// The connection is of no use any more.
    pub fn poll(&mut self) -> Result<Option<QtmClientEvent<'_>>, QtmClientError> {
        match self.stream.take()? {
            Some(packet) => self.dialogue.on_packet(packet).map(Some),
            None => Ok(None),
        }
    }

    /// Bytes to be sent to the server; empties the output.
    pub fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.dialogue.output)
    }

    /// Passes the bytes to be sent to the server to `send`, if there are any, and empties the output without freeing its memory.
    ///
    /// # Errors
    /// That of `send`.
    pub fn flush<E>(&mut self, send: impl FnOnce(&[u8]) -> Result<(), E>) -> Result<(), E> {
        flush(&mut self.dialogue.output, send)
    }

    /// Version of the connection, once the server has agreed to it.
    pub fn version(&self) -> Option<QtmVersion> {
        self.dialogue.version()
    }

    /// Requests the parameters again, while the stream continues: bodies can be renamed without an event.
    pub fn request_parameters(&mut self) {
        if self.dialogue.stage == Stage::Established {
            self.dialogue.request_parameters();
        }
    }
}

impl Dialogue {
    fn version(&self) -> Option<QtmVersion> {
        (self.stage == Stage::Established).then_some(self.options.newest)
    }

    /// Appends a command. Commands that exceed the output buffer are dropped.
    fn send(&mut self, command: &QtmCommand) {
        if self.output.len() > OUTPUT_BYTES - MAX_COMMAND_BYTES {
            return;
        }
        QtmWriter::new(&mut self.output, self.options.order).command(command);
    }

    fn request_version(&mut self, version: QtmVersion) {
        self.stage = Stage::Version(version);
        self.send(&QtmCommand::SetVersion(version));
    }

    fn request_parameters(&mut self) {
        let selection = ParameterSelection { general: true, markers: false, bodies: true };
        self.send(&QtmCommand::Parameters(selection));
    }

    /// Requests the parameters, and after them the stream.
    fn restart_stream(&mut self) {
        self.starts_stream = true;
        self.request_parameters();
    }

    fn on_packet<'a>(
        &mut self,
        packet: QtmPacket<'a>,
    ) -> Result<QtmClientEvent<'a>, QtmClientError> {
        match (self.stage, packet) {
            (_, QtmPacket::Event(event)) => return Ok(self.on_event(event)),
            (Stage::Greeting, QtmPacket::Command(text)) if text.starts_with("QTM RT Interface") => {
                self.request_version(self.options.newest);
            }
            (Stage::Greeting, QtmPacket::Command(text)) => {
                return Err(QtmClientError::NotQtm(printable(text)));
            }
            (Stage::Version(version), QtmPacket::Command(text))
                if text.starts_with("Version set") =>
            {
                self.stage = Stage::Established;
                self.options.newest = version;
                self.restart_stream();
            }
            (Stage::Version(version), QtmPacket::Error(_)) => self.request_older(version)?,
            (Stage::Established, QtmPacket::Xml(text)) => {
                if std::mem::take(&mut self.starts_stream) {
                    self.send(&QtmCommand::Stream(self.options.stream));
                }
                return Ok(QtmClientEvent::Parameters(text));
            }
            (Stage::Established, QtmPacket::Error("Parameters not available")) => {
                return Ok(QtmClientEvent::NoData);
            }
            (_, QtmPacket::Error(text)) => return Err(QtmClientError::Refused(printable(text))),
            (_, QtmPacket::NoMoreData) => return Ok(QtmClientEvent::NoData),
            (_, QtmPacket::Data(data)) => return Ok(QtmClientEvent::Frame(data)),
            (_, QtmPacket::Command(_) | QtmPacket::Xml(_) | QtmPacket::Other(_)) => {}
        }
        Ok(QtmClientEvent::Handshake)
    }

    fn on_event(&mut self, event: QtmEvent) -> QtmClientEvent<'static> {
        let new_data = matches!(
            event,
            QtmEvent::Connected
                | QtmEvent::CaptureStarted
                | QtmEvent::CaptureStopped
                | QtmEvent::RtFromFileStarted
                | QtmEvent::Other(_)
        );
        if new_data && self.stage == Stage::Established {
            self.restart_stream();
        }
        QtmClientEvent::Event(event)
    }

    fn request_older(&mut self, refused: QtmVersion) -> Result<(), QtmClientError> {
        let QtmClientOptions { oldest, newest, .. } = self.options;
        match refused.minor.checked_sub(1).map(|minor| QtmVersion::new(refused.major, minor)) {
            Some(older) if older >= oldest => {
                self.request_version(older);
                Ok(())
            }
            _ => Err(QtmClientError::Version { oldest, newest }),
        }
    }
}
