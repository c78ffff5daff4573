//! Requests of operators and conditions of other processes that change the mode in the next tick.

use oqtal_bus::time::Time;

use super::first_flight::FirstFlight;

/// Requests that wait for the next tick. The supervision owns them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Requests {
    /// Latest start of an armed flight, after which the operator has received the answer that it did not begin; `None` if the request
    /// waits.
    pub(super) begins_by: Option<Time>,
    /// State of the flight at start-up.
    pub(super) first_flight: FirstFlight,
    /// Whether the flight must be stopped.
    pub(super) stop: bool,
    /// Whether the previous daemon ended in flight.
    pub(super) ended_in_flight: bool,
    /// Whether no flight has begun since a stop, or since the previous daemon was killed.
    pub(super) awaits_arm: bool,
    /// Whether another vehicle took the place of the one for which a flight was requested.
    pub(super) vehicle_replaced: bool,
    /// Whether processes of the instance run with different configurations.
    pub(super) configs_differ: bool,
    /// Whether files of the instance were lost.
    pub(super) files_lost: bool,
    /// Whether the fallback law flew in the last tick although the configured law was permitted to fly.
    pub(super) law_fails: bool,
}

impl Requests {
    /// Cancels the automatic flight at start-up: only an operator may begin the next flight.
    pub(super) fn cancel_automatic(&mut self) {
        self.awaits_arm = true;
        if self.first_flight == FirstFlight::Pending {
            self.first_flight = FirstFlight::None;
        }
    }

    /// Records that a flight will be requested, unless it begins by itself.
    pub(super) fn expect_flight(&mut self) {
        if self.first_flight == FirstFlight::None {
            self.first_flight = FirstFlight::Expected;
        }
    }

    /// Calls off the flight at start-up; returns whether one was about to begin.
    pub(super) fn call_off(&mut self) -> bool {
        let was_planned = matches!(self.first_flight, FirstFlight::Pending | FirstFlight::Expected);
        if was_planned {
            self.first_flight = FirstFlight::CalledOff;
        }
        was_planned
    }

    /// Whether an operator called off the flight at start-up.
    pub(super) fn is_called_off(&self) -> bool {
        self.first_flight == FirstFlight::CalledOff
    }

    /// Whether only an operator may begin the next flight.
    pub(super) fn awaits_arm(&self) -> bool {
        self.awaits_arm || self.stop || self.is_called_off()
    }

    /// Records that a flight begins.
    pub(super) fn begin_flight(&mut self) {
        self.awaits_arm = false;
        use FirstFlight::{CalledOff, Expected, Pending, Started};
        if let Pending | Expected | CalledOff = self.first_flight {
            self.first_flight = Started;
        }
    }

    /// Whether the automatic flight at start-up may begin in this tick: once, and only with a vehicle that reports that it is
    /// simulated. A vehicle that is not simulated cancels it.
    pub(super) fn begins_automatically(&mut self, is_simulated: Option<bool>) -> bool {
        if self.first_flight == FirstFlight::Pending && is_simulated == Some(false) {
            self.first_flight = FirstFlight::Refused;
        }
        self.first_flight == FirstFlight::Pending && is_simulated == Some(true)
    }
}
