//! When a flight begins and ends because somebody asked for it, or because the daemon was told to take off by itself.

use oqtal_bus::code::{Answer, Cause, Mode, OperatorCommand};
use oqtal_bus::message::ControlResponseV1;
use oqtal_bus::time::Time;

use super::Cycle;

/// What became of a flight that the daemon was to begin by itself, `[safety] arm-at-start`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AtStart {
    /// None is meant, or it was called off.
    #[default]
    Nothing,
    /// It begins as soon as it can, with what is simulated then.
    Awaited,
    /// A flight began.
    Taken,
    /// Not with a vehicle that really flies.
    Refused,
}

impl Cycle {
    /// What became of the flight that was to begin by itself.
    #[must_use]
    pub fn at_start(&self) -> AtStart {
        self.at_start
    }

    /// No flight begins by itself.
    pub fn stay_at_start(&mut self) {
        if self.at_start == AtStart::Awaited {
            self.at_start = AtStart::Nothing;
        }
    }

    /// Answers an operator.
    pub fn request(&mut self, now: Time, command: OperatorCommand) -> ControlResponseV1 {
        let verdict = match command {
            OperatorCommand::Status => Ok(Answer::Done),
            OperatorCommand::Arm if self.mode != Mode::Disarmed || self.watches_only => {
                Err(Cause::WrongMode)
            }
            OperatorCommand::Arm if self.guard.good_in_a_row() < self.recovery_poses => {
                Err(self.missing)
            }
            OperatorCommand::Arm if !self.vehicle.answers(now) => Err(Cause::NoVehicle),
            OperatorCommand::Fly if self.watches_only => Err(Cause::WrongMode),
            // Asked twice, as by an operator who did not hear the first answer.
            OperatorCommand::Fly if self.mode != Mode::Disarmed => Ok(Answer::Done),
            OperatorCommand::Arm | OperatorCommand::Fly => {
                self.mode = Mode::Waiting;
                self.arms_at_once = command == OperatorCommand::Arm;
                Ok(Answer::Accepted)
            }
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
                self.stop_requested = true;
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
        }
    }

    /// A flight that has not begun does not begin.
    fn call_off(&mut self) {
        self.stay_at_start();
        if self.mode == Mode::Waiting {
            self.mode = Mode::Disarmed;
        }
    }

    /// Whether to take off by itself in this very tick, should poses allow it: once, if that is asked for, and only with what
    /// says now that it is simulated. A vehicle that is not ends the setpoint.
    pub(super) fn takes_off_by_itself(&mut self) -> bool {
        if self.at_start == AtStart::Awaited && self.vehicle.is_simulated() == Some(false) {
            self.at_start = AtStart::Refused;
        }
        self.at_start == AtStart::Awaited && self.vehicle.is_simulated() == Some(true)
    }

    /// A flight that an operator asked for is meant for the vehicle that was there: with another it must be asked for again.
    pub(super) fn notice_speaker(&mut self, speaker: u64) {
        let is_another = self.vehicle.speaker().is_some_and(|known| known != speaker);
        if is_another && self.mode == Mode::Waiting {
            self.call_off();
            self.vehicle_replaced = true;
        }
    }

    fn land(&mut self, now: Time) -> Result<Answer, Cause> {
        self.call_off();
        if self.is_held() {
            self.end_flight();
            return Ok(Answer::Done);
        }
        match (self.mode, &mut self.mission) {
            (Mode::Flying, _) if self.watches_only => Err(Cause::WrongMode),
            (Mode::Flying, Some(mission)) => {
                mission.land(now, &self.estimator.latest());
                self.mode = Mode::Landing;
                Ok(Answer::Done)
            }
            (Mode::Landing, _) => Ok(Answer::Done),
            _ => Err(Cause::WrongMode),
        }
    }
}
