//! Random flights under planners that jump, reverse, prescribe attitudes and give wrong derivatives, with requests in between, in rooms
//! of several shapes: no vehicle is lost. `OQTAL_TEST_PLANNER_RUNS` flies more of them, from the seed `OQTAL_TEST_PLANNER_FROM` on.

use nalgebra::Vector3;
use oqtal_bus::code::{Mode, OperatorCommand, ReferenceKind};
use oqtal_bus::message::{ControlRequestV1, ReferenceV1};
use oqtal_bus::time::Span;
use oqtal_lab::simulation::online::OnlineFlight;
use oqtal_observe::flight::Outcome;

use super::{fly_for, goto, hover, last, request};
use crate::Draw;

/// Greatest acceleration of a planner \[m/s^2\], and the distance from the flown reference at which it begins again \[m\].
const ACCELERATION_M_S2: f64 = 4.0;
const LEASH_M: f64 = 0.4;

const LAWS: [&str; 6] = ["oqtal", "oqtal-dt", "mpc", "geometric", "pid", "lqr"];
const ROOMS: [&str; 4] = [
    "",
    "fence.x-m=[-1.5,1.5] fence.y-m=[-1.5,1.5] fence.z-m=[-0.2,2] fence.soft-margin-m=0.3",
    "fence.x-m=[-4,4] fence.y-m=[-2,2] fence.z-m=[-0.5,1.6] fence.soft-margin-m=0.4",
    "fence.polygon-m=[[-3,-2],[3,-2],[1.5,2.5],[-3,2.5]] fence.z-m=[-0.1,2.5] fence.soft-margin-m=0.4",
];
const VEHICLES: [&str; 5] = [
    "",
    "plant.force-n=[0.2,0.1,0]",
    "plant.mass-kg=0.58",
    "vehicle.preset=crazyflie-2.1",
    "position.tilt-limit-deg=30 safety.speed-limit-m-s=6.0",
];
const SETTINGS: [&str; 8] = [
    "reference.leg-acceleration-m-s2=0.05",
    "reference.leg-acceleration-m-s2=5.0",
    "position.tilt-limit-deg=8",
    "position.tilt-limit-deg=20",
    "position.vertical-acceleration-limit-m-s2=2.0",
    "control.controller=oqtal-dt",
    "control.controller=pid",
    "control.controller=mpc",
];

/// The errors of a planner.
#[derive(Clone, Copy, Debug)]
enum Manner {
    Honest,
    WrongDerivatives,
    Jumps,
    Attitudes,
    Alternates,
    Reverses,
}

/// A planner that flies to a point.
#[derive(Debug)]
struct Planner {
    manner: Manner,
    target: Vector3<f64>,
    speed_m_s: f64,
    period: Span,
    valid_periods: f64,
    delay: Span,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
}

impl Planner {
    fn new(draw: &mut Draw, position: Vector3<f64>) -> Self {
        use Manner::{Alternates, Attitudes, Honest, Jumps, Reverses, WrongDerivatives};
        Self {
            manner: draw.one(&[Honest, WrongDerivatives, Jumps, Attitudes, Alternates, Reverses]),
            target: Vector3::from_fn(|axis, _| match axis {
                2 => draw.between(-1.0, 3.0),
                _ => draw.between(-5.0, 5.0),
            }),
            speed_m_s: draw.one(&[0.3, 0.7, 1.2, 2.0, 2.4]),
            period: Span::from_seconds(1.0 / draw.one(&[10.0, 60.0, 240.0])),
            valid_periods: draw.one(&[1.5, 2.0, 5.0, 30.0]),
            delay: Span::from_seconds(draw.one(&[0.0, 0.0, 0.03, 0.1])),
            position,
            velocity: Vector3::zeros(),
        }
    }

    /// The next reference, while `flown` is flown \[m, world\].
    fn next(&mut self, draw: &mut Draw, flown: Vector3<f64>) -> ReferenceV1 {
        let dt_s = self.period.seconds();
        let wanted = (self.target - self.position).cap_magnitude(self.speed_m_s);
        let change = (wanted - self.velocity).cap_magnitude(ACCELERATION_M_S2 * dt_s);
        self.position += (self.velocity + change / 2.0) * dt_s;
        self.velocity += change;
        if (flown - self.position).norm() > LEASH_M {
            (self.position, self.velocity) = (flown, Vector3::zeros());
        }
        let mut message = ReferenceV1 {
            kind: ReferenceKind::Position.code(),
            position: self.position.into(),
            velocity: self.velocity.into(),
            acceleration: (change / dt_s).into(),
            ..ReferenceV1::default()
        };
        self.spoil(draw, &mut message);
        message
    }

    fn spoil(&mut self, draw: &mut Draw, message: &mut ReferenceV1) {
        let chance = draw.next();
        let attitude = ReferenceKind::Attitude.code();
        match self.manner {
            Manner::WrongDerivatives => {
                for axis in 0..3 {
                    message.position[axis] += 0.2 * (draw.next() - 0.5);
                    message.velocity[axis] += draw.next() - 0.5;
                    message.acceleration[axis] += 6.0 * (draw.next() - 0.5);
                    message.jerk[axis] = 30.0 * (draw.next() - 0.5);
                }
            }
            Manner::Jumps if chance < 0.2 => message.position[0] = f64::NAN,
            Manner::Jumps if chance < 0.4 => message.velocity[1] = f64::INFINITY,
            Manner::Jumps if chance < 0.6 => message.position[0] += 2.0,
            Manner::Jumps => message.yaw = 6.0 * chance,
            Manner::Attitudes => {
                let (sin, cos) = (0.13 * chance).sin_cos();
                let (y, x) = self.target.x.sin_cos();
                (message.kind, message.attitude) = (attitude, [sin * x, sin * y, 0.0, cos]);
                message.rate = [0.5 * (draw.next() - 0.5); 3];
            }
            Manner::Alternates if chance < 0.3 => {
                (message.kind, message.attitude) = (attitude, [0.1, 0.0, 0.0, 0.99_f64.sqrt()]);
            }
            Manner::Reverses if chance < 0.05 => self.velocity = -self.velocity,
            _ => {}
        }
    }

    /// Publishes references for `seconds` \[s\]; `false` once the flight is over.
    fn fly(&mut self, draw: &mut Draw, flight: &mut OnlineFlight<'_>, seconds: f64) -> bool {
        flight.pause_every(self.period);
        let end = flight.now() + Span::from_seconds(seconds);
        while flight.now() < end {
            let mut message = self.next(draw, flown(flight));
            message.time = flight.now() - self.delay;
            message.valid_until = flight.now() + self.period.scaled(self.valid_periods);
            flight.publish(message).unwrap();
            if !flight.advance().unwrap() {
                return false;
            }
        }
        true
    }
}

/// The position of the reference that is flown \[m, world\].
fn flown(flight: &OnlineFlight<'_>) -> Vector3<f64> {
    let position = Vector3::from(last(flight).reference_position);
    if position.iter().all(|part| part.is_finite()) { position } else { Vector3::z() }
}

/// One change of the flight; returns what it was, or `None` once the flight is over.
fn change(draw: &mut Draw, flight: &mut OnlineFlight<'_>) -> Option<String> {
    let mut ask = |command, message: &ControlRequestV1| {
        // A refusal is as good as a change.
        let _ = flight.change(command, message).unwrap();
    };
    match (draw.next() * 8.0) as u32 {
        0 => {
            let point = [6.0 * (draw.next() - 0.5), 6.0 * (draw.next() - 0.5), 2.5 * draw.next()];
            ask(OperatorCommand::Goto, &goto(point));
            Some(format!("goto {point:.2?}"))
        }
        1 => {
            ask(OperatorCommand::Hover, &ControlRequestV1::of(OperatorCommand::Hover));
            Some("hover".to_owned())
        }
        2 => {
            let name = draw.one(&["circle", "square", "lemniscate", "step"]);
            ask(OperatorCommand::Trajectory, &request(name));
            Some(name.to_owned())
        }
        3 => {
            let setting = draw.one(&SETTINGS);
            ask(OperatorCommand::Set, &request(setting));
            Some(setting.to_owned())
        }
        _ => {
            let mut planner = Planner::new(draw, flown(flight));
            let (text, seconds) = (format!("{planner:.2?}"), 0.2 + 4.0 * draw.next());
            planner.fly(draw, flight, seconds).then(|| format!("{text} for {seconds:.2} s"))
        }
    }
}

/// Flies the flight of `seed`; returns its course unless the vehicle lands.
fn lost(seed: u64) -> Option<String> {
    let mut draw = Draw(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 77);
    let law = format!("control.controller={}", draw.one(&LAWS));
    let (room, vehicle) = (draw.one(&ROOMS), draw.one(&VEHICLES));
    let own = [law.as_str(), "trajectory.height-m=0.8", "reference.land-after-ms=1500"];
    let more = room.split_whitespace().chain(vehicle.split_whitespace());
    let settings: Vec<_> = own.into_iter().chain(more).collect();
    let mission = hover(10.0, &settings);
    let mut flight = OnlineFlight::begin(&mission).unwrap();
    fly_for(&mut flight, 6.0);
    flight.end_after(Span::from_millis(120_000));
    let end = flight.now() + Span::from_seconds(10.0 + 20.0 * draw.next());
    let mut course = vec![format!("seed {seed}: {settings:?}")];
    while flight.now() < end && last(&flight).mode != Mode::Disarmed.code() {
        let Some(text) = change(&mut draw, &mut flight) else { break };
        course.push(text);
        flight.pause_every(Span::from_millis(50));
        fly_for(&mut flight, 2.0 * draw.next());
        if !flight.advance().unwrap() {
            break;
        }
    }
    fly_for(&mut flight, 20.0);
    if last(&flight).mode != Mode::Disarmed.code() {
        flight.request(OperatorCommand::Land).unwrap();
    }
    flight.end_after(Span::from_millis(40_000));
    let flown = flight.finish().unwrap();
    course.push(format!("{:?} {:?}", flown.outcome, flown.crash));
    (flown.outcome != Outcome::Landed).then(|| course.join("\n    "))
}

#[test]
fn no_vehicle_is_lost_under_planners_that_are_wrong() {
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse::<u64>().unwrap());
    let from = number("OQTAL_TEST_PLANNER_FROM").unwrap_or(0);
    let runs = number("OQTAL_TEST_PLANNER_RUNS").unwrap_or(60);
    let lost: Vec<_> = (from..from + runs).filter_map(lost).collect();
    for course in &lost {
        println!("{course}");
    }
    assert!(lost.is_empty(), "{} of {runs} vehicles lost", lost.len());
}

/// Vehicles that accelerate outwards when the fence holds them, one that a hand-over kept oscillating, and one that brakes already.
#[test]
fn f47_vehicles_that_accelerate_towards_a_border_are_held() {
    let lost: Vec<_> =
        [245, 475, 2296, 102_826, 202_969, 301_255].into_iter().filter_map(lost).collect();
    assert!(lost.is_empty(), "{lost:#?}");
}
