//! A bridge that is restarted while the motors of its vehicle run.

use oqtal_bridge::{CommandGate, MotorStatus, ReportedMotors, VehicleSetpoint};
use oqtal_bus::code::ControlHolder;
use oqtal_bus::message::CommandV1;
use oqtal_bus::time::Span;

use crate::common::{LIMITS, PERIOD, START, header};

/// Set-points of a new bridge to a vehicle with running motors, of which it is told `control`, while a daemon commands "disarmed"; with
/// an operator's stop after 10 s.
fn set_points_after_a_restart(control: ControlHolder) -> [Vec<VehicleSetpoint>; 2] {
    let mut gate = CommandGate::new(START, LIMITS);
    let mut ticks = 0..;
    let mut ten_seconds = |gate: &mut CommandGate| -> Vec<VehicleSetpoint> {
        let tick = |k: i64| {
            let now = START + Span::from_nanos(k * PERIOD.nanos());
            gate.receive(now, &header(k as u64, now), CommandV1::default());
            gate.update_status(MotorStatus { received_at: now, motors: ReportedMotors::Running });
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
