//! Starting and stopping the motors of a Crazyflie.
//!
//! A vehicle that arms automatically is never disarmed: its motors do not run while no thrust is commanded, and the bridge itself tracks
//! whether they run because of its commands. A vehicle that counts as flying without thrust from the bridge is flown by another host. Any
//! other vehicle is armed and disarmed. The firmware takes disarming within two seconds after the last thrust for an accident and locks the
//! vehicle; therefore the zero set-point is sent until the vehicle no longer counts as flying.

use oqtal_bus::text::ShortText;
use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::{CrtpRequest, SUPERVISOR_PROTOCOL, Supervision, SupervisorCommand};

use crate::protocol::PeriodicTimer;

/// Time after which a command to the supervisor is repeated; zero set-points are sent in between.
const REPEAT: Span = Span::from_millis(200);

/// Time after the end of a flight of the bridge in which the vehicle may still count as flying because of it: 2 s, a constant of its
/// firmware, and the delay of a report.
const FLYING_AFTER_STOP: Span = Span::from_millis(2500);

/// Progress of starting and stopping.
#[derive(Clone, Copy, Debug)]
pub struct Arming {
    /// Whether the bridge started the motors last, and did not stop them.
    is_started: bool,
    was_started: bool,
    /// Instant at which the bridge last stopped motors that it had started.
    stopped_at: Time,
    repeat: PeriodicTimer,
    /// Whether disarming was requested last.
    is_disarming: bool,
}

impl Arming {
    /// No request has been sent to the vehicle yet.
    pub fn new() -> Self {
        Self {
            is_started: false,
            was_started: false,
            stopped_at: Time::UNSET,
            repeat: PeriodicTimer::new(REPEAT),
            is_disarming: false,
        }
    }

    /// Whether disarming was requested last: an answer to a request does not name which of the two it was.
    pub fn is_disarming(&self) -> bool {
        self.is_disarming
    }

    /// Whether the bridge has started the motors at least once.
    pub fn was_started(&self) -> bool {
        self.was_started
    }

    /// Whether the motors run at `now`, or would with thrust.
    pub fn motors_run(&self, now: Time, state: Supervision) -> bool {
        let is_armed = state.contains(Supervision::ARMED.with(Supervision::CAN_FLY));
        let has_flown = self.stopped_at.is_set() && now.since(self.stopped_at) < FLYING_AFTER_STOP;
        let flies_for_others = state.contains(Supervision::FLYING) && !has_flown;
        let by_itself = state.contains(Supervision::ARMS_ITSELF);
        is_armed && (self.is_started || !by_itself || flies_for_others)
    }

    /// Records a flight set-point: motors that were started for another host follow the bridge.
    pub fn fly(&mut self) {
        (self.is_started, self.was_started) = (true, true);
    }

    /// The command that is due while the motors are to be started; `None` for the zero set-point.
    pub fn start(&mut self, now: Time, state: Supervision) -> Option<SupervisorCommand> {
        (self.is_started, self.was_started) = (true, true);
        if state.contains(Supervision::CRASHED) && !state.contains(Supervision::TUMBLED) {
            return self.ask(now, SupervisorCommand::Recover);
        }
        let is_needed = !state.contains(Supervision::ARMED);
        if is_needed { self.ask(now, SupervisorCommand::Arm(true)) } else { None }
    }

    /// The command that is due while the motors are to be stopped; `None` for the zero set-point.
    pub fn stop(&mut self, now: Time, state: Supervision) -> Option<SupervisorCommand> {
        if std::mem::take(&mut self.is_started) {
            self.stopped_at = now;
        }
        let by_itself = state.contains(Supervision::ARMS_ITSELF);
        let is_allowed = !by_itself && !state.contains(Supervision::FLYING);
        if is_allowed { self.ask(now, SupervisorCommand::Arm(false)) } else { None }
    }

    fn ask(&mut self, now: Time, command: SupervisorCommand) -> Option<SupervisorCommand> {
        let is_due = self.repeat.is_due(now, false);
        if is_due {
            self.is_disarming = command == SupervisorCommand::Arm(false);
        }
        is_due.then_some(command)
    }
}

/// The packet of `command` for a vehicle with version `protocol`.
pub fn request(protocol: u8, command: SupervisorCommand) -> CrtpRequest {
    if protocol >= SUPERVISOR_PROTOCOL {
        CrtpRequest::Supervisor(command)
    } else {
        CrtpRequest::LegacySupervisor(command)
    }
}

/// Reason why a vehicle in this state cannot fly, for display.
pub fn obstacle(state: Supervision) -> Option<ShortText> {
    let text = match state {
        _ if state.contains(Supervision::LOCKED) => "locked: restart the vehicle",
        _ if state.contains(Supervision::TUMBLED) => "tumbled: set the vehicle upright",
        _ if state.contains(Supervision::CRASHED) => "crashed: inspect the vehicle, arm again",
        _ => return None,
    };
    Some(ShortText::new(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    #[test]
    fn a_vehicle_is_armed_once_and_disarmed_only_after_it_has_landed() {
        let (mut arming, ready) = (Arming::new(), Supervision::CAN_BE_ARMED);
        let armed = Supervision::ARMED.with(Supervision::CAN_FLY);
        assert_eq!(arming.start(at(0), ready), Some(SupervisorCommand::Arm(true)));
        assert_eq!(arming.start(at(17), ready), None, "a zero set-point unlocks the thrust");
        assert_eq!(arming.start(at(200), ready), Some(SupervisorCommand::Arm(true)));
        assert_eq!(arming.start(at(500), armed), None);
        assert!(arming.motors_run(at(500), armed) && !arming.motors_run(at(500), ready));
        assert_eq!(arming.stop(at(1000), armed.with(Supervision::FLYING)), None);
        assert!(!arming.is_disarming());
        assert_eq!(arming.stop(at(2000), armed), Some(SupervisorCommand::Arm(false)));
        assert!(arming.is_disarming());
    }

    #[test]
    fn the_bridge_tracks_the_motors_of_a_vehicle_that_arms_by_itself() {
        let mut arming = Arming::new();
        let state = Supervision::ARMED.with(Supervision::CAN_FLY).with(Supervision::ARMS_ITSELF);
        let flying = state.with(Supervision::FLYING);
        assert!(!arming.motors_run(at(0), state));
        assert!(arming.motors_run(at(0), flying), "it flies for another host");
        assert_eq!(arming.start(at(0), state), None);
        assert!(arming.motors_run(at(0), state));
        assert!(!arming.motors_run(at(0), Supervision::ARMS_ITSELF), "it tumbled");
        assert_eq!(arming.stop(at(1000), flying), None);
        assert!(!arming.motors_run(at(1000), flying), "the end of the bridge's own flight");
        assert!(arming.motors_run(at(5000), flying), "it flies for another host");
    }

    #[test]
    fn a_crashed_vehicle_is_recovered_once_it_lies_upright() {
        let mut arming = Arming::new();
        let tumbled = Supervision::CRASHED.with(Supervision::TUMBLED);
        assert_eq!(arming.start(at(0), tumbled), Some(SupervisorCommand::Arm(true)));
        let upright = Supervision::CRASHED;
        assert_eq!(arming.start(at(300), upright), Some(SupervisorCommand::Recover));
        assert_eq!(obstacle(tumbled).unwrap().as_str(), "tumbled: set the vehicle upright");
    }
}
