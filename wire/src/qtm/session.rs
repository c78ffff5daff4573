//! The server's end of a connection.

use super::command::QtmCommand;
use super::component::ComponentSet;
use super::event::QtmEvent;
use super::host::QtmHost;
use super::packet::{MAX_FROM_CLIENT, QtmPacket, QtmPacketError, QtmStream};
use super::stream_request::StreamRequest;
use super::version::QtmVersion;
use super::writer::QtmWriter;
use crate::bytes::ByteOrder;
use crate::motion::MotionFrame;

/// Version that the server reports. Clients compare its major number.
const SERVER_VERSION: &str = "2.17 (build 4000)";

/// Length of the answers above which further commands wait \[bytes\]: answers that a client does not read delay only that client.
const MAX_ANSWERS: usize = 1 << 17;

/// The server's end of a connection: bytes of the client in, bytes to the client out.
#[derive(Clone, Debug)]
pub struct QtmSession {
    client: u64,
    /// Address in messages to other clients: `ip (port)`.
    name: String,
    order: ByteOrder,
    stream: QtmStream,
    version: QtmVersion,
    subscription: Option<StreamRequest>,
}

impl QtmSession {
    /// Refuses a connection beyond the greatest number.
    pub fn refuse(order: ByteOrder, out: &mut Vec<u8>) {
        QtmWriter::new(out, order).error("Connection refused. Max number of clients reached.");
    }

    /// Opens the session of a new connection and greets its client. `client` is unique among the connections of the host.
    pub fn open(client: u64, name: String, order: ByteOrder, out: &mut Vec<u8>) -> Self {
        // Clients compare the text: it has no full stop, unlike the document's.
        QtmWriter::new(out, order).command("QTM RT Interface connected");
        let stream = QtmStream::new(order, MAX_FROM_CLIENT);
        Self { client, name, order, stream, version: QtmVersion::INITIAL, subscription: None }
    }

    /// Number of the client \[-\].
    pub fn client(&self) -> u64 {
        self.client
    }

    /// The stream requested by the client.
    pub fn subscription(&self) -> Option<&StreamRequest> {
        self.subscription.as_ref()
    }

    /// Whether the session takes more bytes of the client. It does not while commands wait for their answers to be sent.
    pub fn is_ready(&self) -> bool {
        self.stream.pending() < MAX_FROM_CLIENT
    }

    /// Takes bytes of the client and appends the answers to `out`; `frame` is the newest frame. Answers at most
    /// as many commands as `out` has room for, the others in later calls, also without new bytes.
    ///
    /// # Errors
    /// The bytes are not packets: close the connection.
    pub fn receive(
        &mut self,
        bytes: &[u8],
        host: &mut QtmHost,
        frame: Option<&MotionFrame<'_>>,
        out: &mut Vec<u8>,
    ) -> Result<(), QtmPacketError> {
        self.stream.push(bytes);
        let mut stream = std::mem::replace(&mut self.stream, QtmStream::new(self.order, 0));
        let result = loop {
            if out.len() > MAX_ANSWERS {
                break Ok(());
            }
            match stream.take() {
                Ok(None) => break Ok(()),
                Ok(Some(packet)) => {
                    self.answer(&packet, host, frame, &mut QtmWriter::new(out, self.order))
                }
                Err(error) => break Err(error),
            }
        };
        self.stream = stream;
        result
    }

    /// Appends a frame of the subscription to `out`, in one packet.
    pub fn write_frame(
        &self,
        frame: &MotionFrame<'_>,
        components: &ComponentSet,
        out: &mut Vec<u8>,
    ) {
        QtmWriter::new(out, self.order).data(frame, components);
    }

    /// Appends an event to `out`.
    pub fn write_event(&self, event: QtmEvent, out: &mut Vec<u8>) {
        let mut writer = QtmWriter::new(out, self.order);
        writer.event(event);
        if event == QtmEvent::ConnectionClosed && self.subscription.is_some() {
            writer.no_more_data();
        }
    }

    fn answer(
        &mut self,
        packet: &QtmPacket<'_>,
        host: &mut QtmHost,
        frame: Option<&MotionFrame<'_>>,
        writer: &mut QtmWriter<'_>,
    ) {
        match packet {
            QtmPacket::Command(text) => match text.parse::<QtmCommand>() {
                Ok(command) if command.is_privileged() && !host.is_master(self.client) => {
                    writer.error("You must be master to issue this command");
                }
                Ok(command) => self.execute(command, host, frame, writer),
                Err(_) => writer.error("Parse error"),
            },
            // Settings: nothing to set.
            QtmPacket::Xml(_) if host.is_master(self.client) => {
                writer.error("Setting parameters failed");
            }
            QtmPacket::Xml(_) => writer.error("You must be master to issue this command"),
            _ => writer.error("Parse error"),
        }
    }

    fn execute(
        &mut self,
        command: QtmCommand,
        host: &mut QtmHost,
        frame: Option<&MotionFrame<'_>>,
        writer: &mut QtmWriter<'_>,
    ) {
        let frame = frame.filter(|_| host.has_data());
        match command {
            QtmCommand::SetVersion(version) if version.is_supported() => {
                self.version = version;
                writer.command(format!("Version set to {version}"));
            }
            QtmCommand::SetVersion(_) => writer.error("Version NOT supported"),
            QtmCommand::Version => writer.command(format!("Version is {}", self.version)),
            QtmCommand::ServerVersion => {
                writer.command(format!("QTM Version is {SERVER_VERSION}"));
            }
            QtmCommand::ByteOrder => writer.command(match self.order {
                ByteOrder::Little => "Byte order is little endian",
                ByteOrder::Big => "Byte order is big endian",
            }),
            QtmCommand::State => writer.event(host.state()),
            QtmCommand::Parameters(selection) if selection.is_empty() => {
                writer.error("Parameters not available");
            }
            QtmCommand::Parameters(selection) => {
                writer.xml(&host.parameters().to_xml(self.version, selection));
            }
            QtmCommand::CurrentFrame(components) => match frame {
                Some(frame) => writer.data(frame, &components),
                None => writer.no_more_data(),
            },
            QtmCommand::Stream(request) => {
                self.subscription = Some(request);
                if frame.is_none() {
                    writer.no_more_data();
                }
            }
            QtmCommand::StreamStop => self.subscription = None,
            control => self.control(control, host, writer),
        }
    }

    /// Executes a command that concerns the measurement or the control over it.
    fn control(&self, command: QtmCommand, host: &mut QtmHost, writer: &mut QtmWriter<'_>) {
        let (answer, event) = match command {
            QtmCommand::TakeControl(_) if host.is_master(self.client) => {
                ("You are already master", None)
            }
            QtmCommand::TakeControl(_) => match host.take_control(self.client, &self.name) {
                Ok(()) => ("You are now master", None),
                Err(other) => return writer.error(&format!("{other} is already master")),
            },
            QtmCommand::ReleaseControl if host.is_master(self.client) => {
                host.disconnected(self.client);
                ("You are now a regular client", None)
            }
            QtmCommand::ReleaseControl => ("You are already a regular client", None),
            QtmCommand::New if host.has_data() => ("Already connected", None),
            QtmCommand::New => ("Creating new connection", Some(QtmEvent::Connected)),
            QtmCommand::Close if host.has_data() => {
                ("Closing connection", Some(QtmEvent::ConnectionClosed))
            }
            QtmCommand::Close => ("No connection to close", None),
            QtmCommand::Load(_) => ("Measurement loaded", Some(QtmEvent::Connected)),
            QtmCommand::Save(_) => ("Measurement saved", Some(QtmEvent::CaptureSaved)),
            QtmCommand::Trigger => ("Trig ok", Some(QtmEvent::Trigger)),
            QtmCommand::SetEvent(_) => ("Event set", None),
            measurement => return self.measure(&measurement, host, writer),
        };
        writer.command(answer);
        if let Some(event) = event {
            host.announce(event);
        }
    }

    /// Starts and ends captures and playing.
    fn measure(&self, command: &QtmCommand, host: &mut QtmHost, writer: &mut QtmWriter<'_>) {
        use QtmEvent::{
            CaptureStarted, CaptureStopped, ConnectionClosed, RtFromFileStarted, RtFromFileStopped,
        };
        let (answer, event) = match (command, host.state()) {
            (QtmCommand::Start, CaptureStarted) => {
                return writer.error("Measurement is already running");
            }
            (QtmCommand::Start | QtmCommand::StartFromFile, ConnectionClosed) => {
                return writer.error("Not connected");
            }
            (QtmCommand::Start, _) => ("Starting measurement", CaptureStarted),
            (QtmCommand::StartFromFile, RtFromFileStarted) => {
                return writer.error("RT from file already running");
            }
            (QtmCommand::StartFromFile, _) => ("Starting RT from file", RtFromFileStarted),
            (QtmCommand::Stop, CaptureStarted) => ("Stopping measurement", CaptureStopped),
            (QtmCommand::Stop, RtFromFileStarted) => ("Stopping RT from file", RtFromFileStopped),
            (QtmCommand::Stop, _) => return writer.error("No measurement is running"),
            _ => return writer.error("Parse error"),
        };
        writer.command(answer);
        host.announce(event);
    }
}
