//! Modes of the daemon, and the transitions between them as one table.
//!
//! ```text
//!             an operator's request                   poses and vehicle ready
//!   Disarmed ───────────────────────▶ Waiting ──────────────────────────────────▶ Flying ──▶ Landing
//!    ▲  └───── automatic take-off ─────────────────────────────────────────────▶ ▲            │
//!    └────────── called off, now or never ─┘                                     │            │
//!    └──────────────────────── Stop, landed ─────────────────────────────────────┴────────────┘
//!
//!             first poses
//!   Disarmed ───────────────────────▶ Observing, until the daemon ends; instead of a flight
//! ```

use oqtal_bus::code::Mode;

/// Inputs of the state machine in one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ModeConditions {
    /// The safety state is Nominal or Degraded.
    pub(super) is_nominal: bool,
    /// The safety state is Coast or Stop.
    pub(super) is_blind: bool,
    /// The safety state is Stop.
    pub(super) is_stopped: bool,
    /// The tick has a pose.
    pub(super) is_fresh: bool,
    /// The tick has a pose, and a flight is possible.
    pub(super) is_ready: bool,
    /// The daemon only observes and commands nothing.
    pub(super) observes: bool,
    /// A flight begins without an operator.
    pub(super) automatic: bool,
    /// A requested flight begins with this tick or not at all: poses were good at the operator's request.
    pub(super) now_or_never: bool,
    /// The mission lands.
    pub(super) lands: bool,
    /// The vehicle stands after its landing.
    pub(super) has_landed: bool,
}

/// Action that comes with a transition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ModeAction {
    /// Nothing but the change of the mode.
    None,
    /// A flight begins.
    BeginFlight,
    /// The observation of a vehicle or a recording begins.
    BeginObservation,
    /// The flight ends: motors off.
    EndFlight,
}

/// Transition from one mode to another, taken when its condition holds.
struct ModeTransition {
    from: Mode,
    to: Mode,
    when: fn(&ModeConditions) -> bool,
    action: ModeAction,
}

/// All transitions but those by an operator's request; the first whose condition holds is taken.
#[rustfmt::skip]
const TRANSITIONS: [ModeTransition; 9] = {
    use Mode::{Disarmed, Flying, Landing, Observing, Waiting};
    use ModeAction::{BeginFlight, BeginObservation, EndFlight, None};
    use ModeTransition as T;
    [
        T { from: Disarmed, to: Flying, when: |c| c.is_nominal && c.is_ready && c.automatic, action: BeginFlight },
        T { from: Disarmed, to: Observing, when: |c| c.is_nominal && c.observes, action: BeginObservation },
        T { from: Waiting, to: Flying, when: |c| c.is_nominal && c.is_ready, action: BeginFlight },
        T { from: Waiting, to: Disarmed, when: |c| c.now_or_never && (c.is_fresh || c.is_blind), action: None },
        T { from: Flying, to: Disarmed, when: |c| c.is_stopped, action: EndFlight },
        T { from: Landing, to: Disarmed, when: |c| c.is_stopped, action: EndFlight },
        T { from: Flying, to: Disarmed, when: |c| c.has_landed, action: EndFlight },
        T { from: Landing, to: Disarmed, when: |c| c.has_landed, action: EndFlight },
        T { from: Flying, to: Landing, when: |c| c.lands, action: None },
    ]
};

/// The mode after `mode` under `conditions`, with the action of the transition; `None` if the mode stays.
pub(super) fn transition(mode: Mode, conditions: &ModeConditions) -> Option<(Mode, ModeAction)> {
    let mut transitions = TRANSITIONS.iter();
    let taken = transitions.find(|row| row.from == mode && (row.when)(conditions));
    taken.map(|row| (row.to, row.action))
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUIET: ModeConditions = ModeConditions {
        is_nominal: true,
        is_blind: false,
        is_stopped: false,
        is_fresh: true,
        is_ready: true,
        observes: false,
        automatic: false,
        now_or_never: false,
        lands: false,
        has_landed: false,
    };

    #[test]
    fn a_flight_begins_by_request_or_by_configuration_alone() {
        assert_eq!(transition(Mode::Disarmed, &QUIET), None);
        let begins = Some((Mode::Flying, ModeAction::BeginFlight));
        assert_eq!(transition(Mode::Waiting, &QUIET), begins);
        let automatic = ModeConditions { automatic: true, ..QUIET };
        assert_eq!(transition(Mode::Disarmed, &automatic), begins);
        for not_now in [
            ModeConditions { is_nominal: false, ..automatic },
            ModeConditions { is_ready: false, ..automatic },
        ] {
            assert_eq!(transition(Mode::Disarmed, &not_now), None);
            assert_eq!(transition(Mode::Waiting, &not_now), None);
            let now_or_never = ModeConditions { now_or_never: true, ..not_now };
            let called_off = Some((Mode::Disarmed, ModeAction::None));
            assert_eq!(transition(Mode::Waiting, &now_or_never), called_off);
        }
    }

    #[test]
    fn a_stop_ends_every_flight_and_no_observation() {
        let stopped = ModeConditions { is_stopped: true, is_nominal: false, ..QUIET };
        for mode in [Mode::Flying, Mode::Landing] {
            let ends = Some((Mode::Disarmed, ModeAction::EndFlight));
            assert_eq!(transition(mode, &stopped), ends);
        }
        let observed =
            |conditions| ModeConditions { observes: true, is_ready: false, ..conditions };
        let begins = Some((Mode::Observing, ModeAction::BeginObservation));
        assert_eq!(transition(Mode::Disarmed, &observed(QUIET)), begins);
        assert_eq!(transition(Mode::Observing, &observed(stopped)), None);
    }
}
