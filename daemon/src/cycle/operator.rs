//! Requests of operators, and the automatic flight at start-up.

use oqtal_bus::code::{Answer, Cause, Mode, OperatorCommand};
use oqtal_bus::message::ControlResponseV1;
use oqtal_bus::obstacle::ArmingObstacle;
use oqtal_bus::time::Time;

use super::Cycle;
use super::at_start::AtStart;

impl Cycle {
    /// State of the automatic flight at start-up.
    #[must_use]
    pub fn at_start(&self) -> AtStart {
        self.requests.at_start
    }

    /// Cancels the automatic flight at start-up.
    pub fn stay_at_start(&mut self) {
        if self.requests.at_start == AtStart::Awaited {
            self.requests.at_start = AtStart::Nothing;
        }
    }

    /// Executes an operator's request and returns the reply.
    pub fn request(&mut self, now: Time, command: OperatorCommand) -> ControlResponseV1 {
        let verdict = match command {
            OperatorCommand::Status => Ok(Answer::Done),
            OperatorCommand::Arm => self.arm(now),
            OperatorCommand::Fly if self.observe_only => Err(Cause::WrongMode),
            // A repeated request: the first reply may have been lost.
            OperatorCommand::Fly if self.mode != Mode::Disarmed => Ok(Answer::Done),
            OperatorCommand::Fly => Ok(self.wait_for_flight(false)),
            OperatorCommand::Land => self.land(now),
            OperatorCommand::Disarm if matches!(self.mode, Mode::Waiting | Mode::Disarmed) => {
                self.call_off();
                Ok(Answer::Done)
            }
            OperatorCommand::Disarm if self.is_held() => {
                self.end_flight();
                Ok(Answer::Done)
            }
            OperatorCommand::Disarm => Err(Cause::WrongMode),
            OperatorCommand::Stop => {
                self.requests.stop = true;
                self.call_off();
                Ok(Answer::Accepted)
            }
        };
        let (answer, cause) = match verdict {
            Ok(answer) => (answer, self.supervisor.cause()),
            Err(cause) => (Answer::Refused, cause),
        };
        ControlResponseV1 {
            answer: answer.code(),
            mode: self.mode.code(),
            state: self.supervisor.state().code(),
            cause: cause.code(),
            obstacles: self.obstacles(now).bits(),
            ..ControlResponseV1::default()
        }
    }

    /// Records whether processes of the instance run with different configurations.
    pub fn notice_configurations(&mut self, differ: bool) {
        self.requests.configs_differ = differ;
    }

    /// Begins a flight at once, or refuses it.
    fn arm(&mut self, now: Time) -> Result<Answer, Cause> {
        if self.mode != Mode::Disarmed || self.observe_only {
            Err(Cause::WrongMode)
        } else {
            match self.obstacles(now).iter().next() {
                None => Ok(self.wait_for_flight(true)),
                Some(ArmingObstacle::NoPoses) => Err(self.memory.missing),
                Some(ArmingObstacle::VehicleSilent) => Err(Cause::NoVehicle),
                Some(ArmingObstacle::Stopped) => Err(Cause::Operator),
                Some(ArmingObstacle::ControlTaken) => Err(Cause::ControlTaken),
                Some(_) => Err(Cause::NotReady),
            }
        }
    }

    /// Requests a flight: for the next tick or not at all, or as soon as poses and vehicle allow it.
    fn wait_for_flight(&mut self, at_once: bool) -> Answer {
        self.mode = Mode::Waiting;
        self.requests.arms_at_once = at_once;
        Answer::Accepted
    }

    /// Cancels a flight that has not begun.
    fn call_off(&mut self) {
        self.stay_at_start();
        if self.mode == Mode::Waiting {
            self.mode = Mode::Disarmed;
        }
    }

    /// Whether the automatic flight at start-up may begin in this tick: once, and only with a vehicle that reports that it is
    /// simulated. A vehicle that is not simulated cancels it.
    pub(super) fn takes_off_by_itself(&mut self) -> bool {
        if self.requests.at_start == AtStart::Awaited && self.vehicle.is_simulated() == Some(false)
        {
            self.requests.at_start = AtStart::Refused;
        }
        self.requests.at_start == AtStart::Awaited && self.vehicle.is_simulated() == Some(true)
    }

    /// Cancels a requested flight if another process than before, `speaker`, publishes the topic `vehicle`: the flight is meant for
    /// the vehicle that was there, and must be requested again.
    pub(super) fn cancel_if_vehicle_replaced(&mut self, speaker: u64) {
        let is_another = self.vehicle.speaker().is_some_and(|known| known != speaker);
        if is_another && self.mode == Mode::Waiting {
            self.call_off();
            self.requests.vehicle_replaced = true;
        }
    }

    fn land(&mut self, now: Time) -> Result<Answer, Cause> {
        self.call_off();
        if self.is_held() {
            self.end_flight();
            return Ok(Answer::Done);
        }
        match self.mode {
            Mode::Flying if !self.observe_only => {
                self.land_early(now);
                Ok(Answer::Done)
            }
            Mode::Landing => Ok(Answer::Done),
            _ => Err(Cause::WrongMode),
        }
    }
}
