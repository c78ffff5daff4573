//! Whether the daemon may fly on what it sees: three states, and their transitions as one table.
//!
//! ```text
//!         poses missing, or on the           blind too long, or vehicle
//!         ground the vehicle silent          lost, flying
//!  Nominal ──────────────▶ Coast ────────────────────────────────▶ Stop
//!     ▲                      │                                       │
//!     └ poses, vehicle good ─┴──────────── operator arms ────────────┘
//! ```
//! In each tick: collect conditions, check transitions, go on.

use oqtal_bus::code::{Cause, SafetyState};

/// What is true in this tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Conditions {
    /// No believable pose for longer than a regular source ever pauses.
    pub poses_missing: bool,
    /// Enough good poses came in a row.
    pub poses_good: bool,
    /// The last believable pose is too long ago, in flight.
    pub blind_too_long: bool,
    /// The vehicle does not answer, on the ground: a flight must not begin.
    pub vehicle_silent: bool,
    /// The vehicle answers again, and its silence is still the cause of the state.
    pub vehicle_back: bool,
    /// In flight: the vehicle has not answered for too long, its motors stand, or its bridge was restarted. Before it: another
    /// vehicle took the place of the one that was to fly.
    pub vehicle_lost: bool,
    /// An operator asked to stop.
    pub operator_stops: bool,
    /// An operator arms.
    pub operator_arms: bool,
}

/// One way from state to state: when `when` holds in `from`.
struct Transition {
    from: SafetyState,
    to: SafetyState,
    when: fn(&Conditions) -> bool,
}

/// All ways, the most urgent first: the first that holds is taken.
const TRANSITIONS: [Transition; 9] = {
    use SafetyState::{Coast, Nominal, Stop};
    [
        Transition { from: Nominal, to: Stop, when: |c| c.operator_stops },
        Transition { from: Coast, to: Stop, when: |c| c.operator_stops },
        Transition { from: Nominal, to: Stop, when: |c| c.blind_too_long || c.vehicle_lost },
        Transition { from: Coast, to: Stop, when: |c| c.blind_too_long || c.vehicle_lost },
        Transition { from: Nominal, to: Coast, when: |c| c.poses_missing || c.vehicle_silent },
        Transition { from: Coast, to: Nominal, when: |c| c.poses_good && !c.vehicle_silent },
        // What is still missing is the other of the two: the cause changes, the state does not.
        Transition { from: Coast, to: Coast, when: |c| c.poses_good && c.vehicle_silent },
        Transition { from: Coast, to: Coast, when: |c| c.vehicle_back },
        // Latched: only an operator ends it, and only once poses are good and the vehicle answers.
        Transition {
            from: Stop,
            to: Nominal,
            when: |c| c.operator_arms && c.poses_good && !c.vehicle_silent && !c.operator_stops,
        },
    ]
};

/// The state, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Supervisor {
    state: SafetyState,
    cause: Cause,
}

impl Default for Supervisor {
    /// Blind until poses come; the vehicle must answer besides.
    fn default() -> Self {
        Self { state: SafetyState::Coast, cause: Cause::NoPose }
    }
}

impl Supervisor {
    /// Goes on by one tick. `cause` says what is missing, or who stops.
    pub fn step(&mut self, conditions: &Conditions, cause: Cause) -> SafetyState {
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

    /// Why it is not Nominal.
    #[must_use]
    pub fn cause(&self) -> Cause {
        self.cause
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use SafetyState::{Coast, Nominal, Stop};

    const MISSED: Conditions = Conditions {
        poses_missing: true,
        poses_good: false,
        blind_too_long: false,
        vehicle_silent: false,
        vehicle_back: false,
        vehicle_lost: false,
        operator_stops: false,
        operator_arms: false,
    };
    const GOOD: Conditions = Conditions { poses_missing: false, poses_good: true, ..MISSED };

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
        let blind = Conditions { blind_too_long: true, ..MISSED };
        for state in [Nominal, Coast] {
            assert_eq!(in_state(state).step(&blind, Cause::NoPose), Stop);
        }
    }

    #[test]
    fn f18_a_lost_vehicle_stops_from_every_flying_state() {
        let lost = Conditions { vehicle_lost: true, ..GOOD };
        for state in [Nominal, Coast] {
            let mut supervisor = in_state(state);
            assert_eq!(supervisor.step(&lost, Cause::NoVehicle), Stop);
            assert_eq!(supervisor.cause(), Cause::NoVehicle);
        }
    }

    #[test]
    fn a_silent_vehicle_keeps_the_daemon_on_the_ground_and_is_the_cause_when_poses_are_not() {
        let silent = Conditions { vehicle_silent: true, ..GOOD };
        let mut supervisor = Supervisor::default();
        assert_eq!(supervisor.step(&silent, Cause::NoVehicle), Coast);
        assert_eq!(supervisor.cause(), Cause::NoVehicle);
        let back_without_poses = Conditions { vehicle_back: true, ..MISSED };
        assert_eq!(supervisor.step(&back_without_poses, Cause::Untracked), Coast);
        assert_eq!(supervisor.cause(), Cause::Untracked);
        assert_eq!(supervisor.step(&GOOD, Cause::None), Nominal);
        assert_eq!(supervisor.step(&silent, Cause::NoVehicle), Coast);
    }

    #[test]
    fn stop_is_latched_against_everything_but_arming_with_good_poses_and_a_vehicle() {
        for bits in 0..=u8::MAX {
            let on = |bit: u8| bits & (1 << bit) != 0;
            let conditions = Conditions {
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
        let stop = Conditions { operator_stops: true, ..GOOD };
        for state in [Nominal, Coast] {
            assert_eq!(in_state(state).step(&stop, Cause::Operator), Stop);
        }
    }
}
