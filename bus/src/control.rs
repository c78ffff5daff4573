//! The control service: requests of operators, answers of the daemon.

use std::fmt;
use std::time::Duration;

use crate::error::BusError;
use crate::message::{ControlRequestV1, ControlResponseV1, Message};
use crate::origin::Origin;
use crate::time::{Span, Time};

/// Answers a request: reads the encoded request, fills the encoded answer.
pub(crate) type Answerer<'a> = &'a mut dyn FnMut(&[u8], &mut [u8]);

/// Server side of a request-response service for bytes.
pub(crate) trait RawServer: fmt::Debug {
    /// Answers every waiting request using `answer`.
    fn serve(&self, answer: Answerer<'_>) -> Result<(), BusError>;
}

/// Client side of a request-response service for bytes.
pub(crate) trait RawClient: fmt::Debug {
    /// Sends `request` and polls until its answer arrives, the server is gone, or `give_up` is reached; returns whether it arrived.
    /// Answers with another key are discarded.
    fn ask(&self, request: &[u8], response: &mut [u8], give_up: Time) -> Result<bool, BusError>;
}

/// Size of the key before each request, which its answer repeats \[bytes\].
pub(crate) const KEY_SIZE: usize = 16;
/// Sizes of requests and answers of the control service, with the key \[bytes\].
pub(crate) const CONTROL_SIZES: (usize, usize) =
    (KEY_SIZE + ControlRequestV1::SIZE, KEY_SIZE + ControlResponseV1::SIZE);
/// Hash of both message definitions of the control service, and of their key.
pub(crate) const CONTROL_SCHEMA: u64 =
    ControlRequestV1::SCHEMA ^ ControlResponseV1::SCHEMA.rotate_left(1) ^ KEY_SIZE as u64;

/// Key of a request, which no other request on this machine has: its process and the present instant. The transport gives the answer to
/// the request of a process that has ended to the next one that takes its place.
fn key() -> [u8; KEY_SIZE] {
    let mut key = [0; KEY_SIZE];
    let (process, instant) = key.split_at_mut(KEY_SIZE / 2);
    process.copy_from_slice(&Origin::own().bits().to_le_bytes());
    instant.copy_from_slice(&Time::now().nanos().to_le_bytes());
    key
}

/// The daemon's side of the control service.
#[derive(Debug)]
pub struct ControlServer(Box<dyn RawServer>);

impl ControlServer {
    pub(crate) fn new(raw: Box<dyn RawServer>) -> Self {
        Self(raw)
    }

    /// Answers every waiting request using `answer`.
    ///
    /// # Errors
    /// The connection failed; an operator who left before the answer does not cause an error.
    pub fn serve(
        &self,
        mut answer: impl FnMut(ControlRequestV1) -> ControlResponseV1,
    ) -> Result<(), BusError> {
        self.0.serve(&mut |request, response| {
            let (key, request) = request.split_at(KEY_SIZE);
            response[..KEY_SIZE].copy_from_slice(key);
            answer(ControlRequestV1::decode(request)).encode(&mut response[KEY_SIZE..]);
        })
    }
}

/// An operator's side of the control service.
#[derive(Debug)]
pub struct ControlClient(Box<dyn RawClient>);

impl ControlClient {
    pub(crate) fn new(raw: Box<dyn RawClient>) -> Self {
        Self(raw)
    }

    /// Sends `request` and waits for the answer; `None` if no daemon answers within `timeout`.
    ///
    /// # Errors
    /// The connection failed; [`BusError::Version`] if the daemon is of another version.
    pub fn ask(
        &self,
        request: ControlRequestV1,
        timeout: Span,
    ) -> Result<Option<ControlResponseV1>, BusError> {
        let (mut sent, mut received) = ([0; CONTROL_SIZES.0], [0; CONTROL_SIZES.1]);
        sent[..KEY_SIZE].copy_from_slice(&key());
        request.encode(&mut sent[KEY_SIZE..]);
        let give_up = Time::now() + timeout;
        loop {
            if self.0.ask(&sent, &mut received, give_up)? {
                return Ok(Some(ControlResponseV1::decode(&received[KEY_SIZE..])));
            }
            if Time::now() >= give_up {
                return Ok(None);
            }
            // No daemon received the request; a daemon may be starting.
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}
