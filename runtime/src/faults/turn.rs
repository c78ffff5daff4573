//! Turn of a process whose ports have faults.

use std::rc::Rc;
use std::time::Duration;

use oqtal_bus::error::BusError;
use oqtal_bus::message::HealthV1;
use oqtal_bus::time::Time;
use oqtal_bus::transport::Transport;
use oqtal_config::{Fault, FaultKind};

use super::clock::FaultClock;
use crate::health::MotorActivity;
use crate::turn::{Turn, TurnClock};

/// Turn that is also woken when a delayed sample is due, and that first sleeps while the process is slow.
#[derive(Debug)]
pub struct FaultyTurn<T: Transport, R> {
    /// The turn itself.
    pub turn: R,
    /// Clock of the faults; `None` without faults.
    clock: Option<Rc<FaultClock<T>>>,
    /// Faults of this process in real time.
    faults: Vec<Fault>,
}

impl<T: Transport, R> FaultyTurn<T, R> {
    pub(super) fn new(turn: R, clock: Option<Rc<FaultClock<T>>>, faults: Vec<Fault>) -> Self {
        Self { turn, clock, faults }
    }
}

impl<T: Transport, R: Turn> Turn for FaultyTurn<T, R> {
    fn next_event(&self, now: Time) -> Option<Time> {
        let due = self.clock.as_ref().and_then(|clock| clock.next_due());
        [self.turn.next_event(now), due].into_iter().flatten().min()
    }

    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        if let Some(faults) = &self.clock {
            faults.begin(clock.now())?;
            let slow = self.faults.iter().filter(|fault| fault.kind == FaultKind::Slow);
            for fault in slow.filter(|fault| faults.acts(fault)) {
                std::thread::sleep(Duration::from_secs_f64(fault.value() * 1e-3));
            }
        }
        self.turn.turn(clock)
    }

    fn shut_down<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        self.turn.shut_down(clock)
    }

    fn motors(&self) -> MotorActivity {
        self.turn.motors()
    }

    fn health(&self, now: Time) -> HealthV1 {
        self.turn.health(now)
    }
}
