//! Whether the motors run, and how they come to run and to stand: five states, and their transitions as one table.
//!
//! ```text
//!          calm        wanted, motors stand            motors run             rested, motors run
//!   Held ───────▶ Off ─────────────────────▶ Starting ───────────▶ Running ─────────────────────▶ Stopping
//!    ▲             ▲└────── wanted, motors run ──────────────────────▲ │                            │  │
//!    │             └──────────────── motors stand ────────────────────┴────────────────────────────┘  │
//!    └──────────── a sequence is overdue, the daemon fell silent, motors stand though wanted ───────────┘
//! ```
//!
//! What is from where:
//!
//! - Start and stop are the same frame, no thrust and full yaw, held until it takes effect: a *toggle*. `asctec_drivers` sends
//!   it up to 15 times, 0.2 s apart, until `LL_STATUS` says that the motors run; `asctec_mav_framework` holds it for at most
//!   1.5 s. So it is sent only while a fresh status says that it is needed, and for a bounded time.
//! - Ours: what was lost is never resumed. After a port was opened, and after anything was given up, the bridge is *held*:
//!   neutral until nobody has wanted to fly for a while. A bridge that restarts in flight must not start motors anew.
//! - Ours: motors are stopped only after the daemon itself commanded neutral for a while. A daemon that died says nothing: then
//!   the frames are neutral and stay so, and the vehicle's rotors idle until a daemon is back or the pilot stops them.
//! - Ours: motors that were not flown from here are left alone: a pilot may fly by hand while the bridge listens.
//! - The vehicle's emergency stop is in `asctec_drivers` alone, and no source says what it takes to fly again after it. It is
//!   sent only where neutral cannot end the matter: a stop sequence that was given up, and a bridge that ends while motors run.
//!   A Stop of the daemon in flight is neutral at once, and then the stop sequence like after a landing.

use oqtal_bus::time::{Span, Time};

/// After a toggle a status may still be on its way that was true before it.
const SETTLE: Span = Span::from_millis(500);

/// How it is with the motors, as far as the bridge is concerned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MotorState {
    /// Neutral, until nobody has wanted to fly for a while.
    #[default]
    Held,
    /// Neutral; ready to start.
    Off,
    /// The start sequence is sent.
    Starting,
    /// Commands are passed on.
    Running,
    /// The stop sequence is sent.
    Stopping,
}

/// What is true now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MotorConditions {
    /// The daemon wants to fly: its newest command is young, and not neutral.
    pub wanted: bool,
    /// It has not wanted to for a while.
    pub calm: bool,
    /// Its last word was neutral.
    pub disarmed: bool,
    /// It has commanded neutral for so long that the vehicle stands.
    pub rested: bool,
    /// A fresh status says that the motors run.
    pub run: bool,
    /// A fresh status says that they stand.
    pub stand: bool,
    /// It has said nothing at all for so long that the vehicle lies where it fell.
    pub abandoned: bool,
    /// They were flown from here, and have not been seen to stand since.
    pub flown: bool,
    /// The present state has lasted long enough for a status to be about it.
    pub settled: bool,
    /// The present state has lasted for as long as a sequence may.
    pub overdue: bool,
}

/// One way from state to state: when `when` holds in `from`.
struct MotorTransition {
    from: MotorState,
    to: MotorState,
    when: fn(&MotorConditions) -> bool,
}

/// All ways; the first that holds is taken.
const TRANSITIONS: [MotorTransition; 13] = {
    use MotorState::{Held, Off, Running, Starting, Stopping};
    [
        // A daemon that fell silent in flight must come back and say so: it may only have been asleep.
        MotorTransition { from: Held, to: Off, when: |c| c.calm && (c.disarmed || !c.flown) },
        // Left over from before it was held.
        MotorTransition { from: Off, to: Stopping, when: |c| c.flown && c.rested && c.run },
        MotorTransition { from: Off, to: Running, when: |c| c.wanted && c.run },
        MotorTransition { from: Off, to: Starting, when: |c| c.wanted && c.stand },
        // Called off: the toggle may have taken effect already, and then must be taken back.
        MotorTransition { from: Starting, to: Stopping, when: |c| !c.wanted },
        MotorTransition { from: Starting, to: Running, when: |c| c.run },
        MotorTransition { from: Starting, to: Held, when: |c| c.overdue },
        // Somebody else stopped them, the pilot perhaps: they are not started again behind his back.
        MotorTransition { from: Running, to: Held, when: |c| c.stand && c.wanted },
        MotorTransition { from: Running, to: Off, when: |c| c.stand },
        MotorTransition { from: Running, to: Held, when: |c| c.abandoned },
        MotorTransition { from: Running, to: Stopping, when: |c| c.rested && c.run },
        MotorTransition { from: Stopping, to: Off, when: |c| c.stand && c.settled },
        MotorTransition { from: Stopping, to: Held, when: |c| c.overdue },
    ]
};

/// What there is to say about a transition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotorChange {
    /// The motors are being started.
    Starts,
    /// They run.
    Runs,
    /// They are being stopped.
    Stops,
    /// They stand.
    Stands,
    /// The start sequence had no effect.
    StartFailed,
    /// The stop sequence had no effect.
    StopFailed,
    /// They stood still while a flight was wanted.
    Stalled,
    /// The daemon fell silent while they ran.
    Abandoned,
}

/// The state, and since when.
#[derive(Clone, Copy, Debug)]
pub struct MotorSequencer {
    state: MotorState,
    since: Time,
    longest: Span,
    flown: bool,
}

impl MotorSequencer {
    /// Held at `now`; a sequence lasts `longest` at most.
    #[must_use]
    pub fn new(now: Time, longest: Span) -> Self {
        Self { state: MotorState::Held, since: now, longest, flown: false }
    }

    /// The present state.
    #[must_use]
    pub fn state(&self) -> MotorState {
        self.state
    }

    /// Neutral until nobody has wanted to fly for a while.
    pub fn hold(&mut self, now: Time) {
        (self.state, self.since) = (MotorState::Held, now);
    }

    /// Whether the motors may run because of what was sent from here.
    #[must_use]
    pub fn may_run(&self) -> bool {
        self.flown || !matches!(self.state, MotorState::Held | MotorState::Off)
    }

    /// Goes on to `now`; what changed, if it is worth saying. The last three of `conditions` are filled in.
    pub fn step(&mut self, now: Time, conditions: MotorConditions) -> Option<MotorChange> {
        let lasted = now.since(self.since);
        self.flown &= !conditions.stand;
        let conditions = MotorConditions {
            flown: self.flown,
            settled: lasted >= SETTLE,
            overdue: lasted >= self.longest,
            ..conditions
        };
        let way =
            TRANSITIONS.iter().find(|way| way.from == self.state && (way.when)(&conditions))?;
        (self.state, self.since) = (way.to, now);
        let change = change(way, &conditions);
        match change {
            Some(MotorChange::Runs) => self.flown = true,
            // Tried, and told: not again.
            Some(MotorChange::StopFailed) => self.flown = false,
            _ => {}
        }
        change
    }
}

/// What there is to say about a way that was taken.
fn change(way: &MotorTransition, conditions: &MotorConditions) -> Option<MotorChange> {
    match (way.from, way.to) {
        (_, MotorState::Starting) => Some(MotorChange::Starts),
        (_, MotorState::Running) => Some(MotorChange::Runs),
        (_, MotorState::Stopping) => Some(MotorChange::Stops),
        (MotorState::Starting, MotorState::Held) => Some(MotorChange::StartFailed),
        (MotorState::Stopping, MotorState::Held) => Some(MotorChange::StopFailed),
        (MotorState::Running, MotorState::Held) if conditions.abandoned => {
            Some(MotorChange::Abandoned)
        }
        (MotorState::Running, MotorState::Held) => Some(MotorChange::Stalled),
        (MotorState::Held, _) => None,
        _ => Some(MotorChange::Stands),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use MotorState::{Held, Off, Running, Starting, Stopping};

    const LONGEST: Span = Span::from_millis(3000);
    const STATES: [MotorState; 5] = [Held, Off, Starting, Running, Stopping];
    const WANTED: MotorConditions = MotorConditions {
        wanted: true,
        calm: false,
        disarmed: false,
        rested: false,
        run: false,
        stand: false,
        abandoned: false,
        flown: false,
        settled: false,
        overdue: false,
    };

    fn after(state: MotorState, millis: i64, conditions: MotorConditions) -> MotorState {
        let since = Time::VIRTUAL_START;
        let mut motors = MotorSequencer { state, since, longest: LONGEST, flown: conditions.flown };
        motors.step(since + Span::from_millis(millis), conditions);
        motors.state
    }

    fn all_conditions() -> impl Iterator<Item = MotorConditions> {
        (0..32_u8).map(|bits| {
            let on = |bit: u8| bits & (1 << bit) != 0;
            let (wanted, run, stand) = (on(0), on(3), on(4));
            MotorConditions {
                wanted,
                calm: on(1),
                rested: on(2),
                run,
                stand,
                ..MotorConditions::default()
            }
        })
    }

    #[test]
    fn a_flight_goes_round() {
        let (run, stand) = (
            MotorConditions { run: true, ..MotorConditions::default() },
            MotorConditions { stand: true, ..MotorConditions::default() },
        );
        assert_eq!(after(Held, 1, MotorConditions { calm: true, ..stand }), Off);
        assert_eq!(after(Off, 1, MotorConditions { wanted: true, ..stand }), Starting);
        assert_eq!(after(Starting, 1, MotorConditions { wanted: true, ..run }), Running);
        assert_eq!(after(Running, 1, run), Running, "neutral, but not for long");
        assert_eq!(after(Running, 1, MotorConditions { rested: true, ..run }), Stopping);
        assert_eq!(after(Stopping, 499, stand), Stopping, "that status may be old");
        assert_eq!(after(Stopping, 500, stand), Off);
    }

    #[test]
    fn a_sequence_is_given_up() {
        assert_eq!(after(Starting, 2999, WANTED), Starting);
        assert_eq!(after(Starting, 3000, WANTED), Held);
        assert_eq!(after(Stopping, 3000, MotorConditions::default()), Held);
    }

    #[test]
    fn only_calm_ends_being_held() {
        for conditions in all_conditions() {
            assert_eq!(after(Held, 10_000, conditions) == Off, conditions.calm, "{conditions:?}");
        }
    }

    #[test]
    fn no_sequence_begins_without_a_fresh_status_but_to_take_a_start_back() {
        for state in STATES {
            for conditions in all_conditions().filter(|c| !c.run && !c.stand) {
                let next = after(state, 10, conditions);
                let begun = next != state && matches!(next, Starting | Stopping);
                assert!(!begun || state == Starting, "{state:?} {conditions:?}");
            }
        }
    }

    #[test]
    fn motors_that_stood_still_in_flight_are_not_started_again() {
        assert_eq!(after(Running, 10, MotorConditions { stand: true, ..WANTED }), Held);
        assert_eq!(after(Held, 10, MotorConditions { stand: true, ..WANTED }), Held);
    }

    #[test]
    fn a_daemon_that_fell_silent_must_be_disarmed_before_it_flies_on() {
        let run = MotorConditions { run: true, flown: true, ..WANTED };
        let silent = MotorConditions { abandoned: true, wanted: false, ..run };
        assert_eq!(after(Running, 10, silent), Held);
        assert_eq!(after(Held, 10, run), Held);
        let calm = MotorConditions { calm: true, wanted: false, ..run };
        assert_eq!(after(Held, 10, calm), Held);
        let disarmed = MotorConditions { disarmed: true, rested: true, ..calm };
        assert_eq!(after(Held, 10, disarmed), Off);
        assert_eq!(after(Off, 10, disarmed), Stopping);
    }

    #[test]
    fn motors_that_nobody_here_flew_are_left_alone() {
        let by_hand =
            MotorConditions { calm: true, rested: true, run: true, ..MotorConditions::default() };
        assert_eq!(after(Held, 10, by_hand), Off);
        assert_eq!(after(Off, 10_000, by_hand), Off);
    }
}
