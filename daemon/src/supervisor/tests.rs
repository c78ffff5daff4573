//! Tests of the table of limits, in virtual time.

use super::*;
use SafetyState::Nominal;

const GOOD: SafetyConditions = SafetyConditions { poses_good: true, ..NOTHING };
const FLYING: SafetyConditions = SafetyConditions { is_flying: true, ..GOOD };
const MISSED: SafetyConditions = SafetyConditions { poses_missing: true, ..NOTHING };
const NOTHING: SafetyConditions = SafetyConditions {
    poses_missing: false,
    poses_good: false,
    blind_too_long: false,
    may_descend: false,
    is_down: false,
    vehicle_silent: false,
    vehicle_lost: false,
    motors_do_not_run: false,
    control_taken: false,
    operator_stops: false,
    ended_in_flight: false,
    operator_arms: false,
    is_flying: false,
    limits: NO_LIMITS,
};
const NO_LIMITS: LimitConditions = LimitConditions {
    leaves_fence: false,
    in_fence_margin: false,
    held_too_long: false,
    too_fast: false,
    tilted: false,
    tipped: false,
    far_off: false,
    sinks: false,
    stays_on_floor: false,
    lies_on_floor: false,
    landing_overdue: false,
    battery_low: false,
    battery_empty: false,
    link_poor: false,
    link_bad: false,
    poses_old: false,
    poses_too_old: false,
    poses_lost: false,
    poses_contradict: false,
    poses_disagree: false,
    poses_mislead: false,
    overrun: false,
    stood_still: false,
    configs_differ: false,
    files_lost: false,
    setpoint_refused: false,
    references_ended: false,
    references_overdue: false,
    law_fails: false,
};

/// A supervisor and its clock.
struct Watch {
    supervisor: Supervisor,
    now: Time,
}

impl Watch {
    /// A supervisor in Nominal, in flight.
    fn nominal() -> Self {
        let mut watch = Self { supervisor: Supervisor::default(), now: Time::VIRTUAL_START };
        assert_eq!(watch.tick(&FLYING), Nominal);
        watch
    }

    fn tick(&mut self, conditions: &SafetyConditions) -> SafetyState {
        self.tick_for(conditions, Cause::NoPose)
    }

    fn tick_for(&mut self, conditions: &SafetyConditions, pose_cause: Cause) -> SafetyState {
        self.now = self.now + Span::from_millis(10);
        self.supervisor.step(self.now, conditions, pose_cause)
    }

    /// The state ends as docs/faults.md says, and no sooner.
    fn assert_ends(&mut self, state: SafetyState, cause: Cause) {
        let (lasts, end) = match (state, cause) {
            (Stop, _) => (1000, SafetyConditions { operator_arms: true, ..GOOD }),
            (Land, _) => (1000, GOOD),
            (Hold, _) | (_, Cause::Setpoint) => (480, FLYING),
            (_, Cause::Battery | Cause::Link) => (1980, FLYING),
            (_, Cause::Overrun | Cause::Configuration) => (0, FLYING),
            _ => (980, FLYING),
        };
        for _ in 0..lasts / 10 {
            assert_eq!(self.tick(&FLYING), state, "{cause}");
        }
        let more = self.until(Nominal, &end);
        assert!(more <= 20, "{cause}: {more} ms more");
    }

    /// Time until `state` under constant conditions \[ms\].
    fn until(&mut self, state: SafetyState, conditions: &SafetyConditions) -> i64 {
        let since = self.now;
        while self.supervisor.state() != state {
            assert!(self.now.since(since) < Span::from_millis(60_000), "never {state}");
            self.tick(conditions);
        }
        self.now.since(since).nanos() / 1_000_000
    }
}

#[test]
fn the_state_is_coast_at_first_and_nominal_with_good_poses() {
    let mut watch = Watch { supervisor: Supervisor::default(), now: Time::VIRTUAL_START };
    assert_eq!((watch.supervisor.state(), watch.supervisor.cause()), (Coast, Cause::NoPose));
    assert_eq!(watch.tick(&GOOD), Nominal);
    assert_eq!(watch.supervisor.cause(), Cause::None);
}

#[test]
fn missing_poses_coast_and_keep_their_cause() {
    let mut watch = Watch::nominal();
    assert_eq!(watch.tick_for(&MISSED, Cause::Jump), Coast);
    assert_eq!(watch.tick_for(&MISSED, Cause::NoPose), Coast);
    assert_eq!(watch.supervisor.cause(), Cause::Jump);
    assert_eq!(watch.tick(&GOOD), Nominal);
}

#[test]
fn f02_blindness_stops_from_every_flying_state() {
    let blind = SafetyConditions { blind_too_long: true, is_flying: true, ..MISSED };
    let mut watch = Watch::nominal();
    assert_eq!(watch.tick_for(&blind, Cause::Relabel), Stop);
    assert_eq!(watch.supervisor.cause(), Cause::Relabel);
}

#[test]
fn f48_a_blind_vehicle_that_may_descends_until_it_is_down_or_may_no_longer_and_lands_with_poses() {
    let blind =
        SafetyConditions { blind_too_long: true, may_descend: true, is_flying: true, ..MISSED };
    let mut watch = Watch::nominal();
    assert_eq!(watch.tick_for(&blind, Cause::Relabel), Descend);
    assert_eq!(watch.supervisor.cause(), Cause::Relabel);
    assert_eq!(watch.tick(&FLYING), Land, "seen again");
    assert_eq!(watch.tick(&FLYING), Land);
    assert_eq!(watch.tick(&blind), Descend);
    assert_eq!(watch.tick(&SafetyConditions { may_descend: false, ..blind }), Stop);
    assert_eq!(watch.tick(&FLYING), Stop, "latched");
    let mut watch = Watch::nominal();
    watch.tick(&blind);
    let down = SafetyConditions { is_down: true, ..blind };
    assert!((200..=210).contains(&watch.until(Stop, &down)));
    watch.assert_ends(Stop, Cause::NoPose);
    watch.tick(&blind);
    assert_eq!(watch.tick(&FLYING), Land);
    watch.assert_ends(Land, Cause::NoPose);
}

#[test]
fn f18_a_lost_vehicle_stops_from_every_flying_state() {
    let lost = SafetyConditions { vehicle_lost: true, ..FLYING };
    let mut watch = Watch::nominal();
    assert_eq!(watch.tick(&lost), Stop);
    assert_eq!(watch.supervisor.cause(), Cause::NoVehicle);
}

#[test]
fn f36_motors_that_do_not_run_stop_a_flight_and_a_silent_vehicle_is_the_cause_of_both() {
    let stands = SafetyConditions { motors_do_not_run: true, ..FLYING };
    let mut watch = Watch::nominal();
    assert_eq!(watch.tick(&stands), Stop);
    watch.assert_ends(Stop, Cause::MotorsNotRunning);
    let mut watch = Watch::nominal();
    watch.tick(&SafetyConditions { vehicle_lost: true, ..stands });
    assert_eq!(watch.supervisor.cause(), Cause::NoVehicle);
}

#[test]
fn f57_control_that_another_takes_ends_a_flight_at_once_until_it_is_armed_again() {
    let mut watch = Watch::nominal();
    let taken = SafetyConditions { control_taken: true, vehicle_lost: true, ..FLYING };
    assert_eq!(watch.tick(&taken), Stop);
    assert_eq!(watch.supervisor.cause(), Cause::ControlTaken);
    watch.assert_ends(Stop, Cause::ControlTaken);
}

#[test]
fn a_silent_vehicle_keeps_the_daemon_on_the_ground_and_is_the_cause_when_poses_are_not() {
    let silent = SafetyConditions { vehicle_silent: true, ..GOOD };
    let mut watch = Watch { supervisor: Supervisor::default(), now: Time::VIRTUAL_START };
    watch.tick(&silent);
    assert_eq!((watch.supervisor.state(), watch.supervisor.cause()), (Coast, Cause::NoVehicle));
    watch.tick_for(&MISSED, Cause::Untracked);
    assert_eq!((watch.supervisor.state(), watch.supervisor.cause()), (Coast, Cause::Untracked));
    assert_eq!(watch.tick(&GOOD), Nominal);
    assert_eq!(watch.tick(&silent), Coast);
}

#[test]
fn stop_is_latched_against_everything_but_arming_with_good_poses_and_a_vehicle() {
    for bits in 0..128_u8 {
        let on = |bit: u8| bits & (1 << bit) != 0;
        let mut watch = Watch::nominal();
        watch.tick(&SafetyConditions { operator_stops: true, ..FLYING });
        let conditions = SafetyConditions {
            poses_missing: on(0),
            poses_good: on(1),
            operator_stops: on(2),
            operator_arms: on(3),
            vehicle_silent: on(4),
            vehicle_lost: on(5),
            is_flying: on(6),
            ..NOTHING
        };
        let leaves = conditions.operator_arms
            && conditions.poses_good
            && !conditions.vehicle_silent
            && !conditions.operator_stops
            && !conditions.vehicle_lost;
        let after = watch.tick(&conditions);
        assert_eq!(after != Stop, leaves, "{conditions:?}: {after}");
    }
}

/// Each limit, its state, its time \[ms\], its cause.
#[test]
fn every_limit_acts_within_its_bound_and_reports_its_cause() {
    let with = |change: fn(&mut LimitConditions)| {
        let mut conditions = FLYING;
        change(&mut conditions.limits);
        conditions
    };
    let rows: [(SafetyConditions, SafetyState, i64, Cause); 26] = [
        (with(|l| l.stood_still = true), Stop, 0, Cause::Overrun),
        (with(|l| l.leaves_fence = true), Stop, 0, Cause::Fence),
        (with(|l| l.tipped = true), Stop, 100, Cause::Tilt),
        (with(|l| l.poses_mislead = true), Stop, 300, Cause::Contradiction),
        (with(|l| l.lies_on_floor = true), Stop, 2000, Cause::Crash),
        (with(|l| l.stays_on_floor = true), Stop, 0, Cause::NoLift),
        (with(|l| l.landing_overdue = true), Stop, 0, Cause::Landing),
        (with(|l| l.sinks = true), Land, 700, Cause::NoLift),
        (with(|l| l.too_fast = true), Land, 200, Cause::Speed),
        (with(|l| l.far_off = true), Land, 3000, Cause::Tracking),
        (with(|l| l.battery_empty = true), Land, 2000, Cause::Battery),
        (with(|l| l.link_bad = true), Land, 2000, Cause::Link),
        (with(|l| l.poses_too_old = true), Land, 500, Cause::PosesLate),
        (with(|l| l.files_lost = true), Land, 0, Cause::FilesLost),
        (with(|l| l.held_too_long = true), Land, 0, Cause::HeldTooLong),
        (with(|l| l.in_fence_margin = true), Hold, 0, Cause::Fence),
        (with(|l| l.setpoint_refused = true), Degraded, 0, Cause::Setpoint),
        (with(|l| l.tilted = true), Degraded, 100, Cause::Tilt),
        (with(|l| l.battery_low = true), Degraded, 2000, Cause::Battery),
        (with(|l| l.link_poor = true), Degraded, 2000, Cause::Link),
        (with(|l| l.poses_old = true), Degraded, 200, Cause::PosesLate),
        (with(|l| l.poses_lost = true), Degraded, 0, Cause::PosesLost),
        (with(|l| l.overrun = true), Degraded, 0, Cause::Overrun),
        (with(|l| l.sinks = true), Degraded, 200, Cause::NoLift),
        (with(|l| l.far_off = true), Degraded, 1000, Cause::Tracking),
        (with(|l| l.configs_differ = true), Degraded, 0, Cause::Configuration),
    ];
    for (conditions, state, millis, cause) in rows {
        let mut watch = Watch::nominal();
        let waited = watch.until(state, &conditions);
        assert!((millis..=millis + 10).contains(&waited), "{cause}: {waited} ms");
        assert_eq!(watch.supervisor.cause(), cause);
        watch.assert_ends(state, cause);
    }
}

#[test]
fn a_condition_that_chatters_neither_acts_nor_lets_go() {
    let tipped =
        SafetyConditions { limits: LimitConditions { tipped: true, ..NO_LIMITS }, ..FLYING };
    let margin = SafetyConditions {
        limits: LimitConditions { in_fence_margin: true, ..NO_LIMITS },
        ..FLYING
    };
    let mut watch = Watch::nominal();
    for _ in 0..100 {
        assert_eq!(watch.tick(&tipped), Nominal);
        assert_eq!(watch.tick(&FLYING), Nominal);
    }
    for _ in 0..100 {
        assert_eq!(watch.tick(&margin), Hold);
        assert_eq!(watch.tick(&FLYING), Hold);
    }
    assert!((480..=510).contains(&watch.until(Nominal, &FLYING)));
}

#[test]
fn a_landing_ends_with_the_flight_and_a_worse_limit_takes_precedence() {
    let fast =
        SafetyConditions { limits: LimitConditions { too_fast: true, ..NO_LIMITS }, ..FLYING };
    let mut watch = Watch::nominal();
    watch.until(Land, &fast);
    assert_eq!(watch.tick(&FLYING), Land, "slow again");
    assert_eq!(watch.tick(&SafetyConditions { poses_missing: true, ..FLYING }), Land);
    let crossing =
        SafetyConditions { limits: LimitConditions { leaves_fence: true, ..NO_LIMITS }, ..FLYING };
    assert_eq!(watch.tick(&crossing), Stop);
    assert_eq!(watch.supervisor.cause(), Cause::Fence);
    let mut watch = Watch::nominal();
    watch.until(Land, &fast);
    assert_eq!(watch.tick(&GOOD), Nominal, "on the ground");
}
