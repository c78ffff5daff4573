//! The client's end of a connection.

use super::cookie::{COOKIE_BYTES, CookieError, VrpnVersion};
use super::message::{VrpnMessage, VrpnMessageError, VrpnStream, write_description, write_message};
use super::tracker::TrackerPose;
use crate::bytes::{OUTPUT_BYTES, flush};

use super::{PING_TYPE, PONG_TYPE, POSE_TYPE};

/// Length of a message without content, and of a description without its name \[bytes\]; the padding is included.
const MESSAGE_BYTES: usize = 32;
const DESCRIPTION_BYTES: usize = 40;
/// Our numbers of the types, in the order of their description.
const PING: i32 = 1;
const PONG: i32 = 2;

/// Meaning of a message of the server.
#[derive(Clone, Debug, PartialEq)]
pub enum VrpnEvent<'a> {
    /// The server uses this version of VRPN; the connection is open.
    Greeted(VrpnVersion),
    /// Name of a sender: a tracker, or the server itself. A new name for a known number is a renamed tracker.
    Sender {
        /// Number \[-\].
        number: i32,
        /// Name.
        name: &'a str,
    },
    /// A pose.
    Pose {
        /// Number of the tracker \[-\].
        sender: i32,
        /// Time of the pose on the server's clock \[us\].
        time_us: u64,
        /// The pose.
        pose: TrackerPose,
    },
    /// The server is alive: it answers a ping.
    Pong,
    /// The server closes the connection.
    Disconnected,
    /// Anything else.
    Other,
}

/// Error that ends a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum VrpnClientError {
    /// Error in the server's cookie.
    #[error(transparent)]
    Cookie(#[from] CookieError),
    /// Bytes that are not messages.
    #[error(transparent)]
    Message(#[from] VrpnMessageError),
}

/// The client's end of a connection: bytes of the server in, events and bytes to the server out.
///
/// Give received bytes to [`VrpnClient::receive`], call [`VrpnClient::poll`] until it returns `None`, and send the bytes of
/// [`VrpnClient::take_output`] or [`VrpnClient::flush`]: this does not allocate after the start. The procedure is the same for both kinds
/// of connection.
#[derive(Clone, Debug)]
pub struct VrpnClient {
    stream: VrpnStream,
    state: ClientState,
}

/// The types used by a client, in the order of [`TypeNumbers`].
const KNOWN_TYPES: [&str; 3] = [POSE_TYPE, PING_TYPE, PONG_TYPE];

/// The server's numbers of [`KNOWN_TYPES`]; `None` for those that it has not described.
#[derive(Clone, Debug, Default)]
struct TypeNumbers([Option<i32>; KNOWN_TYPES.len()]);

impl TypeNumbers {
    /// Enters the number of a type. A number means one type alone.
    fn describe(&mut self, number: i32, name: &str) {
        for (known, entry) in KNOWN_TYPES.into_iter().zip(&mut self.0) {
            if known == name {
                *entry = Some(number);
            } else if *entry == Some(number) {
                *entry = None;
            }
        }
    }

    fn name_of(&self, number: i32) -> Option<&'static str> {
        let place = self.0.iter().position(|entry| *entry == Some(number))?;
        Some(KNOWN_TYPES[place])
    }
}

#[derive(Clone, Debug, Default)]
struct ClientState {
    greeted: bool,
    types: TypeNumbers,
    output: Vec<u8>,
    sequence: u32,
}

impl Default for VrpnClient {
    fn default() -> Self {
        Self::new()
    }
}

impl VrpnClient {
    /// Client at the beginning of a connection.
    pub fn new() -> Self {
        let mut output = Vec::with_capacity(OUTPUT_BYTES);
        output.extend_from_slice(&VrpnVersion::OURS.to_cookie());
        let state = ClientState { output, ..ClientState::default() };
        Self { stream: VrpnStream::new(), state }
    }

    /// Takes received bytes.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.stream.push(bytes);
    }

    /// The next event; `None` if more bytes are needed.
    ///
    /// # Errors
    /// The connection is of no use any more.
    pub fn poll(&mut self) -> Result<Option<VrpnEvent<'_>>, VrpnClientError> {
        let Self { stream, state } = self;
        if !state.greeted {
            let Some(cookie) = stream.take_bytes::<COOKIE_BYTES>() else { return Ok(None) };
            let version = VrpnVersion::from_cookie(&cookie)?;
            state.greet();
            return Ok(Some(VrpnEvent::Greeted(version)));
        }
        Ok(stream.take()?.map(|message| state.on_message(&message)))
    }

    /// Bytes to be sent to the server; empties the output.
    pub fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.state.output)
    }

    /// Passes the bytes to be sent to the server to `send`, if there are any, and empties the output without freeing its memory.
    ///
    /// # Errors
    /// That of `send`.
    pub fn flush<E>(&mut self, send: impl FnOnce(&[u8]) -> Result<(), E>) -> Result<(), E> {
        flush(&mut self.state.output, send)
    }

    /// Asks the tracker `name` whether the server is alive; about once a second is usual.
    pub fn ping(&mut self, name: &str) {
        if self.state.greeted && self.state.has_room(name.len() + DESCRIPTION_BYTES) {
            self.state.describe((0, VrpnMessage::SENDER_DESCRIPTION), name);
            self.state.send(&VrpnMessage::new(0, PING));
        }
    }
}

impl ClientState {
    /// Describes our types to the server.
    fn greet(&mut self) {
        self.greeted = true;
        for (number, name) in (0..).zip(KNOWN_TYPES) {
            self.describe((number, VrpnMessage::TYPE_DESCRIPTION), name);
        }
    }

    fn on_message<'a>(&mut self, message: &VrpnMessage<'a>) -> VrpnEvent<'a> {
        match (message.kind, message.described_name()) {
            (VrpnMessage::SENDER_DESCRIPTION, Some(name)) => {
                return VrpnEvent::Sender { number: message.sender, name };
            }
            (VrpnMessage::TYPE_DESCRIPTION, Some(name)) => {
                self.types.describe(message.sender, name);
            }
            (VrpnMessage::DISCONNECT, _) => return VrpnEvent::Disconnected,
            (kind, _) => return self.on_typed(kind, message),
        }
        VrpnEvent::Other
    }

    fn on_typed(&mut self, kind: i32, message: &VrpnMessage<'_>) -> VrpnEvent<'static> {
        match self.types.name_of(kind) {
            Some(POSE_TYPE) => match TrackerPose::parse(message.payload) {
                Some(pose) => {
                    VrpnEvent::Pose { sender: message.sender, time_us: message.time_us(), pose }
                }
                None => VrpnEvent::Other,
            },
            Some(PONG_TYPE) => VrpnEvent::Pong,
            // Either end may ask the other.
            Some(PING_TYPE) if self.has_room(MESSAGE_BYTES) => {
                self.send(&VrpnMessage::new(0, PONG));
                VrpnEvent::Other
            }
            _ => VrpnEvent::Other,
        }
    }

    /// Whether this number of bytes and a message fit into the output. A server that sends requests faster than answers can be
    /// sent gets no more answers.
    fn has_room(&self, bytes: usize) -> bool {
        self.output.len() + bytes + MESSAGE_BYTES <= OUTPUT_BYTES
    }

    fn describe(&mut self, (number, kind): (i32, i32), name: &str) {
        write_description(&mut self.output, (number, kind), name, self.sequence);
        self.sequence = self.sequence.wrapping_add(1);
    }

    fn send(&mut self, message: &VrpnMessage<'_>) {
        write_message(&mut self.output, message, self.sequence);
        self.sequence = self.sequence.wrapping_add(1);
    }
}
