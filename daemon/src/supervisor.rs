//! The safety state machine: three states, and their transitions as one table.
//!
//! ```text
//!         poses missing, or on the           blind too long, or vehicle
//!         ground the vehicle silent          lost, flying
//!  Nominal ──────────────▶ Coast ────────────────────────────────▶ Stop
//!     ▲                      │                                       │
//!     └ poses, vehicle good ─┴──────────── operator arms ────────────┘
//! ```
//! Each tick collects the conditions and takes the first transition that holds.

use oqtal_bus::code::{Cause, SafetyState};

/// The conditions of one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SafetyConditions {
    /// No accepted pose for longer than the longest pause of a regular source.
    pub poses_missing: bool,
    /// Enough good poses arrived in a row.
    pub poses_good: bool,
    /// In flight: the last accepted pose is too old.
    pub blind_too_long: bool,
    /// On the ground: the vehicle does not answer, so that a flight must not begin.
    pub vehicle_silent: bool,
    /// The vehicle answers again, and its silence is still the cause of the state.
    pub vehicle_back: bool,
    /// In flight: the vehicle has not answered for too long, its motors stand, or its bridge was restarted. Before a flight:
    /// another vehicle took the place of the one for which the flight was requested.
    pub vehicle_lost: bool,
    /// An operator requested a stop.
    pub operator_stops: bool,
    /// An operator requested a flight.
    pub operator_arms: bool,
}

/// A transition: from `from` to `to` when `when` holds.
struct SafetyTransition {
    from: SafetyState,
    to: SafetyState,
    when: fn(&SafetyConditions) -> bool,
}

/// All transitions, the most urgent first: the first that holds is taken.
const TRANSITIONS: [SafetyTransition; 9] = {
    use SafetyState::{Coast, Nominal, Stop};
    [
        SafetyTransition { from: Nominal, to: Stop, when: |c| c.operator_stops },
        SafetyTransition { from: Coast, to: Stop, when: |c| c.operator_stops },
        SafetyTransition { from: Nominal, to: Stop, when: |c| c.blind_too_long || c.vehicle_lost },
        SafetyTransition { from: Coast, to: Stop, when: |c| c.blind_too_long || c.vehicle_lost },
        SafetyTransition {
            from: Nominal,
            to: Coast,
            when: |c| c.poses_missing || c.vehicle_silent,
        },
        SafetyTransition { from: Coast, to: Nominal, when: |c| c.poses_good && !c.vehicle_silent },
        // Poses or vehicle are back while the other is still missing: the cause changes, the state does not.
        SafetyTransition { from: Coast, to: Coast, when: |c| c.poses_good && c.vehicle_silent },
        SafetyTransition { from: Coast, to: Coast, when: |c| c.vehicle_back },
        // Stop is latched: an operator ends it, once poses are good and the vehicle answers.
        SafetyTransition {
            from: Stop,
            to: Nominal,
            when: |c| c.operator_arms && c.poses_good && !c.vehicle_silent && !c.operator_stops,
        },
    ]
};

/// The safety state and its cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Supervisor {
    state: SafetyState,
    cause: Cause,
}

impl Default for Supervisor {
    /// Coast: neither poses nor a vehicle yet.
    fn default() -> Self {
        Self { state: SafetyState::Coast, cause: Cause::NoPose }
    }
}

impl Supervisor {
    /// Takes the transition of this tick. `cause` is the cause of a state other than Nominal.
    pub fn step(&mut self, conditions: &SafetyConditions, cause: Cause) -> SafetyState {
        let taken = TRANSITIONS.iter().find(|way| way.from == self.state && (way.when)(conditions));
        if let Some(way) = taken {
            self.state = way.to;
            self.cause = if way.to == SafetyState::Nominal { Cause::None } else { cause };
        }
        self.state
    }

    /// The present state.
    #[must_use]
    pub fn state(&self) -> SafetyState {
        self.state
    }

    /// Why the state is not Nominal.
    #[must_use]
    pub fn cause(&self) -> Cause {
        self.cause
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use SafetyState::{Coast, Nominal, Stop};

    const MISSED: SafetyConditions = SafetyConditions {
        poses_missing: true,
        poses_good: false,
        blind_too_long: false,
        vehicle_silent: false,
        vehicle_back: false,
        vehicle_lost: false,
        operator_stops: false,
        operator_arms: false,
    };
    const GOOD: SafetyConditions =
        SafetyConditions { poses_missing: false, poses_good: true, ..MISSED };

    fn in_state(state: SafetyState) -> Supervisor {
        Supervisor { state, cause: Cause::None }
    }

    #[test]
    fn it_starts_blind_and_turns_nominal_with_good_poses() {
        let mut supervisor = Supervisor::default();
        assert_eq!(supervisor.state(), Coast);
        assert_eq!(supervisor.step(&GOOD, Cause::None), Nominal);
        assert_eq!(supervisor.cause(), Cause::None);
    }

    #[test]
    fn missing_poses_coast_and_keep_their_cause() {
        let mut supervisor = in_state(Nominal);
        assert_eq!(supervisor.step(&MISSED, Cause::Jump), Coast);
        assert_eq!(supervisor.cause(), Cause::Jump);
        assert_eq!(supervisor.step(&GOOD, Cause::None), Nominal);
    }

    #[test]
    fn blindness_stops_from_every_flying_state() {
        let blind = SafetyConditions { blind_too_long: true, ..MISSED };
        for state in [Nominal, Coast] {
            assert_eq!(in_state(state).step(&blind, Cause::NoPose), Stop);
        }
    }

    #[test]
    fn f18_a_lost_vehicle_stops_from_every_flying_state() {
        let lost = SafetyConditions { vehicle_lost: true, ..GOOD };
        for state in [Nominal, Coast] {
            let mut supervisor = in_state(state);
            assert_eq!(supervisor.step(&lost, Cause::NoVehicle), Stop);
            assert_eq!(supervisor.cause(), Cause::NoVehicle);
        }
    }

    #[test]
    fn a_silent_vehicle_keeps_the_daemon_on_the_ground_and_is_the_cause_when_poses_are_not() {
        let silent = SafetyConditions { vehicle_silent: true, ..GOOD };
        let mut supervisor = Supervisor::default();
        assert_eq!(supervisor.step(&silent, Cause::NoVehicle), Coast);
        assert_eq!(supervisor.cause(), Cause::NoVehicle);
        let back_without_poses = SafetyConditions { vehicle_back: true, ..MISSED };
        assert_eq!(supervisor.step(&back_without_poses, Cause::Untracked), Coast);
        assert_eq!(supervisor.cause(), Cause::Untracked);
        assert_eq!(supervisor.step(&GOOD, Cause::None), Nominal);
        assert_eq!(supervisor.step(&silent, Cause::NoVehicle), Coast);
    }

    #[test]
    fn stop_is_latched_against_everything_but_arming_with_good_poses_and_a_vehicle() {
        for bits in 0..=u8::MAX {
            let on = |bit: u8| bits & (1 << bit) != 0;
            let conditions = SafetyConditions {
                poses_missing: on(0),
                poses_good: on(1),
                blind_too_long: on(2),
                operator_stops: on(3),
                operator_arms: on(4),
                vehicle_silent: on(5),
                vehicle_back: on(6),
                vehicle_lost: on(7),
            };
            let after = in_state(Stop).step(&conditions, Cause::None);
            let leaves = conditions.operator_arms
                && conditions.poses_good
                && !conditions.vehicle_silent
                && !conditions.operator_stops;
            assert_eq!(after == Nominal, leaves, "{conditions:?}");
        }
    }

    #[test]
    fn an_operator_stop_wins_over_everything() {
        let stop = SafetyConditions { operator_stops: true, ..GOOD };
        for state in [Nominal, Coast] {
            assert_eq!(in_state(state).step(&stop, Cause::Operator), Stop);
        }
    }
}
