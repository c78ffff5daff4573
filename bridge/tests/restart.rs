//! A bridge that is restarted while the motors of its vehicle run.

use oqtal_bridge::{CommandGate, MotorStatus, SafetyLimits, VehicleSetpoint};
use oqtal_bus::code::{Actuation, ControlHolder};
use oqtal_bus::message::{CommandV1, Header, Stamps};
use oqtal_bus::time::{Span, Time};

const PERIOD: Span = Span::from_nanos(16_666_667);
const LIMITS: SafetyLimits = SafetyLimits {
    accepts: Actuation::Sticks,
    command_age: Span::from_nanos(50_000_001),
    status_age: Span::from_millis(375),
    sequence: Span::from_millis(3000),
    rest: Span::from_millis(1500),
};
const START: Time = Time::VIRTUAL_START;

/// Set-points of a new bridge to a vehicle with running motors, of which it is told `control`, while a daemon commands "disarmed"; with
/// an operator's stop after 10 s.
fn set_points_after_a_restart(control: ControlHolder) -> [Vec<VehicleSetpoint>; 2] {
    let mut gate = CommandGate::new(START, LIMITS);
    let mut ticks = 0..;
    let mut ten_seconds = |gate: &mut CommandGate| -> Vec<VehicleSetpoint> {
        let tick = |k: i64| {
            let now = START + Span::from_nanos(k * PERIOD.nanos());
            let stamps = Stamps { command_published_at: now, ..Stamps::default() };
            let header = Header { sequence: k as u64, stamps, ..Header::default() };
            gate.receive(now, &header, CommandV1::default());
            gate.update_status(MotorStatus { received_at: now, running: true });
            gate.update_control(control);
            gate.select_command(now).0
        };
        ticks.by_ref().take(600).map(tick).collect()
    };
    let without = ten_seconds(&mut gate);
    gate.keep_stopped(Some(START));
    [without, ten_seconds(&mut gate)]
}

#[test]
fn f18_a_stop_reaches_motors_that_a_bridge_before_this_one_started() {
    let stops = |set_points: &[VehicleSetpoint]| set_points.contains(&VehicleSetpoint::StopMotors);
    let of = |control| set_points_after_a_restart(control).map(|set_points| stops(&set_points));
    assert_eq!(of(ControlHolder::Nobody), [false, true], "a pilot may fly it, until the stop");
    assert_eq!(of(ControlHolder::Bridge), [false, true]);
    assert_eq!(of(ControlHolder::Another), [false, false], "a pilot flies it");
}
