//! A flight that pauses after every [`POLL_PERIOD`](super::POLL_PERIOD), so that its caller can change gains in flight.

use oqtal_bus::time::{Span, Time};
use oqtal_control::position::OuterLoop;
use oqtal_control::scalar_pid::PidGains;
use oqtal_daemon::LawPort;
use oqtal_observe::flight::{Flight, FlightSample};
use oqtal_runtime::process::Failure;

use super::Simulation;
use crate::mission::Mission;

/// Flight that its caller advances in steps.
pub struct OnlineFlight<'a> {
    simulation: Simulation<'a>,
    began: Time,
    is_over: bool,
}

impl<'a> OnlineFlight<'a> {
    /// Begins the flight of `mission`.
    ///
    /// # Errors
    /// An option of the law is invalid.
    pub fn begin(mission: &'a Mission) -> Result<Self, Failure> {
        let mut simulation = Simulation::new(mission, None, LawPort::default())?;
        simulation.begin()?;
        Ok(Self { simulation, began: Time::now(), is_over: false })
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
