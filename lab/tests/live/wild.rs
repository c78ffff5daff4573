//! wild
use nalgebra::Vector3;
use oqtal_bus::code::{Mode, OperatorCommand, ReferenceKind};
use oqtal_bus::message::{ControlRequestV1, ReferenceV1};
use oqtal_bus::time::Span;
use oqtal_lab::simulation::online::OnlineFlight;
use oqtal_observe::flight::Outcome;

use super::requests::Draw;
use super::{fly_for, goto, hover, last, request};

const ROOMS: [&[&str]; 4] = [
    &[],
    &["fence.x-m=[-1.5, 1.5]", "fence.y-m=[-1.5, 1.5]", "fence.z-m=[-0.2, 2.0]", "fence.soft-margin-m=0.3"],
    &["fence.x-m=[-4.0, 4.0]", "fence.y-m=[-2.0, 2.0]", "fence.z-m=[-0.5, 1.6]", "fence.soft-margin-m=0.4"],
    &["fence.polygon-m=[[-3.0, -2.0], [3.0, -2.0], [1.5, 2.5], [-3.0, 2.5]]", "fence.z-m=[-0.1, 2.5]", "fence.soft-margin-m=0.4"],
];
const LAWS: [&str; 6] = ["oqtal", "oqtal-dt", "mpc", "geometric", "pid", "lqr"];

struct Planner { kind: u32, target: Vector3<f64>, speed: f64, rate_hz: f64, valid: f64, delay_s: f64, position: Vector3<f64>, velocity: Vector3<f64>, honest: bool }

impl Planner {
    fn draw(r: &mut Draw, start: Vector3<f64>) -> Self {
        let target = Vector3::new(10.0 * (r.next() - 0.5), 10.0 * (r.next() - 0.5), 4.0 * r.next() - 1.0);
        Self {
            kind: (r.next() * 7.0) as u32,
            target,
            speed: [0.3, 0.7, 1.2, 2.0, 2.4][(r.next() * 5.0) as usize],
            rate_hz: [10.0, 60.0, 240.0][(r.next() * 3.0) as usize],
            valid: [1.5, 2.0, 5.0, 30.0][(r.next() * 4.0) as usize],
            delay_s: [0.0, 0.0, 0.03, 0.1][(r.next() * 4.0) as usize],
            position: start,
            velocity: Vector3::zeros(),
            honest: r.next() < 0.5,
        }
    }

    fn next(&mut self, r: &mut Draw, dt: f64, tick: Vector3<f64>) -> ReferenceV1 {
        let away = self.target - self.position;
        let want = away.cap_magnitude(self.speed);
        let change = (want - self.velocity).cap_magnitude(4.0 * dt);
        let acceleration = change / dt;
        self.position += self.velocity * dt + change * (dt / 2.0);
        self.velocity += change;
        if (tick - self.position).norm() > 0.4 { self.position = tick; self.velocity *= 0.0; }
        let mut message = ReferenceV1 {
            kind: ReferenceKind::Position.code(),
            position: self.position.into(),
            velocity: self.velocity.into(),
            acceleration: if self.honest { acceleration.into() } else { [0.0; 3] },
            ..ReferenceV1::default()
        };
        let x = r.next();
        match self.kind {
            // Honest.
            0 | 1 => {}
            // Noise on positions, wrong derivatives.
            2 => for axis in 0..3 {
                message.position[axis] += 0.2 * (r.next() - 0.5);
                message.velocity[axis] += 1.0 * (r.next() - 0.5);
                message.acceleration[axis] += 6.0 * (r.next() - 0.5);
                message.jerk[axis] = 30.0 * (r.next() - 0.5);
            },
            // Not numbers, jumps.
            3 if x < 0.2 => message.position[(x * 15.0) as usize] = f64::NAN,
            3 if x < 0.4 => message.velocity[((x - 0.2) * 15.0) as usize] = f64::INFINITY,
            3 if x < 0.6 => message.position[0] += 2.0,
            3 => message.yaw = 6.0 * x,
            // Attitudes.
            4 => {
                let (s, c) = (0.13 * x).sin_cos();
                let about = self.target.x;
                message = ReferenceV1 { kind: ReferenceKind::Attitude.code(), position: [0.0, 0.0, self.position.z], attitude: [s * about.cos(), s * about.sin(), 0.0, c], rate: [0.5 * (r.next() - 0.5); 3], ..ReferenceV1::default() };
            }
            // Alternates between positions and attitudes.
            5 if x < 0.3 => message = ReferenceV1 { kind: ReferenceKind::Attitude.code(), attitude: [0.1, 0.0, 0.0, 0.99_f64.sqrt()], ..message },
            // Reverses.
            6 if x < 0.05 => self.velocity = -self.velocity,
            _ => {}
        }
        message
    }
}

fn fly(seed: u64) -> Option<String> {
    let mut r = Draw(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 77);
    for _ in 0..8 { r.next(); }
    let law = LAWS[(r.next() * 6.0) as usize];
    let room = (r.next() * 4.0) as usize;
    let law_setting = format!("control.controller={law}");
    let height = format!("trajectory.height-m={}", if room == 2 { 0.8 } else { 1.0 });
    let seed_setting = format!("clock.seed={seed}");
    let _ = seed_setting;
    let mission = hover(10.0, &[ROOMS[room], &[&law_setting, &height, "reference.land-after-ms=1500"]].concat());
    let mut flight = OnlineFlight::begin(&mission).unwrap();
    fly_for(&mut flight, 6.0);
    flight.end_after(Span::from_millis(120_000));
    let until = flight.now() + Span::from_seconds(10.0 + 20.0 * r.next());
    let mut log = Vec::new();
    let mut trace = format!("{seed} {law} room {room}:");
    while flight.now() < until && last(&flight).mode != Mode::Disarmed.code() {
        let tick = Vector3::from(last(&flight).reference_position);
        let tick = if tick.iter().all(|x| x.is_finite()) { tick } else { Vector3::z() };
        match (r.next() * 8.0) as u32 {
            0 => {
                let point = [6.0 * (r.next() - 0.5), 6.0 * (r.next() - 0.5), 2.5 * r.next()];
                let done = flight.change(OperatorCommand::Goto, &goto(point)).unwrap();
                log.push(format!("goto {point:.2?} {}", done.is_ok_and(|d| d.answer == oqtal_bus::code::Answer::Done.code())));
            }
            1 => { let _ = flight.change(OperatorCommand::Hover, &ControlRequestV1::of(OperatorCommand::Hover)); log.push("hover".into()); }
            2 => { let name = r.of(&["circle", "square", "lemniscate", "step"]); let d = flight.change(OperatorCommand::Trajectory, &request(name)).unwrap(); log.push(format!("fly {name} {}", d.is_ok_and(|d| d.answer == oqtal_bus::code::Answer::Done.code()))); }
            3 => { let set = r.of(&["reference.leg-acceleration-m-s2=0.05", "reference.leg-acceleration-m-s2=5.0", "reference.leg-acceleration-m-s2=1.0", "position.tilt-limit-deg=8", "position.tilt-limit-deg=20", "reference.leg-horizontal-m-s=2.0 reference.leg-vertical-m-s=1.5", "position.vertical-acceleration-limit-m-s2=2.0", "control.controller=oqtal-dt", "control.controller=pid", "control.controller=mpc"]);
                let _ = flight.change(OperatorCommand::Set, &request(set)); log.push(set.to_string()); }
            4 if r.next() < 0.3 => { flight.request(OperatorCommand::Land).unwrap(); log.push("land".into()); }
            _ => {
                let mut planner = Planner::draw(&mut r, tick);
                let period = Span::from_seconds(1.0 / planner.rate_hz);
                let seconds = 0.2 + 4.0 * r.next();
                log.push(format!("planner kind {} to {:.2?} at {} m/s, {} Hz valid {} delay {} honest {} for {seconds:.2}", planner.kind, planner.target.as_slice(), planner.speed, planner.rate_hz, planner.valid, planner.delay_s, planner.honest));
                flight.pause_every(period);
                flight.advance().unwrap();
                let began = flight.now();
                while flight.now().since(began).seconds() < seconds {
                    let now = flight.now();
                    let tick = Vector3::from(last(&flight).reference_position);
                    let mut message = planner.next(&mut r, period.seconds(), tick);
                    message.time = now - Span::from_seconds(planner.delay_s);
                    message.valid_until = now + period.scaled(planner.valid);
                    if planner.kind == 3 && r.next() < 0.1 { message.time = now + Span::from_millis((400.0 * (r.next() - 0.5)) as i64); }
                    flight.publish(message).unwrap();
                    if !flight.advance().unwrap() { break; }
                }
            }
        }
        flight.pause_every(Span::from_millis(50));
        flight.advance().unwrap();
        let pause = 2.0 * r.next();
        fly_for(&mut flight, pause);
    }
    // Whoever does nothing more gets the vehicle back within the time, or by a landing.
    fly_for(&mut flight, 20.0);
    let landed_by_itself = last(&flight).mode == Mode::Disarmed.code();
    if !landed_by_itself { flight.request(OperatorCommand::Land).unwrap(); }
    flight.end_after(Span::from_millis(40_000));
    let cause = last(&flight).cause;
    let _ = cause;
    let flown = flight.finish().unwrap();
    if flown.outcome == Outcome::Landed { return None; }
    trace.push_str(&format!(" {:?} {:?}\n   {}", flown.outcome, flown.crash, log.join("\n   ")));
    Some(trace)
}

#[test]
fn wild() {
    let n: u64 = std::env::var("WILD").ok().and_then(|t| t.parse().ok()).unwrap_or(200);
    let from: u64 = std::env::var("FROM").ok().and_then(|t| t.parse().ok()).unwrap_or(0);
    let lost: Vec<_> = (from..from + n).filter_map(fly).collect();
    for l in &lost { println!("LOST {l}"); }
    println!("{} of {n} lost", lost.len());
}
