//! Planners, requests and limits near the borders of small rooms: every vehicle must land, and none may be stopped in the air.

use nalgebra::Vector3;
use oqtal_bus::code::{OperatorCommand, ReferenceKind};
use oqtal_bus::message::{ControlRequestV1, ReferenceV1};
use oqtal_bus::time::Span;
use oqtal_lab::mission::Mission;
use oqtal_lab::simulation::online::OnlineFlight;
use oqtal_observe::flight::Outcome;

use super::{fly_for, goto, hover, is_done, last, request};

/// A room of 5 m by 5 m by 3 m.
const ROOM: [&str; 4] = [
    "fence.x-m=[-2.5, 2.5]",
    "fence.y-m=[-2.5, 2.5]",
    "fence.z-m=[-0.5, 3.0]",
    "fence.soft-margin-m=0.5",
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

#[test]
fn f35_planners_that_end_in_flight_near_a_border_land() {
    let mut lost = Vec::new();
    let mut flown = 0;
    for law in ["oqtal", "oqtal-dt", "mpc", "geometric", "pid"] {
        let law = format!("control.controller={law}");
        let mission = hover(10.0, &[&ROOM[..], &[&law, "reference.land-after-ms=1000"]].concat());
        for towards in [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.7, 0.5, -0.5]] {
            for speed in [0.5, 1.0, 2.0] {
                for (rate_hz, valid) in [(60.0, 2.0), (10.0, 2.0), (60.0, 30.0), (240.0, 2.0)] {
                    for dies_s in [1.2, 1.6, 9.0] {
                    let mut flight = OnlineFlight::begin(&mission).unwrap();
                    fly_for(&mut flight, 6.0);
                    flight.end_after(Span::from_millis(40_000));
                    let start = Vector3::from(last(&flight).reference_position);
                    let velocity = Vector3::from(towards) * speed;
                    stream(&mut flight, (rate_hz, valid), dies_s, |t_s| away(t_s, start, velocity));
                    let outcome = flight.finish().unwrap().outcome;
                    flown += 1;
                    if outcome != Outcome::Landed {
                        lost.push(format!("{law} {towards:?} {speed} {rate_hz} {valid} dies {dies_s}: {outcome:?}"));
                    }
                    }
                }
            }
        }
    }
    println!("{}", lost.join("\n"));
    println!("{} of {flown} lost", lost.len());
}

/// A planner's level attitude, tilted by `tilt_rad` \[rad\] about the horizontal axis at `about_rad` \[rad\].
fn tilted(tilt_rad: f64, about_rad: f64, height: f64) -> ReferenceV1 {
    let (sine, cosine) = (0.5 * tilt_rad).sin_cos();
    ReferenceV1 {
        kind: ReferenceKind::Attitude.code(),
        position: [0.0, 0.0, height],
        attitude: [sine * about_rad.cos(), sine * about_rad.sin(), 0.0, cosine],
        ..ReferenceV1::default()
    }
}

#[test]
fn f47_prescribed_attitudes_lead_to_the_border_and_the_vehicle_is_held_before_it() {
    let mut lost = Vec::new();
    let mut flown = 0;
    for law in ["oqtal", "oqtal-dt", "mpc", "geometric", "pid", "lqr"] {
        for room in [&[][..], &ROOM[..]] {
            let law = format!("control.controller={law}");
            let mission = hover(10.0, &[room, &[&law, "reference.land-after-ms=1000"]].concat());
            for tilt_deg in [4.0_f64, 9.0, 14.9] {
                for about in [0.0, 2.4] {
                    for rate_hz in [60.0, 10.0] {
                    let mut flight = OnlineFlight::begin(&mission).unwrap();
                    fly_for(&mut flight, 6.0);
                    flight.end_after(Span::from_millis(60_000));
                    let height = last(&flight).reference_position[2];
                    stream(&mut flight, (rate_hz, 3.0), 8.0, |_| tilted(tilt_deg.to_radians(), about, height));
                    let far = flight.samples().iter().map(|s| Vector3::from(s.telemetry.position).xy().amax()).fold(0.0, f64::max);
                    let outcome = flight.finish().unwrap().outcome;
                    flown += 1;
                    println!("{law} {} {tilt_deg} {about} {rate_hz}: {far:.2} {outcome:?}", room.len());
                    if outcome != Outcome::Landed {
                        lost.push(format!("{law} {} {tilt_deg} {about} {rate_hz}: {outcome:?}", room.len()));
                    }
                    }
                }
            }
        }
    }
    println!("{}", lost.join("\n"));
    println!("{} of {flown} lost", lost.len());
}

#[test]
fn a_hover_near_the_floor_stops_above_it_whatever_the_limit_of_the_acceleration() {
    let mut lost = Vec::new();
    let mut flown = 0;
    for law in ["oqtal", "oqtal-dt"] {
        for limit in [0.05, 0.1, 0.3, 1.0] {
            let law = format!("control.controller={law}");
            let mission: Mission = hover(10.0, &[&law]);
            let mut flight = OnlineFlight::begin(&mission).unwrap();
            fly_for(&mut flight, 6.0);
            flight.end_after(Span::from_millis(90_000));
            assert!(is_done(&flight.change(OperatorCommand::Goto, &goto([0.0, 0.0, 0.15])).unwrap().unwrap()));
            flight.pause_every(Span::from_millis(20));
            while last(&flight).position[2] > 0.5 {
                assert!(flight.advance().unwrap());
            }
            let set = request(&format!("reference.leg-acceleration-m-s2={limit}"));
            flight.change(OperatorCommand::Set, &set).unwrap().ok();
            let stop = ControlRequestV1::of(OperatorCommand::Hover);
            assert!(is_done(&flight.change(OperatorCommand::Hover, &stop).unwrap().unwrap()));
            flight.pause_every(Span::from_millis(250));
            fly_for(&mut flight, 20.0);
            let low = flight.samples().iter().skip(400).map(|s| s.telemetry.position[2]).fold(9.0, f64::min);
            flight.request(OperatorCommand::Land).unwrap();
            let outcome = flight.finish().unwrap().outcome;
            flown += 1;
            println!("{law} {limit}: {low:.2} {outcome:?}");
            if outcome != Outcome::Landed {
                lost.push(format!("{law} {limit}: {outcome:?}"));
            }
        }
    }
    println!("{} of {flown} lost", lost.len());
}
