//! The client's end: server info, model definitions, frames, in this order.

use super::frame::NatNetFrame;
use super::message::{MessageId, NatNetError, NatNetMessage, NatNetVersion, write_content};
use super::server_info::ServerInfo;
use crate::bytes::OUTPUT_BYTES;

/// Next message that the client waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NatNetStage {
    /// The server info.
    Connecting,
    /// The definitions of the bodies.
    Models,
    /// Frames.
    Streaming,
}

/// Meaning of a datagram of the server.
#[derive(Clone, Debug)]
pub enum NatNetEvent<'a> {
    /// The server has answered, or answers otherwise than before; the definitions are requested.
    Connected(ServerInfo),
    /// The definitions, for [`ModelDefinitions::parse`](super::ModelDefinitions::parse): names and numbers of the bodies.
    Models(&'a [u8], NatNetVersion),
    /// A frame. Frames before the server info are ignored: their layout is not known.
    Frame(NatNetFrame<'a>),
    /// Anything else.
    Other,
}

/// Error of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NatNetClientError {
    /// Datagram that cannot be read; the next one may be good.
    #[error(transparent)]
    Datagram(#[from] NatNetError),
    /// Server that is too old or too new.
    #[error("the server uses NatNet {0}, expected 3.0 to 4.4")]
    Version(NatNetVersion),
}

/// Client side of the protocol: datagrams in, events and datagrams out. Datagrams of the command socket and of the multicast group are both
/// given to [`NatNetClient::receive`]. It does not allocate after the server info.
///
/// [`NatNetClient::poll_output`] returns the datagram that is due: requests are repeated until they are answered, and a unicast client
/// keeps its connection alive. Call it about twice a second and after every event.
#[derive(Clone, Debug)]
pub struct NatNetClient {
    unicast: bool,
    info: Option<ServerInfo>,
    stage: NatNetStage,
    /// Next time at which a datagram is due \[ns\].
    due_ns: u64,
    /// Whether the last request for the definitions is not answered yet.
    awaits_models: bool,
    /// Whether requests for the definitions name their types.
    names_types: bool,
    output: Vec<u8>,
}

/// Type of the rigid bodies, in a request for definitions.
const RIGID_BODIES: u32 = 1 << 1;

/// Interval between requests that are repeated, and between keep-alive messages \[ns\].
const INTERVAL_NS: u64 = 500_000_000;

impl NatNetClient {
    /// Client at the beginning; `unicast` asks for frames at the address of the command socket.
    pub fn new(unicast: bool) -> Self {
        let output = Vec::with_capacity(OUTPUT_BYTES);
        Self {
            unicast,
            info: None,
            stage: NatNetStage::Connecting,
            due_ns: 0,
            awaits_models: false,
            names_types: false,
            output,
        }
    }

    /// Message that the client waits for next.
    pub fn stage(&self) -> NatNetStage {
        self.stage
    }

    /// The server info, once the server has answered.
    pub fn info(&self) -> Option<&ServerInfo> {
        self.info.as_ref()
    }

    /// Asks for the definitions again, as after [`NatNetFrame::models_changed`] or a body of an unknown number.
    pub fn request_models(&mut self) {
        if self.info.is_some() {
            self.stage = NatNetStage::Models;
            self.due_ns = 0;
        }
    }

    /// The datagram to be sent to the server's command port now, if one is due.
    pub fn poll_output(&mut self, now_ns: u64) -> Option<&[u8]> {
        if now_ns < self.due_ns {
            return None;
        }
        let Self { stage, unicast, awaits_models, names_types, output: out, .. } = self;
        out.clear();
        match stage {
            NatNetStage::Connecting => {
                write_content(out, MessageId::Connect, |writer| {
                    writer.text("Ping");
                });
            }
            NatNetStage::Models => {
                // Motive 3.1 was seen to answer only requests with a mask of types, other versions answer empty ones.
                *names_types ^= std::mem::replace(awaits_models, true);
                write_content(out, MessageId::RequestModels, |writer| {
                    if *names_types {
                        writer.u32(RIGID_BODIES);
                    }
                });
            }
            NatNetStage::Streaming if *unicast => {
                write_content(out, MessageId::KeepAlive, |_| ());
            }
            NatNetStage::Streaming => return None,
        }
        self.due_ns = now_ns + INTERVAL_NS;
        Some(&self.output)
    }

    /// Takes a datagram of the server.
    ///
    /// # Errors
    /// The datagram cannot be read, or the server uses another version.
    pub fn receive<'a>(
        &mut self,
        datagram: &'a [u8],
    ) -> Result<NatNetEvent<'a>, NatNetClientError> {
        let message = NatNetMessage::parse(datagram)?;
        match (message.id, &self.info) {
            // A repeated answer, because the request was repeated: no change.
            (MessageId::ServerInfo, Some(info)) if info.is_in(message.content) => {
                Ok(NatNetEvent::Other)
            }
            (MessageId::ServerInfo, _) => {
                let info = ServerInfo::parse(message.content)?;
                if !info.version.is_supported() {
                    return Err(NatNetClientError::Version(info.version));
                }
                self.info = Some(info.clone());
                self.request_models();
                Ok(NatNetEvent::Connected(info))
            }
            (MessageId::Models, Some(info)) => {
                self.stage = NatNetStage::Streaming;
                (self.due_ns, self.awaits_models) = (0, false);
                Ok(NatNetEvent::Models(message.content, info.version))
            }
            (MessageId::Frame, Some(info)) => {
                Ok(NatNetEvent::Frame(NatNetFrame::parse(message.content, info.version)?))
            }
            _ => Ok(NatNetEvent::Other),
        }
    }
}
