//! The control service: requests of operators, answers of the daemon.

use std::fmt;
use std::time::Duration;

use crate::error::BusError;
use crate::message::{ControlRequestV1, ControlResponseV1, Message};
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
    /// Sends `request` and polls until an answer arrives, the server is gone, or `give_up` is reached; returns whether an answer arrived.
    fn ask(&self, request: &[u8], response: &mut [u8], give_up: Time) -> Result<bool, BusError>;
}

/// Sizes and schema of the control service.
pub(crate) const CONTROL_SIZES: (usize, usize) = (ControlRequestV1::SIZE, ControlResponseV1::SIZE);
/// Hash of both message definitions of the control service.
pub(crate) const CONTROL_SCHEMA: u64 =
    ControlRequestV1::SCHEMA ^ ControlResponseV1::SCHEMA.rotate_left(1);

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
            answer(ControlRequestV1::decode(request)).encode(response);
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
        request.encode(&mut sent);
        let give_up = Time::now() + timeout;
        loop {
            if self.0.ask(&sent, &mut received, give_up)? {
                return Ok(Some(ControlResponseV1::decode(&received)));
            }
            if Time::now() >= give_up {
                return Ok(None);
            }
            // No daemon received the request; a daemon may be starting.
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}
