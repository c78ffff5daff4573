//! Rules of the supervisor in crazyflie-firmware, `supervisor.c` and `supervisor_state_machine.c`.
//!
//! | condition | from | to |
//! |---|---|---|
//! | armed | ready | armed |
//! | thrust | armed, landed | flying |
//! | no thrust for 2 s | flying | landed |
//! | 3 s on the floor | landed | ready, disarmed |
//! | no set-point for 0.5 s | flying | levels out: level, no turn, the last thrust |
//! | no set-point for 2 s, or disarmed | flying, levels out | locked |
//! | emergency stop, or its keep-alive missing for 1 s | any | locked |
//!
//! Only a restart ends `Locked`. A host can end its set-points by a packet; the age of the last one then no longer counts, and
//! the thrust is off.

use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::{Supervision, SupervisorCommand};

const LEVEL_AFTER: Span = Span::from_millis(500);
const LOCK_AFTER: Span = Span::from_millis(2000);
const FLYING_AFTER_THRUST: Span = Span::from_millis(2000);
const LANDED_FOR: Span = Span::from_millis(3000);
const KEEP_ALIVE: Span = Span::from_millis(1000);

/// State of the supervisor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SupervisorState {
    Ready,
    Armed,
    Flying,
    LevelsOut,
    Landed(Time),
    Locked,
}

/// Emulated supervisor.
#[derive(Clone, Debug)]
pub struct SupervisorModel {
    state: SupervisorState,
    arms_itself: bool,
    armed: bool,
    setpoint_at: Time,
    /// Whether the host has ended its set-points: their age does not count.
    is_relaxed: bool,
    thrust_at: Time,
    keep_alive_at: Option<Time>,
    emergency: bool,
}

impl SupervisorModel {
    /// Supervisor of a vehicle on the floor, switched on at `now`.
    pub fn new(now: Time, arms_itself: bool) -> Self {
        Self {
            state: SupervisorState::Ready,
            arms_itself,
            armed: false,
            setpoint_at: now,
            is_relaxed: false,
            thrust_at: Time::UNSET,
            keep_alive_at: None,
            emergency: false,
        }
    }

    /// Takes a set-point; `has_thrust` if its thrust is not zero.
    pub fn take_setpoint(&mut self, now: Time, has_thrust: bool) {
        (self.setpoint_at, self.is_relaxed) = (now, false);
        if has_thrust && self.may_run() {
            self.thrust_at = now;
        }
    }

    /// Takes the end of the set-points: the vehicle continues without thrust.
    pub fn relax(&mut self) {
        self.is_relaxed = true;
    }

    /// Takes a command; returns whether it is granted.
    pub fn command(&mut self, now: Time, command: SupervisorCommand) -> bool {
        match command {
            SupervisorCommand::Arm(arm) => {
                let granted = arm == self.armed || !arm || self.state == SupervisorState::Ready;
                self.armed = if granted { arm } else { self.armed };
                granted
            }
            // A crash is not modelled.
            SupervisorCommand::Recover => true,
            SupervisorCommand::EmergencyStop => {
                self.emergency = true;
                true
            }
            SupervisorCommand::KeepAlive => {
                self.keep_alive_at = Some(now);
                true
            }
        }
    }

    /// Applies the rules at `now`. While the vehicle levels out, it keeps the thrust of the last set-point: `has_thrust`.
    pub fn tick(&mut self, now: Time, has_thrust: bool) {
        if has_thrust && self.may_run() {
            self.thrust_at = now;
        }
        let next = self.next(now);
        if next == self.state {
            return;
        }
        self.state = next;
        match next {
            SupervisorState::Ready => self.armed = self.arms_itself,
            SupervisorState::Locked => self.armed = false,
            _ => {}
        }
    }

    fn next(&self, now: Time) -> SupervisorState {
        use SupervisorState::{Armed, Flying, Landed, LevelsOut, Locked, Ready};
        let age = if self.is_relaxed { Span::ZERO } else { now.since(self.setpoint_at) };
        let dead = self.keep_alive_at.is_some_and(|at| now.since(at) > KEEP_ALIVE);
        if self.emergency || dead {
            return Locked;
        }
        let is_flying = self.thrust_at.is_set() && now.since(self.thrust_at) < FLYING_AFTER_THRUST;
        match self.state {
            Ready if self.armed || self.arms_itself => Armed,
            Armed if !self.armed && !self.arms_itself => Ready,
            Armed if is_flying => Flying,
            Flying | LevelsOut if !self.armed && !self.arms_itself || age > LOCK_AFTER => Locked,
            Flying if age > LEVEL_AFTER => LevelsOut,
            LevelsOut if age <= LEVEL_AFTER => Flying,
            Flying if !is_flying => Landed(now),
            Landed(_) if is_flying => Flying,
            Landed(since) if now.since(since) > LANDED_FOR => Ready,
            state => state,
        }
    }

    /// Whether the motors may run.
    pub fn may_run(&self) -> bool {
        !matches!(self.state, SupervisorState::Ready | SupervisorState::Locked)
    }

    /// Whether the vehicle holds itself level because set-points are missing.
    pub fn levels_out(&self) -> bool {
        self.state == SupervisorState::LevelsOut
    }

    /// The state as the vehicle reports it.
    pub fn bits(&self) -> Supervision {
        let state = self.state;
        let flies = matches!(state, SupervisorState::Flying | SupervisorState::LevelsOut);
        let bits = [
            (state == SupervisorState::Ready, Supervision::CAN_BE_ARMED),
            (self.armed || self.may_run() && self.arms_itself, Supervision::ARMED),
            (self.arms_itself, Supervision::ARMS_ITSELF),
            (self.may_run(), Supervision::CAN_FLY),
            (flies, Supervision::FLYING),
            (state == SupervisorState::Locked, Supervision::LOCKED),
        ];
        let set = bits.into_iter().filter(|(holds, _)| *holds);
        set.fold(Supervision::default(), |all, (_, bit)| all.with(bit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    /// Ticks every 10 ms of the range, with a set-point each time unless `setpoint` is `None`.
    fn run(model: &mut SupervisorModel, millis: std::ops::Range<i64>, setpoint: Option<bool>) {
        for now in millis.step_by(10).map(at) {
            if let Some(has_thrust) = setpoint {
                model.take_setpoint(now, has_thrust);
            }
            model.tick(now, setpoint.unwrap_or(true));
        }
    }

    fn flying() -> SupervisorModel {
        let mut model = SupervisorModel::new(at(0), false);
        assert!(model.command(at(0), SupervisorCommand::Arm(true)));
        run(&mut model, 0..1000, Some(true));
        assert!(model.bits().contains(Supervision::FLYING));
        model
    }

    #[test]
    fn a_flight_passes_all_states_and_ends_disarmed() {
        let mut model = flying();
        run(&mut model, 1000..2900, Some(false));
        assert!(model.bits().contains(Supervision::FLYING), "thrust was less than 2 s ago");
        run(&mut model, 2900..3100, Some(false));
        assert!(!model.bits().contains(Supervision::FLYING));
        run(&mut model, 3100..6200, Some(false));
        assert!(model.bits().contains(Supervision::CAN_BE_ARMED) && !model.may_run());
    }

    #[test]
    fn silence_levels_out_and_then_locks_until_a_restart() {
        let mut model = flying();
        run(&mut model, 1000..1490, None);
        assert!(!model.levels_out());
        run(&mut model, 1490..2980, None);
        assert!(model.levels_out());
        let mut back = model.clone();
        run(&mut back, 2980..3000, Some(true));
        assert!(!back.levels_out() && back.may_run(), "set-points are back in time");
        run(&mut model, 2980..3020, None);
        assert!(model.bits().contains(Supervision::LOCKED) && !model.may_run());
        assert!(!model.command(at(3100), SupervisorCommand::Arm(true)));
    }

    #[test]
    fn set_points_that_a_host_has_ended_do_not_lock_the_vehicle() {
        let mut model = flying();
        model.relax();
        for now in (1000..6200).step_by(10).map(at) {
            model.tick(now, false);
        }
        assert!(model.bits().contains(Supervision::CAN_BE_ARMED));
    }

    #[test]
    fn disarming_in_flight_and_a_missing_keep_alive_lock() {
        let mut model = flying();
        model.command(at(1000), SupervisorCommand::Arm(false));
        run(&mut model, 1000..1020, Some(true));
        assert!(model.bits().contains(Supervision::LOCKED));
        let mut model = flying();
        model.command(at(1000), SupervisorCommand::KeepAlive);
        run(&mut model, 1000..2000, Some(true));
        assert!(model.may_run());
        run(&mut model, 2000..2030, Some(true));
        assert!(model.bits().contains(Supervision::LOCKED));
    }
}
