//! Planners, requests and limits near the borders of a room: every vehicle must land, and none may be stopped in the air.

use nalgebra::Vector3;
use oqtal_bus::code::{Cause, OperatorCommand, ReferenceKind};
use oqtal_bus::message::{ControlRequestV1, ReferenceV1};
use oqtal_bus::time::Span;
use oqtal_lab::simulation::online::OnlineFlight;
use oqtal_observe::flight::Outcome;

use super::{fly_for, goto, hover, is_done, last, request};
use crate::Draw;

/// A room of 5 m by 5 m by 3 m.
const ROOM: [&str; 4] = [
    "fence.x-m=[-2.5, 2.5]",
    "fence.y-m=[-2.5, 2.5]",
    "fence.z-m=[-0.5, 3.0]",
    "fence.soft-margin-m=0.5",
];
/// A room of 3 m by 3 m by 2 m.
const SMALL_ROOM: [&str; 4] = [
    "fence.x-m=[-1.5, 1.5]",
    "fence.y-m=[-1.5, 1.5]",
    "fence.z-m=[-0.2, 2.0]",
    "fence.soft-margin-m=0.3",
];
/// Time in which planners reach their speed \[s\].
const RISE_S: f64 = 1.0;

/// A planner's reference at `t_s` \[s\] that leaves `start` \[m, world\] at rest and moves with `velocity` \[m/s, world\] after [`RISE_S`].
fn away(t_s: f64, start: Vector3<f64>, velocity: Vector3<f64>) -> ReferenceV1 {
    let rising_s = t_s.min(RISE_S);
    let way_s = 0.5 * rising_s.powi(2) / RISE_S + (t_s - rising_s);
    let acceleration = if t_s < RISE_S { velocity / RISE_S } else { Vector3::zeros() };
    ReferenceV1 {
        kind: ReferenceKind::Position.code(),
        position: (start + velocity * way_s).into(),
        velocity: (velocity * (rising_s / RISE_S)).into(),
        acceleration: acceleration.into(),
        ..ReferenceV1::default()
    }
}

/// A planner's attitude, tilted by `tilt_deg` \[deg\] about the horizontal axis at `axis_rad` \[rad\].
fn tilted(tilt_deg: f64, axis_rad: f64) -> ReferenceV1 {
    let (sine, cosine) = (0.5 * tilt_deg.to_radians()).sin_cos();
    ReferenceV1 {
        kind: ReferenceKind::Attitude.code(),
        position: [0.0, 0.0, 1.0],
        attitude: [sine * axis_rad.cos(), sine * axis_rad.sin(), 0.0, cosine],
        ..ReferenceV1::default()
    }
}

/// Publishes references at `rate_hz` \[Hz\], valid for `valid` periods, for `seconds` \[s\].
fn stream(
    flight: &mut OnlineFlight<'_>,
    (rate_hz, valid): (f64, f64),
    seconds: f64,
    mut reference: impl FnMut(f64) -> ReferenceV1,
) {
    let period = Span::from_seconds(1.0 / rate_hz);
    flight.pause_every(period);
    // The next pause is still one of the period before.
    flight.advance().unwrap();
    let began = flight.now();
    while flight.now().since(began).seconds() < seconds {
        let now = flight.now();
        let message = reference(now.since(began).seconds());
        let message = ReferenceV1 { time: now, valid_until: now + period.scaled(valid), ..message };
        flight.publish(message).unwrap();
        if !flight.advance().unwrap() {
            break;
        }
    }
    flight.pause_every(Span::from_millis(250));
}

/// The outcome of a flight under `law` in `room` of which `planner` takes over after the take-off, and which nobody lands.
fn outcome(law: &str, room: &[&str], planner: impl FnOnce(&mut OnlineFlight<'_>)) -> Outcome {
    let law = format!("control.controller={law}");
    let mission = hover(10.0, &[&[&law, "reference.land-after-ms=1000"], room].concat());
    let mut flight = OnlineFlight::begin(&mission).unwrap();
    fly_for(&mut flight, 6.0);
    flight.end_after(Span::from_millis(60_000));
    planner(&mut flight);
    flight.finish().unwrap().outcome
}

#[test]
fn f35_planners_that_fly_towards_a_border_and_end_lose_no_vehicle() {
    let directions = [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.7, 0.5, -0.5]];
    let rates = [(60.0, 2.0), (10.0, 2.0), (60.0, 30.0)];
    for law in ["oqtal", "oqtal-dt", "mpc"] {
        for (towards, rate) in directions.into_iter().flat_map(|way| rates.map(|rate| (way, rate)))
        {
            for (speed, ends_s) in [(0.5, 9.0), (1.0, 1.5), (2.0, 1.2), (2.0, 9.0)] {
                let velocity = Vector3::from(towards) * speed;
                let found = outcome(law, &ROOM, |flight| {
                    let start = Vector3::from(last(flight).reference_position);
                    stream(flight, rate, ends_s, |t_s| away(t_s, start, velocity));
                });
                let told = format!("{law}, {velocity:?}, {rate:?}, for {ends_s} s");
                assert_eq!(found, Outcome::Landed, "{told}");
            }
        }
    }
}

#[test]
fn f47_a_prescribed_attitude_is_ended_early_enough_before_a_border() {
    for law in ["oqtal", "oqtal-dt", "mpc"] {
        for room in [&[][..], &ROOM, &SMALL_ROOM] {
            for tilt_deg in [4.0, 9.0, 14.9] {
                for (axis_rad, rate_hz) in [(0.0, 60.0), (2.4, 10.0)] {
                    let found = outcome(law, room, |flight| {
                        let planned = tilted(tilt_deg, axis_rad);
                        stream(flight, (rate_hz, 3.0), 8.0, |_| planned);
                    });
                    let told = format!("{law}, {room:?}, {tilt_deg} deg, {rate_hz} Hz");
                    assert_eq!(found, Outcome::Landed, "{told}");
                }
            }
        }
    }
}

#[test]
fn a_hover_near_the_floor_stops_above_it_whatever_the_limit_of_the_acceleration() {
    for (law, limit) in
        ["oqtal", "oqtal-dt"].into_iter().flat_map(|law| [0.05, 0.1, 0.3, 1.0].map(|it| (law, it)))
    {
        let mission = hover(10.0, &[&format!("control.controller={law}")]);
        let mut flight = OnlineFlight::begin(&mission).unwrap();
        fly_for(&mut flight, 6.0);
        flight.end_after(Span::from_millis(90_000));
        let down = goto([0.0, 0.0, 0.15]);
        assert!(is_done(&flight.change(OperatorCommand::Goto, &down).unwrap().unwrap()));
        flight.pause_every(Span::from_millis(20));
        while last(&flight).position[2] > 0.5 {
            assert!(flight.advance().unwrap());
        }
        let from = flight.samples().len();
        let set = request(&format!("reference.leg-acceleration-m-s2={limit}"));
        flight.change(OperatorCommand::Set, &set).unwrap().ok();
        let stop = ControlRequestV1::of(OperatorCommand::Hover);
        assert!(is_done(&flight.change(OperatorCommand::Hover, &stop).unwrap().unwrap()));
        fly_for(&mut flight, 20.0);
        let heights = flight.samples()[from..].iter().map(|sample| sample.telemetry.position[2]);
        let lowest = heights.fold(f64::INFINITY, f64::min);
        assert!(lowest > 0.1, "{law}, {limit} m/s^2: {lowest} m");
        assert!(flight.request(OperatorCommand::Land).unwrap());
        assert_eq!(flight.finish().unwrap().outcome, Outcome::Landed, "{law}, {limit} m/s^2");
    }
}

/// The state names the reason while the planner sends, and the end of the references afterwards.
#[test]
fn f35_of_references_that_are_refused_after_the_end_of_others_the_refusal_is_the_cause() {
    let found = outcome("oqtal", &["reference.land-after-ms=4000"], |flight| {
        let at = Vector3::from(last(flight).reference_position);
        stream(flight, (60.0, 2.0), 1.0, |_| away(0.0, at, Vector3::zeros()));
        fly_for(flight, 0.5);
        assert_eq!(last(flight).cause, Cause::ReferencesEnded.code());
        stream(flight, (10.0, 2.0), 1.0, |_| away(0.0, at, Vector3::x() * 9.0));
        let far = at + Vector3::x() * 9.0;
        stream(flight, (10.0, 2.0), 1.0, |_| away(0.0, far, Vector3::zeros()));
        assert_eq!(last(flight).cause, Cause::Setpoint.code());
        fly_for(flight, 1.0);
        assert_eq!(last(flight).cause, Cause::ReferencesEnded.code());
    });
    assert_eq!(found, Outcome::Landed);
}

/// A planner that flies to random points, with noise, jumps and numbers that are none.
fn wild(draw: &mut Draw, flight: &mut OnlineFlight<'_>) {
    let rate_hz = [10.0, 60.0, 240.0][(3.0 * draw.next()) as usize];
    let speed = [0.5, 1.2, 2.4][(3.0 * draw.next()) as usize];
    let target = Vector3::from_fn(|axis, _| [10.0, 10.0, 4.0][axis] * (draw.next() - 0.4));
    let (kind, valid, seconds) = (draw.next(), 1.5 + 20.0 * draw.next().powi(4), 4.0 * draw.next());
    let mut position = Vector3::from(last(flight).reference_position);
    let mut velocity = Vector3::zeros();
    stream(flight, (rate_hz, valid), seconds, |_| {
        let change =
            ((target - position).cap_magnitude(speed) - velocity).cap_magnitude(4.0 / rate_hz);
        position += (velocity + change * 0.5) / rate_hz;
        velocity += change;
        let mut message = ReferenceV1 { velocity: velocity.into(), ..away(0.0, position, change) };
        match kind {
            0.0..0.3 => message.acceleration = (change * rate_hz).into(),
            0.3..0.6 => {
                for axis in 0..3 {
                    message.position[axis] += 0.2 * (draw.next() - 0.5);
                    message.velocity[axis] += draw.next() - 0.5;
                    message.acceleration[axis] += 6.0 * (draw.next() - 0.5);
                    message.jerk[axis] = 30.0 * (draw.next() - 0.5);
                }
            }
            0.6..0.8 => {
                message.position[0] += [f64::NAN, 2.0, -0.2, 0.0][(4.0 * draw.next()) as usize]
            }
            _ if draw.next() < 0.5 => message = tilted(14.0 * draw.next(), target.x),
            _ => {}
        }
        message
    });
}

/// Requests and planners at any time, in a small room.
#[test]
fn f47_requests_and_planners_at_random_in_a_small_room_lose_no_vehicle() {
    let laws = ["oqtal", "oqtal-dt", "mpc", "geometric", "pid", "lqr"];
    let sets = [
        "reference.leg-acceleration-m-s2=0.05",
        "reference.leg-acceleration-m-s2=5.0",
        "reference.leg-horizontal-m-s=2.0 reference.leg-vertical-m-s=1.5",
        "position.vertical-acceleration-limit-m-s2=2.0",
    ];
    for seed in 0..60 {
        let mut draw = Draw(seed);
        let law = laws[seed as usize % laws.len()];
        let found = outcome(law, &SMALL_ROOM, |flight| {
            let until = flight.now() + Span::from_seconds(20.0);
            while flight.now() < until && flight.advance().unwrap() {
                let point = [3.0, 3.0, 2.5].map(|wide| wide * (draw.next() - 0.4));
                let of = ControlRequestV1::of;
                let (command, request) = match (8.0 * draw.next()) as u32 {
                    0 => (OperatorCommand::Goto, goto(point)),
                    1 => (OperatorCommand::Hover, of(OperatorCommand::Hover)),
                    2 => (OperatorCommand::Set, request(draw.one(&sets))),
                    _ => {
                        wild(&mut draw, flight);
                        continue;
                    }
                };
                // Some are refused.
                let _ = flight.change(command, &request).unwrap();
                fly_for(flight, 2.0 * draw.next());
            }
            assert!(flight.request(OperatorCommand::Land).is_ok());
        });
        assert_eq!(found, Outcome::Landed, "{law}, seed {seed}");
    }
}
