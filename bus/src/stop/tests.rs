use super::*;
use crate::message::Stamps;

const NOW: Time = Time::VIRTUAL_START;

fn switch() -> StopSwitch {
    StopSwitch::local(Rc::default())
}

/// Passes `vehicle` a command with this actuation, published `millis` after [`NOW`].
fn command(vehicle: &mut VehicleStop, actuation: Actuation, millis: i64) {
    let command_published_at = NOW + Span::from_millis(millis);
    let stamps = Stamps { command_published_at, ..Stamps::default() };
    let body = CommandV1 { actuation: actuation.code(), ..CommandV1::default() };
    vehicle.receive_command(&Header { stamps, ..Header::default() }, &body);
}

#[test]
fn a_stop_is_in_force_until_disarmed_is_commanded_after_it() {
    let switch = switch();
    let mut vehicle = VehicleStop::new(switch.clone());
    assert!(!vehicle.is_in_force(NOW));
    let number = switch.raise();
    assert!(vehicle.is_in_force(NOW));
    command(&mut vehicle, Actuation::Disarmed, 5);
    assert!(vehicle.is_in_force(NOW), "lifted before it was obeyed");
    assert_eq!(switch.report(number), StopReport::default());
    vehicle.confirm(NOW, StoppedMotors::Off);
    for (actuation, millis) in [(Actuation::Sticks, 5), (Actuation::Disarmed, -1)] {
        command(&mut vehicle, actuation, millis);
        assert!(vehicle.is_in_force(NOW), "{actuation} at {millis} ms");
    }
    command(&mut vehicle, Actuation::Disarmed, 0);
    assert!(!vehicle.is_in_force(NOW));
    let report = switch.report(number);
    assert!(report.vehicle_obeys && report.motors_off && !report.daemon_obeys);
}

#[test]
fn f57_a_stop_that_another_s_control_withholds_is_not_obeyed_until_control_is_given_back() {
    let switch = switch();
    let mut vehicle = VehicleStop::new(switch.clone());
    let number = switch.raise();
    assert!(vehicle.is_in_force(NOW));
    // Before the first report of the vehicle.
    vehicle.confirm(NOW, StoppedMotors::Unknown);
    vehicle.withhold();
    let report = switch.report(number);
    assert!(report.another_has_control && !report.vehicle_obeys && switch.awaits_vehicle());
    command(&mut vehicle, Actuation::Disarmed, 4000);
    assert!(vehicle.is_in_force(NOW), "lifted while it was withheld");
    vehicle.confirm(NOW, StoppedMotors::Off);
    let off = StopReport { vehicle_obeys: true, motors_off: true, ..StopReport::default() };
    assert_eq!(switch.report(number), off);
    command(&mut vehicle, Actuation::Disarmed, 5);
    assert!(!vehicle.is_in_force(NOW));
    assert_eq!(switch.report(number), off);
    assert!(!switch.report(switch.raise()).another_has_control, "of the stop before");
}

#[test]
fn a_stop_is_in_force_until_the_motors_are_known_to_be_off() {
    let switch = switch();
    let mut vehicle = VehicleStop::new(switch.clone());
    let number = switch.raise();
    assert!(vehicle.is_in_force(NOW));
    vehicle.confirm(NOW, StoppedMotors::Running);
    // The port was lost.
    vehicle.confirm(NOW, StoppedMotors::Unknown);
    for millis in [17, 400, 2999, 60_000] {
        command(&mut vehicle, Actuation::Disarmed, millis);
        assert!(vehicle.is_in_force(NOW), "lifted after {millis} ms with motors running");
    }
    vehicle.confirm(NOW, StoppedMotors::Off);
    assert!(switch.report(number).motors_off);
    command(&mut vehicle, Actuation::Disarmed, 420);
    assert!(!vehicle.is_in_force(NOW));

    // A vehicle that never reports does not block the instance permanently. Its port was opened after 5 s.
    switch.raise();
    assert!(vehicle.is_in_force(NOW));
    vehicle.confirm(NOW + Span::from_millis(5000), StoppedMotors::Unknown);
    for (millis, is_in_force) in [(7999, true), (8000, false)] {
        command(&mut vehicle, Actuation::Disarmed, millis);
        assert_eq!(vehicle.is_in_force(NOW), is_in_force);
    }
}

#[test]
fn each_stop_must_be_lifted_however_many_operators_raise_one() {
    let switch = switch();
    let mut vehicle = VehicleStop::new(switch.clone());
    let first = switch.raise();
    assert!(vehicle.is_in_force(NOW));
    let second = switch.raise();
    let later = NOW + Span::from_millis(3);
    assert!(vehicle.is_in_force(later));
    vehicle.confirm(NOW, StoppedMotors::Unknown);
    // Published before the second stop was seen.
    command(&mut vehicle, Actuation::Disarmed, 2);
    assert!(vehicle.is_in_force(later));
    assert!(switch.report(first).vehicle_obeys && switch.report(second).vehicle_obeys);
    assert!(!switch.report(second).motors_off);
}

#[test]
fn a_signal_raises_a_stop_in_either_process() {
    for is_vehicle in [true, false] {
        let (shared, signals) = (switch(), SignalFlags::default());
        let signalled = shared.clone().with_signals(signals.clone());
        let of = |obeys: bool| if obeys { signalled.clone() } else { shared.clone() };
        let mut vehicle = VehicleStop::new(of(is_vehicle));
        let mut daemon = ControllerStop::new(of(!is_vehicle));
        signals.stop.store(true, Ordering::Release);
        signals.land.store(true, Ordering::Release);
        // The process that receives the signal reads its words first.
        let seen = if is_vehicle {
            [vehicle.is_in_force(NOW), daemon.is_newly_raised()]
        } else {
            [daemon.is_newly_raised(), vehicle.is_in_force(NOW)]
        };
        assert_eq!(seen, [true, true]);
        assert!(!daemon.is_newly_raised(), "raised once");
        assert_eq!(daemon.is_landing_requested(), !is_vehicle);
        assert!(!daemon.is_landing_requested() && !daemon.are_files_lost());
    }
}

#[test]
fn a_stop_without_a_vehicle_waits_for_one_and_a_restarted_daemon_sees_it_again() {
    let switch = switch();
    let mut daemon = ControllerStop::new(switch.clone());
    let number = switch.raise();
    assert!(daemon.is_newly_raised() && !daemon.is_newly_raised());
    daemon.confirm();
    assert!(switch.report(number).daemon_obeys);
    assert!(ControllerStop::new(switch.clone()).is_newly_raised());
    let mut vehicle = VehicleStop::new(switch.clone());
    assert!(vehicle.is_in_force(NOW));
    vehicle.confirm(NOW, StoppedMotors::Off);
    command(&mut vehicle, Actuation::Disarmed, 1);
    assert!(!ControllerStop::new(switch.clone()).is_newly_raised());
    assert!(!VehicleStop::new(switch).is_in_force(NOW));
}

#[test]
fn f69_zeroed_words_lift_no_stop_and_raise_one_after_an_earlier_stop() {
    for was_lifted in [false, true] {
        let switch = switch();
        let mut vehicle = VehicleStop::new(switch.clone());
        let mut daemon = ControllerStop::new(switch.clone());
        switch.raise();
        assert!(vehicle.is_in_force(NOW) && daemon.is_newly_raised());
        vehicle.confirm(NOW, StoppedMotors::Off);
        if was_lifted {
            command(&mut vehicle, Actuation::Disarmed, 0);
            assert!(!vehicle.is_in_force(NOW));
        }
        switch.words.iter().for_each(|word| word.store(0, Ordering::Release));
        assert!(daemon.is_newly_raised());
        assert!(vehicle.is_in_force(NOW));
        // It ends as every stop.
        vehicle.confirm(NOW, StoppedMotors::Off);
        command(&mut vehicle, Actuation::Disarmed, 0);
        assert!(!vehicle.is_in_force(NOW));
    }
}

#[test]
fn f69_zeroed_words_without_an_earlier_stop_raise_none() {
    let switch = switch();
    let mut vehicle = VehicleStop::new(switch.clone());
    switch.words.iter().for_each(|word| word.store(0, Ordering::Release));
    assert!(!vehicle.is_in_force(NOW) && !ControllerStop::new(switch).is_newly_raised());
}

#[test]
fn overwritten_words_confirm_no_stop() {
    let switch = switch();
    switch.words[0].store(0x9000_0005, Ordering::Release);
    let number = switch.raise();
    assert_eq!(switch.report(number), StopReport::default());
}
