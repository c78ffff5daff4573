//! A flight that pauses after every [`POLL_PERIOD`](super::POLL_PERIOD), so that its caller can change gains in flight.

use oqtal_bus::code::OperatorCommand;
use oqtal_bus::memory::MemoryWriter;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1, ReferenceV1, Stamps};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::transport::Publish;
use oqtal_control::position::OuterLoop;
use oqtal_control::scalar_pid::PidGains;
use oqtal_daemon::{LawPort, Refusal};
use oqtal_observe::flight::{Flight, FlightSample};
use oqtal_observe::recording::McapRecorder;
use oqtal_runtime::process::Failure;

use super::Simulation;
use crate::mission::Mission;

/// Flight that its caller advances in steps.
pub struct OnlineFlight<'a> {
    simulation: Simulation<'a>,
    began: Time,
    is_over: bool,
    references: MemoryWriter<ReferenceV1>,
}

impl<'a> OnlineFlight<'a> {
    /// Begins the flight of `mission`.
    ///
    /// # Errors
    /// An option of the law is invalid.
    pub fn begin(mission: &'a Mission) -> Result<Self, Failure> {
        Self::begin_with(mission, None, LawPort::default())
    }

    /// Begins the flight of `mission` with `law` as the external law; every sample is passed to `recording`.
    ///
    /// # Errors
    /// An option of the law, or of the fallback law, is invalid.
    pub fn begin_with(
        mission: &'a Mission,
        recording: Option<McapRecorder>,
        law: LawPort<'a>,
    ) -> Result<Self, Failure> {
        let mut simulation = Simulation::new(mission, recording, law)?;
        simulation.begin()?;
        let references = simulation.processes.references()?;
        Ok(Self { simulation, began: Time::now(), is_over: false, references })
    }

    /// Pauses after every `period` from now on; every pose is a multiple of a sixtieth of a second.
    pub fn pause_every(&mut self, period: Span) {
        self.simulation.poll_period = period;
    }

    /// Present instant of the flight.
    pub fn now(&self) -> Time {
        self.simulation.now
    }

    /// Ends the flight `duration` from now at the latest, in place of its time-out.
    pub fn end_after(&mut self, duration: Span) {
        self.simulation.end = self.simulation.now + duration;
    }

    /// Makes a request that changes the flight or its settings; returns the reply, or why the request is invalid.
    ///
    /// # Errors
    /// A topic in memory failed.
    pub fn change(
        &mut self,
        command: OperatorCommand,
        request: &ControlRequestV1,
    ) -> Result<Result<ControlResponseV1, Refusal>, Failure> {
        let now = self.simulation.now;
        Ok(self.simulation.processes.change(now, command, request)?)
    }

    /// Passes an operator's command to the daemon; `false` if it is refused.
    ///
    /// # Errors
    /// A topic in memory failed.
    pub fn request(&mut self, command: OperatorCommand) -> Result<bool, Failure> {
        Ok(self.simulation.processes.request(self.simulation.now, command)?)
    }

    /// Publishes a planner's reference.
    ///
    /// # Errors
    /// A topic in memory failed.
    pub fn publish(&mut self, reference: ReferenceV1) -> Result<(), Failure> {
        self.references.send(0, Stamps::default(), reference)?;
        Ok(())
    }

    /// Flies for the next [`POLL_PERIOD`](super::POLL_PERIOD); `false` once the flight is over.
    ///
    /// # Errors
    /// A process of the flight failed.
    pub fn advance(&mut self) -> Result<bool, Failure> {
        self.is_over = self.is_over || !self.simulation.advance(Span::ZERO, &mut |_| None)?;
        Ok(!self.is_over)
    }

    /// Replaces the gains of an outer loop.
    ///
    /// # Errors
    /// A gain is out of range.
    pub fn set_loop(&mut self, which: OuterLoop, gains: PidGains) -> Result<(), Failure> {
        self.simulation.processes.set_loop(which, gains)
    }

    /// Ticks flown so far, in the order of time.
    pub fn samples(&self) -> &[FlightSample] {
        self.simulation.recorder.samples()
    }

    /// Flies to the end and returns the flight.
    ///
    /// # Errors
    /// A process of the flight failed.
    pub fn finish(mut self) -> Result<Flight, Failure> {
        while self.advance()? {}
        Ok(self.simulation.close(self.began).0)
    }
}
