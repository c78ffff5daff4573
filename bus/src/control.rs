//! The control service: operators ask, the daemon answers.

use std::time::Duration;

use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::ipc;

use crate::error::{BusError, system};
use crate::message::{ControlRequestV1, ControlResponseV1};
use crate::time::{Span, Time};
use crate::topic::CONTROL;

/// The daemon's end of the control service.
#[derive(Debug)]
pub struct ControlServer {
    server: Server<ipc::Service, ControlRequestV1, (), ControlResponseV1, ()>,
}

impl ControlServer {
    pub(crate) fn new(
        server: Server<ipc::Service, ControlRequestV1, (), ControlResponseV1, ()>,
    ) -> Self {
        Self { server }
    }

    /// Answers every request that waits, by `answer`.
    ///
    /// # Errors
    /// The connection broke; an operator who went away before the answer is no error.
    pub fn serve(
        &self,
        mut answer: impl FnMut(ControlRequestV1) -> ControlResponseV1,
    ) -> Result<(), BusError> {
        let failed = |e: &dyn std::fmt::Debug| system(format!("serving `{CONTROL}`"), e);
        while let Some(request) = self.server.receive().map_err(|e| failed(&e))? {
            let response = answer(*request.payload());
            if let Ok(loan) = request.loan_uninit() {
                // An error here means that the operator hung up: nobody is left to tell.
                let _ = loan.write_payload(response).send();
            }
        }
        Ok(())
    }
}

/// An operator's end of the control service.
#[derive(Debug)]
pub struct ControlClient {
    client: Client<ipc::Service, ControlRequestV1, (), ControlResponseV1, ()>,
}

impl ControlClient {
    pub(crate) fn new(
        client: Client<ipc::Service, ControlRequestV1, (), ControlResponseV1, ()>,
    ) -> Self {
        Self { client }
    }

    /// Asks, and waits for the answer; `None` if nobody answers within `patience`.
    ///
    /// # Errors
    /// The connection broke.
    pub fn ask(
        &self,
        request: ControlRequestV1,
        patience: Span,
    ) -> Result<Option<ControlResponseV1>, BusError> {
        let failed = |e: &dyn std::fmt::Debug| system(format!("asking `{CONTROL}`"), e);
        let give_up = Time::now() + patience;
        loop {
            let pending = self.client.send_copy(request).map_err(|e| failed(&e))?;
            while pending.number_of_server_connections() > 0 && Time::now() < give_up {
                if let Some(response) = pending.receive().map_err(|e| failed(&e))? {
                    return Ok(Some(*response));
                }
                std::thread::sleep(Duration::from_millis(2));
            }
            if Time::now() >= give_up {
                return Ok(None);
            }
            // No daemon was there to hear the request: ask again when one may be.
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}
