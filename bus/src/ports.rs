//! Ports of iceoryx2, as bytes. Each is closed under the lock of its instance.

use std::fmt;
use std::rc::Rc;
use std::time::Duration;

use iceoryx2::port::client::Client;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::server::Server;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc;

use crate::control::{Answerer, KEY_SIZE, RawClient, RawServer};
use crate::error::{BusError, of_iceoryx};
use crate::membership::Membership;
use crate::message::Header;
use crate::port::{RawReader, RawWriter};
use crate::time::Time;

pub(crate) type IceWriter = Publisher<ipc::Service, [u8], Header>;
pub(crate) type IceReader = Subscriber<ipc::Service, [u8], Header>;
pub(crate) type IceServer = Server<ipc::Service, [u8], (), [u8], ()>;
pub(crate) type IceClient = Client<ipc::Service, [u8], (), [u8], ()>;

/// A port of iceoryx2 in an instance.
#[derive(Debug)]
pub(crate) struct Port<P> {
    /// The iceoryx2 port; `None` only while this value is being dropped.
    port: Option<P>,
    name: &'static str,
    membership: Rc<Membership>,
}

impl<P> Port<P> {
    pub(crate) fn new(port: P, name: &'static str, membership: &Rc<Membership>) -> Self {
        Self { port: Some(port), name, membership: Rc::clone(membership) }
    }

    fn get(&self) -> &P {
        self.port.as_ref().expect("a port exists until it is dropped")
    }

    fn failed(&self, action: &str, reason: &dyn fmt::Debug) -> BusError {
        of_iceoryx(format!("{action} `{}`", self.name), reason)
    }
}

impl<P> Drop for Port<P> {
    fn drop(&mut self) {
        let _lock = self.membership.lock_to_close();
        self.port = None;
    }
}

impl RawWriter for Port<IceWriter> {
    fn send(
        &self,
        header: Header,
        size: usize,
        fill: &mut dyn FnMut(&mut [u8]),
    ) -> Result<(), BusError> {
        let mut sample =
            self.get().loan_slice(size).map_err(|e| self.failed("publishing on", &e))?;
        *sample.user_header_mut() = header;
        fill(sample.payload_mut());
        sample.send().map(drop).map_err(|e| self.failed("publishing on", &e))
    }

    fn warm_up(&self, size: usize) {
        drop(self.get().loan_slice(size));
    }
}

impl RawReader for Port<IceReader> {
    fn receive(&self, take: &mut dyn FnMut(&Header, &[u8])) -> Result<bool, BusError> {
        let sample = self.get().receive().map_err(|e| self.failed("reading", &e))?;
        let Some(sample) = sample else { return Ok(false) };
        take(sample.user_header(), sample.payload());
        Ok(true)
    }
}

impl RawServer for Port<IceServer> {
    fn serve(&self, answer: Answerer<'_>) -> Result<(), BusError> {
        while let Some(request) = self.get().receive().map_err(|e| self.failed("serving", &e))? {
            let size = self.get().initial_max_slice_len();
            if let Ok(mut loan) = request.loan_slice(size) {
                answer(request.payload(), loan.payload_mut());
                // An error means that the operator has left.
                let _ = loan.send();
            }
        }
        Ok(())
    }
}

impl RawClient for Port<IceClient> {
    fn ask(&self, request: &[u8], response: &mut [u8], give_up: Time) -> Result<bool, BusError> {
        let failed = |e: &dyn fmt::Debug| self.failed("asking", e);
        let mut loan = self.get().loan_slice(request.len()).map_err(|e| failed(&e))?;
        loan.payload_mut().copy_from_slice(request);
        let pending = loan.send().map_err(|e| failed(&e))?;
        while pending.number_of_server_connections() > 0 && Time::now() < give_up {
            let Some(answer) = pending.receive().map_err(|e| failed(&e))? else {
                std::thread::sleep(Duration::from_millis(2));
                continue;
            };
            if answer.payload().len() != response.len() {
                return Err(BusError::Version { topic: self.name.to_owned() });
            }
            if answer.payload()[..KEY_SIZE] == request[..KEY_SIZE] {
                response.copy_from_slice(answer.payload());
                return Ok(true);
            }
        }
        Ok(false)
    }
}
