//! Synthetic flights for tests: a square flown with lag and noise, and a recording with jitter and gaps.

use crate::latency::{HopDistributions, OnwardTime};
use nalgebra::Vector3;
use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::message::{Stamps, TelemetryV1, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::quaternion::Attitude;
use oqtal_control::trajectory::Phase;

use crate::flight::{AppliedCommand, Flight, FlightSample, Outcome, PoseArrival};

const RATE_HZ: f64 = 60.0;
/// Corners of the square \[m\], one every five seconds from [`FIRST_STEP_S`].
const CORNERS: [[f64; 2]; 4] = [[1.3, 0.0], [1.3, 1.3], [0.0, 1.3], [0.0, 0.0]];
const FIRST_STEP_S: f64 = 8.0;
const SCORED_S: f64 = 22.0;
const LANDING_S: f64 = 31.0;
const END_S: f64 = 35.0;

/// A flight without recorded data.
pub fn empty() -> Flight {
    let flight = Flight::new(&Config::default());
    Flight { outcome: Outcome::Timeout, speed_factor: f64::NAN, ..flight }
}

/// Take-off, a square with corner steps, one short loss of poses, landing.
pub fn square() -> Flight {
    let mut flight = Flight { outcome: Outcome::Landed, speed_factor: 1.0, ..empty() };
    let mut noise = Noise(1);
    let (mut position, mut velocity) = (Vector3::zeros(), Vector3::zeros());
    for tick in 0..(END_S * RATE_HZ) as u64 {
        let t = tick as f64 / RATE_HZ;
        let reference = reference(t);
        let command = ((reference - position) * 1.4).map(|v: f64| v.clamp(-0.8, 0.8));
        let gust = Vector3::new((1.3 * t).sin(), (0.9 * t).cos(), (1.7 * t).sin()) * 0.12;
        let acceleration = (command - velocity) * 3.0 + gust;
        velocity += acceleration / RATE_HZ;
        position += velocity / RATE_HZ;
        flight.samples.push(sample(
            tick,
            [reference, position, velocity, command, acceleration],
            &mut noise,
        ));
        let at = instant(tick);
        flight.wakeup_lateness.add(Span::from_nanos(noise.nanos(60_000)));
        flight.period_jitter.add(Span::from_nanos(noise.nanos(40_000)));
        let stamps = stamps(at, &mut noise);
        flight.hops.add(&stamps, OnwardTime::default());
        let battery_v = 12.4 - 0.01 * t + 0.01 * noise.next();
        let (sequence, onward) = (tick + 1, OnwardTime::default());
        flight.applied.push(AppliedCommand { sequence, stamps, onward, battery_v });
        flight.arrivals.push(PoseArrival {
            captured_at: at,
            at,
            frame: tick + 1,
            position: position.into(),
            attitude: [0.0, 0.0, 0.0, 1.0],
            is_tracked: true,
        });
    }
    flight
}

/// A recording whose poses jitter and are missing twice.
pub fn replay() -> Flight {
    let mut flight = Flight { outcome: Outcome::Replayed, speed_factor: 210.0, ..square() };
    flight.config.mocap.replay = "recording.csv".to_owned();
    flight.config.safety.observe_only = true;
    flight.hops = HopDistributions::default();
    flight.applied.clear();
    flight.samples.iter_mut().for_each(|sample| {
        sample.truth = None;
        sample.telemetry.scored = 0;
    });
    let mut noise = Noise(7);
    let missing = |frame: u64| (500..506).contains(&frame) || (1200..1212).contains(&frame);
    flight.arrivals.retain(|arrival| !missing(arrival.frame) && noise.next() > -0.98);
    for arrival in &mut flight.arrivals {
        arrival.at = arrival.at + Span::from_nanos(noise.nanos(3_000_000));
    }
    flight
}

/// A reproducible stream of numbers in -1..1 (a linear congruential generator, Knuth's MMIX).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// A span with a long tail, mostly close to `typical`.
    fn nanos(&mut self, typical: i64) -> i64 {
        let u = 0.5 * (self.next() + 1.0);
        (typical as f64 * (0.6 - 0.4 * (1.0 - u).max(1e-6).ln())) as i64
    }

    fn vector(&mut self, size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| size * self.next())
    }
}

fn instant(tick: u64) -> Time {
    Time::VIRTUAL_START + Span::from_seconds(tick as f64 / RATE_HZ)
}

fn phase(t: f64) -> Phase {
    match t {
        ..3.0 => Phase::TakeOff,
        ..FIRST_STEP_S => Phase::Settle,
        ..LANDING_S => Phase::Trajectory,
        _ => Phase::Landing,
    }
}

fn reference(t: f64) -> Vector3<f64> {
    let z = (t / 2.5).min(1.0).min((END_S - 1.0 - t) / 2.5).max(-0.05);
    let corner = if t < FIRST_STEP_S { 3 } else { (((t - FIRST_STEP_S) / 5.0) as usize).min(3) };
    Vector3::new(CORNERS[corner][0], CORNERS[corner][1], z)
}

fn sample(tick: u64, motion: [Vector3<f64>; 5], noise: &mut Noise) -> FlightSample {
    let [reference, position, velocity, command, acceleration] = motion;
    let t = tick as f64 / RATE_HZ;
    let tilt = Vector3::new(-acceleration.y, acceleration.x, 0.02 * (0.7 * t).sin()) / 9.81;
    let attitude = Attitude::from_rotation_vector(tilt + noise.vector(0.006));
    let lost = (1000..1012).contains(&tick);
    let state = if lost { SafetyState::Coast } else { SafetyState::Nominal };
    let telemetry = TelemetryV1 {
        time: instant(tick),
        tick: tick + 1,
        command_sequence: tick + 1,
        mission_s: t,
        position: (position + noise.vector(0.002)).into(),
        velocity: (velocity + noise.vector(0.02)).into(),
        attitude: attitude.xyzw(),
        rate: noise.vector(0.05).into(),
        reference_position: reference.into(),
        velocity_command: command.into(),
        attitude_command: Attitude::from_rotation_vector(tilt).xyzw(),
        sticks: (tilt + noise.vector(0.02)).into(),
        thrust: 0.245 + 0.02 * acceleration.z + 0.002 * noise.next(),
        pose_age_s: if lost { 0.015 + (tick - 999) as f64 / RATE_HZ } else { 0.015 },
        riccati_solves: 1 + tick / 300,
        poses_lost: if tick < 1012 { 0 } else { 12 },
        mode: Mode::Flying.code(),
        state: state.code(),
        cause: if lost { Cause::NoPose } else { Cause::None }.code(),
        phase: phase(t) as u8,
        scored: u8::from((FIRST_STEP_S..=FIRST_STEP_S + SCORED_S).contains(&t)),
        fresh: u8::from(!lost),
        ..TelemetryV1::default()
    };
    let truth = TruthV1 {
        time: instant(tick),
        position: position.into(),
        velocity: velocity.into(),
        attitude: attitude.xyzw(),
        ..TruthV1::default()
    };
    FlightSample { telemetry, truth: Some(truth) }
}

/// Stamps of the command of a tick at `woken_at`.
fn stamps(woken_at: Time, noise: &mut Noise) -> Stamps {
    let pose_published_at = woken_at - Span::from_nanos(noise.nanos(40_000));
    let captured_at = pose_published_at - Span::from_millis(15);
    let mut after = |start: Time, typical| start + Span::from_nanos(noise.nanos(typical));
    let command_published_at = after(woken_at, 70_000);
    let received_at = after(command_published_at, 45_000);
    Stamps {
        pose_received_at: Time::UNSET,
        captured_at,
        pose_published_at,
        woken_at,
        computed_at: command_published_at,
        command_published_at,
        received_at,
        applied_at: received_at + Span::from_millis(20),
    }
}
