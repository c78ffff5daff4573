use nalgebra::Vector3;
use oqtal_bus::code::ReferenceKind;
use oqtal_control::quaternion::Attitude;

use super::*;

const START: Time = Time::VIRTUAL_START;

fn stream() -> ReferenceStream {
    ReferenceStream::new(&Config::default())
}

fn room(floor_m: f64) -> StoppingRoom {
    let mut room = StoppingRoom::new(&Config::default());
    room.begin_flight(floor_m);
    room
}

fn at(millis: i64) -> Time {
    START + Span::from_millis(millis)
}

/// A reference at x = 0.5 m/s times the time since the start, at 1 m, valid for two periods of 60 Hz.
fn sample(millis: i64) -> ReferenceV1 {
    ReferenceV1 {
        time: at(millis),
        valid_until: at(millis + 33),
        kind: ReferenceKind::Position.code(),
        position: [0.5e-3 * millis as f64, 0.0, 1.0],
        velocity: [0.5, 0.0, 0.0],
        ..ReferenceV1::default()
    }
}

fn present() -> ReferenceMotion {
    ReferenceMotion { value: [0.0, 0.0, 1.0, 0.0].into(), ..ReferenceMotion::default() }
}

#[test]
fn f35_between_two_references_the_last_is_extrapolated_until_its_validity_ends() {
    let mut stream = stream();
    stream.receive(at(0), (7, &sample(0)), Some((&present(), 0.0, &room(0.0))));
    let reference = stream.reference(at(20)).unwrap();
    assert!((reference.position - Vector3::new(0.01, 0.0, 1.0)).norm() < 1e-12);
    assert!(!stream.expire(at(33)) && stream.expire(at(34)));
    assert_eq!((stream.reference(at(34)), stream.ended(at(40))), (None, [true, false]));
    assert_eq!(stream.ended(at(34 + 5000)), [true, true]);
    stream.receive(at(60), (7, &sample(60)), Some((&present(), 0.0, &room(0.0))));
    assert_eq!(stream.ended(at(60)), [false, false]);
}

#[test]
fn f35_references_whose_heading_the_vehicle_does_not_follow_are_refused() {
    let mut stream = stream();
    stream.receive(at(0), (7, &sample(0)), Some((&present(), 0.7, &room(0.0))));
    assert!(stream.take_refusal().is_none() && stream.is_followed());
    stream.receive(at(10), (7, &sample(10)), Some((&present(), 0.9, &room(0.0))));
    let refusal = stream.take_refusal().unwrap().to_string();
    assert!(refusal.contains("from that of the vehicle 51.57 deg exceeds"), "{refusal}");
}

#[test]
fn f35_a_planners_reference_beyond_a_limit_leaves_the_last_valid_one_in_force() {
    let good = sample(10);
    let attitude =
        |attitude| ReferenceV1 { kind: ReferenceKind::Attitude.code(), attitude, ..good };
    let wrong = [
        ("is not a number", ReferenceV1 { position: [f64::NAN, 0.0, 1.0], ..good }),
        ("turn from the present heading 170.00 deg", {
            let half_rad = 85_f64.to_radians();
            attitude([0.0, 0.0, half_rad.sin(), half_rad.cos()])
        }),
        (
            "rate about an axis 30.00 rad/s exceeds",
            ReferenceV1 { rate: [30.0, 0.0, 0.0], ..attitude([0.0, 0.0, 0.0, 1.0]) },
        ),
        (
            "0.99 m exceeds reference.jump-limit-m",
            ReferenceV1 { position: [1.0, 0.0, 1.0], ..good },
        ),
        ("speed 9.00 m/s exceeds", ReferenceV1 { velocity: [9.0, 0.0, 0.0], ..good }),
        ("acceleration 20.00 m/s^2", ReferenceV1 { acceleration: [0.0, 0.0, 20.0], ..good }),
        ("is not a number", ReferenceV1 { jerk: [f64::INFINITY, 0.0, 0.0], ..good }),
        ("jerk 99.00 m/s^3 exceeds 10 x", ReferenceV1 { jerk: [0.0, 99.0, 0.0], ..good }),
        ("heading is not a number", ReferenceV1 { yaw: f64::NAN, ..good }),
        ("heading 60.16 deg exceeds the greatest turn", ReferenceV1 { yaw: 1.05, ..good }),
        ("yaw rate 20.00 rad/s exceeds", ReferenceV1 { yaw_rate: -20.0, ..good }),
        ("validity is over", ReferenceV1 { valid_until: at(9), ..good }),
        ("ms exceeds reference.longest-validity-ms = 500", ReferenceV1 { time: at(-2000), ..good }),
        ("kind is unknown", ReferenceV1 { kind: 9, ..good }),
        ("not a rotation", attitude([0.0; 4])),
        ("tilt 180.00 deg exceeds position.tilt-limit-deg = 15", attitude([1.0, 0.0, 0.0, 0.0])),
    ];
    for (reason, message) in wrong {
        let mut stream = stream();
        stream.receive(at(0), (7, &sample(0)), Some((&present(), 0.0, &room(0.0))));
        let before = stream.reference(at(10)).unwrap();
        let flown = stream.motion(at(10)).unwrap();
        stream.receive(at(10), (7, &message), Some((&flown, 0.0, &room(0.0))));
        let told = stream.take_refusal().map(|refusal| refusal.to_string());
        assert!(told.as_ref().is_some_and(|told| told.contains(reason)), "{told:?}: {message:?}");
        assert_eq!(stream.reference(at(10)), Some(before), "{message:?}");
    }
}

#[test]
fn f35_an_attitude_turns_on_to_the_tilt_limit_and_a_reference_near_the_floor_is_refused() {
    let mut stream = stream();
    let message = ReferenceV1 {
        kind: ReferenceKind::Attitude.code(),
        attitude: [0.0, 0.0, 0.0, 1.0],
        rate: [1.0, 0.0, 0.0],
        valid_until: at(500),
        ..sample(0)
    };
    stream.receive(at(0), (7, &message), Some((&present(), 0.0, &room(0.0))));
    let limit_rad = stream.limits.least_upright.acos();
    for millis in [0, 20, 200, 450] {
        let attitude = stream.reference(at(millis)).unwrap().attitude.unwrap();
        let turned_rad = attitude.attitude.angle_to(&Attitude::default());
        let expected_rad = (1e-3 * millis as f64).min(limit_rad);
        assert!((turned_rad - expected_rad).abs() < 2e-3, "{millis} ms: {turned_rad}");
        assert_eq!(attitude.rate.0.x == 0.0, expected_rad == limit_rad, "{millis} ms");
    }
    stream.receive(at(1), (7, &sample(1)), Some((&present(), 0.0, &room(0.95))));
    let refusal = stream.take_refusal().unwrap();
    assert!(refusal.to_string().contains("above the floor"), "{refusal}");
}

#[test]
fn an_operator_ends_a_stream_until_its_planner_pauses() {
    let mut stream = stream();
    stream.receive(at(0), (7, &sample(0)), Some((&present(), 0.0, &room(0.0))));
    stream.end();
    for millis in [10, 400, 800] {
        stream.receive(at(millis), (7, &sample(millis)), Some((&present(), 0.0, &room(0.0))));
        assert!(!stream.is_followed());
    }
    for millis in [1000, 1300] {
        stream.receive(at(millis), (7, &sample(millis)), None);
        // The next flight begins meanwhile.
        stream.reset();
    }
    stream.receive(at(1500), (7, &sample(1500)), Some((&present(), 0.0, &room(0.0))));
    assert!(!stream.is_followed(), "a reference that cannot be followed is not a pause");
    let resting = ReferenceV1 { position: [0.0, 0.0, 1.0], ..sample(2100) };
    stream.receive(at(2100), (7, &resting), Some((&present(), 0.0, &room(0.0))));
    assert!(stream.is_followed(), "it paused");
    stream.end();
    let other = ReferenceV1 { time: at(2110), ..resting };
    stream.receive(at(2110), (8, &other), Some((&present(), 0.0, &room(0.0))));
    assert!(stream.is_followed(), "another planner");
}

#[test]
fn f35_a_slow_planner_does_not_take_the_vehicle_back_within_one_validity() {
    let validity = oqtal_config::Setting::flag("test", "reference.longest-validity-ms", 1500);
    let mut stream = ReferenceStream::new(&Config::from_settings(&[validity]).unwrap());
    let resting = |millis| ReferenceV1 { position: [0.0, 0.0, 1.0], ..sample(millis) };
    stream.receive(at(0), (7, &resting(0)), Some((&present(), 0.0, &room(0.0))));
    stream.end();
    for millis in [1000, 2000, 3400] {
        stream.receive(at(millis), (7, &resting(millis)), Some((&present(), 0.0, &room(0.0))));
        assert!(!stream.is_followed(), "{millis} ms");
    }
    stream.receive(at(4950), (7, &resting(4950)), Some((&present(), 0.0, &room(0.0))));
    assert!(stream.is_followed(), "it paused");
}

#[test]
fn a_planners_attitude_may_turn_on_step_by_step() {
    let mut stream = stream();
    for step in 0..24_i64 {
        let (now, half_rad) = (at(16 * step), (2.5 * step as f64).to_radians());
        let attitude = [0.0, 0.0, half_rad.sin(), half_rad.cos()];
        let kind = ReferenceKind::Attitude.code();
        let message = ReferenceV1 { kind, attitude, velocity: [0.0; 3], ..sample(16 * step) };
        let flown = stream.motion(now).unwrap_or(present());
        stream.receive(now, (7, &message), Some((&flown, flown.value.w, &room(0.0))));
        assert_eq!(stream.take_refusal(), None, "{step}");
    }
}

/// Beside a number of many turns a heading is lost in the rounding.
#[test]
fn a_heading_of_many_turns_is_the_same_heading_within_half_a_turn() {
    let yaw = 99_999_999_999_999_760.0; // 0.0007 rad
    for (heading_rad, is_followed) in [(0.1, true), (3.0, false)] {
        let mut stream = stream();
        let flown = ReferenceMotion { value: [0.0, 0.0, 1.0, heading_rad].into(), ..present() };
        let message = ReferenceV1 { yaw, ..sample(0) };
        stream.receive(at(0), (7, &message), Some((&flown, heading_rad, &room(0.0))));
        assert_eq!(stream.is_followed(), is_followed, "{heading_rad}: {:?}", stream.refusal);
        assert!(stream.motion(at(0)).is_none_or(|motion| motion.value.w.abs() < 1e-3));
    }
}

/// The attitude that is flown now counts, not that of the time stamp.
#[test]
fn an_attitude_that_has_turned_too_far_since_its_time_stamp_is_refused() {
    let yaw = |deg: f64| {
        let half_rad = (deg / 2.0).to_radians();
        [0.0, 0.0, half_rad.sin(), half_rad.cos()]
    };
    let turning = ReferenceV1 {
        kind: ReferenceKind::Attitude.code(),
        attitude: yaw(43.0),
        rate: [0.0, 0.0, 2.0],
        valid_until: at(450),
        velocity: [0.0; 3],
        ..sample(0)
    };
    let mut stream = stream();
    stream.receive(at(400), (7, &turning), Some((&present(), 0.0, &room(0.0))));
    assert!(stream.take_refusal().is_some_and(|refusal| refusal.to_string().contains("heading")));
    let resting = ReferenceV1 { attitude: yaw(0.0), ..turning };
    stream.receive(at(0), (7, &resting), Some((&present(), 0.0, &room(0.0))));
    // The heading at which the vehicle stays is the one that was flown.
    let flown = stream.motion(at(200)).unwrap().value.w;
    assert!((flown - 0.4).abs() < 1e-9, "{flown}");
}
