//! State shared by all connections of a server: parameters, state of the measurement, holder of control.

use super::event::QtmEvent;
use super::parameters::QtmParameters;

/// A server without its connections.
#[derive(Clone, Debug)]
pub struct QtmHost {
    parameters: QtmParameters,
    state: QtmEvent,
    /// The client in control, and how it is named to others.
    master: Option<(u64, String)>,
    /// Events for every client.
    events: Vec<QtmEvent>,
}

impl QtmHost {
    /// A server with an open measurement.
    pub fn new(parameters: QtmParameters) -> Self {
        Self { parameters, state: QtmEvent::Connected, master: None, events: Vec::new() }
    }

    /// Parameters.
    pub fn parameters(&self) -> &QtmParameters {
        &self.parameters
    }

    /// State of the measurement.
    pub fn state(&self) -> QtmEvent {
        self.state
    }

    /// Whether there are frames: a measurement is open.
    pub fn has_data(&self) -> bool {
        self.state != QtmEvent::ConnectionClosed
    }

    /// Takes the events for every client since the last call.
    pub fn take_events(&mut self) -> Vec<QtmEvent> {
        std::mem::take(&mut self.events)
    }

    /// Tells every client an event, and enters the state that it leads to.
    pub fn announce(&mut self, event: QtmEvent) {
        if event.is_state() {
            self.state = event;
        }
        self.events.push(event);
    }

    /// The client in control has gone, if it was `client`.
    pub fn disconnected(&mut self, client: u64) {
        if self.is_master(client) {
            self.master = None;
        }
    }

    pub(super) fn is_master(&self, client: u64) -> bool {
        self.master.as_ref().is_some_and(|(master, _)| *master == client)
    }

    /// Gives control to a client unless another client has it; otherwise names that client.
    pub(super) fn take_control(&mut self, client: u64, name: &str) -> Result<(), String> {
        match &self.master {
            Some((master, other)) if *master != client => Err(other.clone()),
            _ => {
                self.master = Some((client, name.to_owned()));
                Ok(())
            }
        }
    }
}
