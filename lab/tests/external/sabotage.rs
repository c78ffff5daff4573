//! Laws that fail, each in its way, from a random instant on.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use oqtal_bus::message::{ExternalV1, StateV1};
use oqtal_daemon::ExternalLaw;

use super::pd::PositionPd;

/// A room of 7 m by 7 m, a vehicle that differs from its model.
pub const ROOM: &[&str] = &[
    "fence.x-m=[-3.5,3.5]",
    "fence.y-m=[-3.5,3.5]",
    "fence.z-m=[-0.5,3]",
    "fence.soft-margin-m=0.5",
    "plant.spread=0.1",
    "trajectory.settle-s=1",
];

/// Trajectories from hover to 2 m/s.
pub const TRAJECTORIES: [&[&str]; 5] = [
    &["trajectory.kind=hover", "trajectory.hover.duration-s=7"],
    &["trajectory.kind=square", "trajectory.square.dwell-s=2", "trajectory.square.duration-s=8"],
    &["trajectory.kind=circle", "trajectory.circle.period-s=6", "trajectory.circle.laps=1"],
    &[
        "trajectory.kind=lemniscate",
        "trajectory.lemniscate.period-s=6",
        "trajectory.lemniscate.laps=1",
    ],
    // 2 m/s, at 15 degrees of tilt.
    &[
        "fence.x-m=[-4.8,2.2]",
        "trajectory.kind=circle",
        "trajectory.circle.radius-m=1.55",
        "trajectory.circle.period-s=4.87",
        "trajectory.circle.laps=2",
        "position.horizontal-velocity-limit-m-s=2.5",
        "position.tilt-limit-deg=25",
    ],
];

/// The failure of a law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sabotage {
    Killed,
    SleepsForASecond,
    NotANumber,
    WrongSign,
    FullStick,
    DivergingGain,
    ConstantBias,
    LastQuestion,
    Late,
    Noise,
    HeldCommand,
    FullThrust,
    NoThrust,
    ThrustBias,
    Runaway,
    WrongVelocity,
    OutOfRange,
}

impl Sabotage {
    pub const ALL: [Self; 17] = [
        Self::Killed,
        Self::SleepsForASecond,
        Self::NotANumber,
        Self::WrongSign,
        Self::FullStick,
        Self::DivergingGain,
        Self::ConstantBias,
        Self::LastQuestion,
        Self::Late,
        Self::Noise,
        Self::HeldCommand,
        Self::FullThrust,
        Self::NoThrust,
        Self::ThrustBias,
        Self::Runaway,
        Self::WrongVelocity,
        Self::OutOfRange,
    ];
}

/// Uniform random numbers, by a linear congruential generator of 64 bits.
struct Random(u64);

impl Random {
    fn next(&mut self, low: f64, high: f64) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A PD law that fails.
pub struct Saboteur {
    law: PositionPd,
    sabotage: Sabotage,
    random: Random,
    /// Question from which on the law fails.
    from: u64,
    /// Direction and size of the failure.
    direction: Vector3<f64>,
    size: f64,
    history: Vec<ExternalV1>,
}

impl Saboteur {
    pub fn new(sabotage: Sabotage, seed: usize) -> Self {
        let mut random = Random(seed as u64 * 977 + sabotage as u64 + 1);
        for _ in 0..8 {
            random.next(0.0, 1.0);
        }
        // Flight of the law: from 2.5 s on.
        let from = random.next(160.0, 560.0) as u64;
        let angle = random.next(0.0, TAU);
        let direction = Vector3::new(angle.cos(), angle.sin(), random.next(-0.5, 0.5)).normalize();
        let size = random.next(0.1, 1.0);
        Self {
            law: PositionPd::default(),
            sabotage,
            random,
            from,
            direction,
            size,
            history: Vec::new(),
        }
    }

    fn failing(&mut self, state: &StateV1, good: ExternalV1) -> Option<ExternalV1> {
        let Self { direction, size, .. } = *self;
        let since = state.sequence - self.from;
        let since_s = since as f64 * state.period_s;
        let most = state.greatest_rate[0];
        let clamped = |rate: Vector3<f64>| rate.map(|rate| rate.clamp(-most, most)).into();
        let rate = Vector3::from(good.rate);
        let thrust = |n: f64| n.clamp(0.0, state.greatest_thrust);
        let moved = |offset: Vector3<f64>, velocity: Vector3<f64>| StateV1 {
            reference_position: (Vector3::from(state.reference_position) + offset).into(),
            reference_velocity: (Vector3::from(state.reference_velocity) + velocity).into(),
            ..*state
        };
        Some(match self.sabotage {
            Sabotage::Killed => return None,
            Sabotage::SleepsForASecond if since % 90 < 60 => return None,
            Sabotage::SleepsForASecond => good,
            Sabotage::NotANumber => ExternalV1 { thrust: f64::NAN, ..good },
            Sabotage::WrongSign => ExternalV1 { rate: clamped(-rate * (1.0 + size)), ..good },
            Sabotage::FullStick => {
                ExternalV1 { rate: clamped(direction.map(f64::signum) * most), ..good }
            }
            Sabotage::DivergingGain => {
                let gain = (since_s * (0.3 + 2.0 * size)).exp();
                let law = PositionPd {
                    attitude_gain: self.law.attitude_gain * gain,
                    position_gain: self.law.position_gain * gain.sqrt(),
                    ..self.law
                };
                law.command(state)
            }
            Sabotage::ConstantBias => {
                ExternalV1 { rate: clamped(rate + direction * size * most), ..good }
            }
            Sabotage::LastQuestion => ExternalV1 { sequence: state.sequence - 1, ..good },
            Sabotage::Late => {
                let back = (2.0 + 20.0 * size) as usize;
                let old = self.history[self.history.len().saturating_sub(back)];
                ExternalV1 { sequence: state.sequence, ..old }
            }
            Sabotage::Noise => {
                let random = &mut self.random;
                let rate = Vector3::from_fn(|_, _| random.next(-most, most) * size);
                ExternalV1 {
                    rate: rate.into(),
                    thrust: good.thrust * random.next(0.5, 1.5),
                    ..good
                }
            }
            Sabotage::HeldCommand => {
                let held = self.history[(self.from as usize - 1).min(self.history.len() - 1)];
                ExternalV1 { sequence: state.sequence, ..held }
            }
            Sabotage::FullThrust => ExternalV1 { thrust: state.greatest_thrust, ..good },
            Sabotage::NoThrust => ExternalV1 { thrust: 0.0, ..good },
            Sabotage::ThrustBias => ExternalV1 {
                thrust: thrust(good.thrust * (1.0 + 0.5 * direction.z.signum() * size)),
                ..good
            },
            Sabotage::Runaway => {
                let speed = direction * (0.5 + 2.5 * size);
                self.law.command(&moved(speed * since_s, speed))
            }
            Sabotage::WrongVelocity => {
                let law = PositionPd { velocity_gain: -size * self.law.velocity_gain, ..self.law };
                law.command(state)
            }
            Sabotage::OutOfRange => ExternalV1 { rate: (direction * most * 3.0).into(), ..good },
        })
    }
}

impl ExternalLaw for Saboteur {
    fn reset(&mut self) {}

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        let good = self.law.command(state);
        let answer =
            if state.sequence < self.from { Some(good) } else { self.failing(state, good) };
        self.history.push(good);
        answer
    }
}
