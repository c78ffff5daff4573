//! One turn of a process, and the clock during it.
//!
//! A process implements [`Turn`], generic over its ports. [`crate::process_loop::run`] executes it on the bus, in real time or in
//! lockstep; [`step`] executes the same code in an in-process flight.

use oqtal_bus::error::BusError;
use oqtal_bus::message::{HealthV1, Message};
use oqtal_bus::time::Time;
use oqtal_bus::transport::Publish;

use crate::health::MotorActivity;
use crate::virtual_clock::TurnResult;

/// The clock during a turn.
pub trait TurnClock {
    /// The present instant: in virtual time the instant of the turn, in real time read at every call.
    fn now(&self) -> Time;

    /// Whether the loop runs late (see [`crate::overrun::OverrunMonitor::runs_late`]); false in virtual time.
    fn runs_late(&self) -> bool {
        false
    }

    /// Wakes the reader of the message that was just published.
    ///
    /// # Errors
    /// The transport failed.
    fn announce<M: Message>(&mut self, writer: &impl Publish<M>) -> Result<(), BusError>;
}

/// Work of a process between two waits.
pub trait Turn {
    /// Instant at which the process acts without an arrival; `None` for never.
    fn next_event(&self, now: Time) -> Option<Time>;

    /// Processes arrivals and due events.
    ///
    /// # Errors
    /// The transport failed.
    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError>;

    /// Leaves every output safe. Called once after the last turn, also after an error or a panic.
    ///
    /// # Errors
    /// The transport failed.
    fn shut_down<C: TurnClock>(&mut self, _clock: &mut C) -> Result<(), BusError> {
        Ok(())
    }

    /// State of the motors that this process controls.
    fn motors(&self) -> MotorActivity {
        MotorActivity::Unreported
    }

    /// The state that the process reports on its health topic.
    fn health(&self, _now: Time) -> HealthV1 {
        HealthV1::default()
    }
}

/// No turn.
impl Turn for () {
    fn next_event(&self, _now: Time) -> Option<Time> {
        None
    }

    fn turn<C: TurnClock>(&mut self, _clock: &mut C) -> Result<(), BusError> {
        Ok(())
    }
}

/// Turns one after the other, as those of two processes; the second one states motors and health.
#[derive(Debug)]
pub struct Consecutive<A, B>(pub A, pub B);

impl<A: Turn, B: Turn> Turn for Consecutive<A, B> {
    fn next_event(&self, now: Time) -> Option<Time> {
        [self.0.next_event(now), self.1.next_event(now)].into_iter().flatten().min()
    }

    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        self.0.turn(clock)?;
        self.1.turn(clock)
    }

    fn shut_down<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        let first = self.0.shut_down(clock);
        self.1.shut_down(clock).and(first)
    }

    fn motors(&self) -> MotorActivity {
        self.1.motors()
    }

    fn health(&self, now: Time) -> HealthV1 {
        self.1.health(now)
    }
}

/// Executes one turn at the virtual instant `now`, scheduled by [`crate::virtual_clock::VirtualClock`].
///
/// # Errors
/// The transport failed.
pub fn step(turn: &mut impl Turn, now: Time) -> Result<TurnResult, BusError> {
    let mut clock = StepClock { now, published: false };
    turn.turn(&mut clock)?;
    Ok(TurnResult { next: turn.next_event(now), published: clock.published })
}

/// The clock of one turn in virtual time.
#[derive(Debug)]
struct StepClock {
    now: Time,
    published: bool,
}

impl TurnClock for StepClock {
    fn now(&self) -> Time {
        self.now
    }

    fn announce<M: Message>(&mut self, _writer: &impl Publish<M>) -> Result<(), BusError> {
        self.published = true;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use oqtal_bus::memory::{MemoryBus, MemoryWriter};
    use oqtal_bus::message::{CommandV1, Stamps};
    use oqtal_bus::topic::COMMAND;
    use oqtal_bus::transport::Transport;

    use super::*;

    /// Publishes a command in each turn.
    struct Commander(MemoryWriter<CommandV1>);

    impl Turn for Commander {
        fn next_event(&self, now: Time) -> Option<Time> {
            Some(now)
        }

        fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
            self.0.send(0, Stamps::default(), CommandV1::default())?;
            clock.announce(&self.0)
        }
    }

    #[test]
    fn a_step_reports_the_next_event_and_what_was_published() {
        let mut turn = Commander(MemoryBus::new().writer(&COMMAND).unwrap());
        let result = step(&mut turn, Time::VIRTUAL_START).unwrap();
        assert_eq!(result, TurnResult { next: Some(Time::VIRTUAL_START), published: true });
    }
}
