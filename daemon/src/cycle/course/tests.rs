use oqtal_bus::code::ReferenceKind;

use super::*;

fn course() -> (Config, FlightCourse) {
    let config = Config::default();
    let trajectory = crate::trajectory(&config).unwrap();
    let course = FlightCourse::new(&config, trajectory, Fence::new(&config.fence));
    (config, course)
}

/// A course one second into its trajectory: that instant, and the position of the reference.
fn flying() -> (FlightCourse, Time, Vector3<f64>) {
    let (config, mut course) = course();
    let start = Time::VIRTUAL_START;
    course.begin_flight(start, &Estimate::default());
    let now = start + Span::from_seconds(config.trajectory.start_s() + 1.0);
    course.update_setpoint(now);
    let position = course.setpoint().reference.unwrap().position;
    (course, now, position)
}

/// A planner's reference at `position`, which moves along x at `velocity` \[m/s\].
fn message(now: Time, position: Vector3<f64>, velocity: f64) -> ReferenceV1 {
    ReferenceV1 {
        time: now,
        valid_until: now + Span::from_millis(100),
        kind: ReferenceKind::Position.code(),
        position: position.into(),
        velocity: [velocity, 0.0, 0.0],
        ..ReferenceV1::default()
    }
}

#[test]
fn f41_a_vehicle_has_landed_once_it_rests_for_half_a_second_without_a_break() {
    let (config, mut course) = course();
    let start = Time::VIRTUAL_START;
    let (raised, rising) = (Vector3::z(), Vector3::z() * 0.2);
    let at_rest = Estimate { position: raised, ..Estimate::default() };
    let moving = Estimate { velocity: rising, ..at_rest };
    course.begin_flight(start, &Estimate::default());
    course.land(start, raised);
    course.update_setpoint(start + Span::from_millis(100));
    let weight_n = config.vehicle.mass_kg * config.vehicle.gravity_m_s2;
    let mut has_landed = |millis, estimate, share: f64| {
        course.has_landed(start + Span::from_millis(millis), estimate, share * weight_n)
    };
    assert!(!has_landed(0, &at_rest, 0.4) && !has_landed(490, &at_rest, 0.4));
    assert!(!has_landed(495, &moving, 0.4), "moved");
    assert!(!has_landed(500, &at_rest, 0.4) && !has_landed(990, &at_rest, 0.4));
    assert!(!has_landed(995, &at_rest, 0.6), "held by its thrust");
    assert!(!has_landed(1000, &at_rest, 0.4) && !has_landed(1490, &at_rest, 0.4));
    assert!(has_landed(1500, &at_rest, 0.4));
}

/// The landing of the plan begins in the tick in which the vehicle must be held, and the hold does not end.
#[test]
fn f47_a_landing_that_begins_in_the_tick_of_a_hold_is_flown() {
    let (_, mut course) = course();
    let start = Time::VIRTUAL_START;
    course.begin_flight(start, &Estimate::default());
    let planned_s = course.mission().unwrap().planned_landing_s();
    let begun = start + Span::from_seconds(planned_s + 0.01);
    course.update_setpoint(begun);
    assert!(course.follow(begun, SafetyState::Hold, Vector3::z(), false));
    let later = begun + Span::from_millis(20_000);
    course.update_setpoint(later);
    assert!(course.follow(later, SafetyState::Land, Vector3::z(), true));
    assert!(course.setpoint().reference.unwrap().position.z < 0.0, "{:?}", course.setpoint());
    assert!(course.mission().unwrap().is_landing_overdue(later), "an end of its own");
}

/// A hold interrupts a planner, and does not end its stream as an operator does.
#[test]
fn f47_a_planner_continues_after_a_hold_and_until_then_the_plan_is_the_stop() {
    let (mut course, now, position) = flying();
    course.receive_reference(now, (7, &message(now, position, 0.0)), Some(0.0));
    assert_eq!(course.followed(now), Followed::Planner);
    course.follow(now, SafetyState::Hold, position, false);
    assert_eq!(course.followed(now), Followed::Ended);
    let later = now + Span::from_millis(100);
    course.update_setpoint(later);
    course.follow(later, SafetyState::Nominal, position, false);
    course.receive_reference(later, (7, &message(later, position, 0.0)), Some(0.0));
    assert_eq!(course.followed(later), Followed::Planner);
}

#[test]
fn f35_a_planner_that_does_not_pause_is_not_followed_in_the_next_flight() {
    let (mut course, now, position) = flying();
    let receive = |course: &mut FlightCourse, after_ms: i64| {
        let at = now + Span::from_millis(after_ms);
        course.receive_reference(at, (7, &message(at, position, 0.0)), Some(0.0));
        course.followed(at)
    };
    assert_eq!(receive(&mut course, 0), Followed::Planner);
    course.end();
    assert_eq!(receive(&mut course, 400), Followed::Course, "no flight");
    let again = now + Span::from_millis(500);
    let estimate = Estimate { position, ..Estimate::default() };
    course.begin_flight(again, &estimate);
    (1..=70).for_each(|k| {
        assert_eq!(receive(&mut course, 500 + 100 * k), Followed::Ignored, "{k}");
    });
    assert_eq!(course.followed(now + Span::from_millis(8100)), Followed::Course);
    let paused = now + Span::from_millis(8200);
    course.update_setpoint(paused);
    let near = course.setpoint().reference.unwrap().position;
    course.receive_reference(paused, (7, &message(paused, near, 0.0)), Some(0.0));
    assert_eq!(course.followed(paused), Followed::Planner);
}

/// While a reference is refused, the one before is followed, also at the effect of a command.
#[test]
fn f35_a_refused_reference_leaves_that_of_the_effect_of_a_command_on_its_way() {
    let (mut course, now, position) = flying();
    course.receive_reference(now, (7, &message(now, position, 0.5)), Some(0.0));
    course.receive_reference(now, (7, &message(now, position, 9.0)), Some(0.0));
    course.update_setpoint(now);
    assert!(course.setpoint().refusal.is_some());
    let ahead = course.reference_at(now + Span::from_millis(40), 0.1).unwrap();
    assert!((ahead.position.x - position.x - 0.02).abs() < 1e-9, "{ahead:?}");
    let turned_rad = ahead.yaw_rad - course.setpoint().reference.unwrap().yaw_rad;
    assert!((turned_rad - 0.1).abs() < 1e-9, "{turned_rad}");
}

/// A vehicle below its reference must not touch the floor under an external law either.
#[test]
fn the_reference_of_the_effect_of_a_command_is_raised_like_that_of_the_tick() {
    let (config, mut course) = course();
    let start = Time::VIRTUAL_START;
    course.begin_flight(start, &Estimate::default());
    let flying = start + Span::from_seconds(config.trajectory.start_s() + 1.0);
    let low = Estimate { position: Vector3::z() * 0.7, ..Estimate::default() };
    for tick in 0..300 {
        let now = flying + Span::from_millis(16 * tick);
        course.begin_tick(now, &low, false);
        course.room.begin_flight(0.9);
        course.update_setpoint(now);
        let flown = course.setpoint().reference.unwrap();
        assert_eq!(course.reference_at(now, 0.0), Some(flown));
    }
    assert!(course.setpoint().reference.unwrap().position.z > 1.1);
}
