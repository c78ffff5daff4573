//! The watch over a flight: ends it when a process ends, and passes interrupts of the operator to the daemon.

use std::sync::Mutex;
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, OperatorCommand};
use oqtal_bus::control::ControlClient;
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::Span;
use oqtal_bus::transport::Transport;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::stop::{SetOnDrop, StopFlag};

use super::process_group::ProcessGroup;
use super::progress::Interrupts;

/// Period at which processes and interrupts are checked.
const WATCH_PERIOD: Duration = Duration::from_millis(20);

/// Watches the processes and the operator while the flight is recorded.
#[derive(Debug)]
pub struct ProcessWatch<'a> {
    paths: &'a InstancePaths,
    /// Stops the recording.
    stop: &'a StopFlag,
    /// Stops the watch.
    over: StopFlag,
    failure: Mutex<Option<Failure>>,
}

impl<'a> ProcessWatch<'a> {
    /// A watch over the instance at `paths` that sets `stop` when the flight cannot go on.
    #[must_use]
    pub fn new(paths: &'a InstancePaths, stop: &'a StopFlag) -> Self {
        Self { paths, stop, over: StopFlag::default(), failure: Mutex::new(None) }
    }

    /// Watches until a process ends, an interrupt cannot be passed on, or the flight is over.
    pub fn run(&self, processes: &mut ProcessGroup, interrupts: &Interrupts) {
        // Without a watch there is no flight, however the watch ended.
        let _stop = self.stop.set_on_drop();
        let client = Bus::open(self.paths).and_then(|bus| Ok((bus.control_client()?, bus)));
        let stop = client.as_ref().map(|(_, bus)| bus.stop_switch());
        while !self.over.is_set() {
            if let Some(failure) = processes.failure() {
                self.fail(failure);
                return;
            }
            let client = client.as_ref().ok().map(|(client, _)| client);
            let command = interrupts.next();
            if let (Some(OperatorCommand::Stop), Ok(Ok(stop))) = (command, &stop) {
                // Obeyed by the vehicle's process, whatever the daemon does.
                stop.raise();
            }
            if command.is_some_and(|command| !pass_on(client, command)) {
                self.fail(Failure::new(Exit::Flight, "interrupted"));
                return;
            }
            std::thread::sleep(WATCH_PERIOD);
        }
    }

    /// Ends the watch when the returned guard is dropped.
    #[must_use]
    pub fn end_on_drop(&self) -> SetOnDrop {
        self.over.set_on_drop()
    }

    /// The reason why the watch ended the flight; `None` if it did not.
    #[must_use]
    pub fn into_failure(self) -> Option<Failure> {
        self.failure.into_inner().unwrap_or_else(|poison| poison.into_inner())
    }

    fn fail(&self, failure: Failure) {
        if let Ok(mut slot) = self.failure.lock() {
            *slot = Some(failure);
        }
    }
}

/// Passes an operator's command to the daemon; `false` if no flight is under way that it could end.
fn pass_on(client: Option<&ControlClient>, command: OperatorCommand) -> bool {
    let request = ControlRequestV1::of(command);
    let response = client.and_then(|client| client.ask(request, Span::from_millis(500)).ok());
    response.flatten().is_some_and(|response| response.answer != Answer::Refused.code())
}
