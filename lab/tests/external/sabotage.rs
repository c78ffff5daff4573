//! Laws that fail, each in its way, from a random instant on.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;
use oqtal_bus::message::{ExternalV1, StateV1};
use oqtal_daemon::ExternalLaw;

use super::pd::PositionPd;
use crate::Draw;

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
    TurnedAway,
}

impl Sabotage {
    pub const ALL: [Self; 18] = [
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
        Self::TurnedAway,
    ];
}

/// A PD law that fails.
pub struct Saboteur {
    law: PositionPd,
    sabotage: Sabotage,
    random: Draw,
    /// Question from which on the law fails.
    from: u64,
    /// Direction and size of the failure.
    direction: Vector3<f64>,
    size: f64,
    history: Vec<ExternalV1>,
}

impl Saboteur {
    pub fn new(sabotage: Sabotage, seed: usize) -> Self {
        let mut random = Draw(seed as u64 * 977 + sabotage as u64 + 1);
        for _ in 0..8 {
            random.next();
        }
        // Flight of the law: from 2.5 s on.
        let from = random.between(160.0, 560.0) as u64;
        let angle = random.between(0.0, TAU);
        let direction =
            Vector3::new(angle.cos(), angle.sin(), random.between(-0.5, 0.5)).normalize();
        let size = random.between(0.1, 1.0);
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
        let since = state.sequence - self.from;
        Some(match self.sabotage {
            Sabotage::Killed => return None,
            Sabotage::SleepsForASecond if since % 90 < 60 => return None,
            Sabotage::SleepsForASecond => good,
            Sabotage::NotANumber => ExternalV1 { thrust: f64::NAN, ..good },
            Sabotage::LastQuestion => ExternalV1 { sequence: state.sequence - 1, ..good },
            Sabotage::Late => {
                let back = (2.0 + 20.0 * self.size) as usize;
                let old = self.history[self.history.len().saturating_sub(back)];
                ExternalV1 { sequence: state.sequence, ..old }
            }
            Sabotage::HeldCommand => {
                let held = self.history[(self.from as usize - 1).min(self.history.len() - 1)];
                ExternalV1 { sequence: state.sequence, ..held }
            }
            Sabotage::DivergingGain | Sabotage::Runaway | Sabotage::WrongVelocity => {
                self.misled(state, since as f64 * state.period_s)
            }
            _ => self.falsified(state, good),
        })
    }

    /// The answer of a law with wrong gains or a wrong reference, `since_s` \[s\] after its failure.
    fn misled(&self, state: &StateV1, since_s: f64) -> ExternalV1 {
        let Self { law, direction, size, .. } = *self;
        let gain = (since_s * (0.3 + 2.0 * size)).exp();
        let speed = direction * (0.5 + 2.5 * size);
        match self.sabotage {
            Sabotage::DivergingGain => PositionPd {
                attitude_gain: law.attitude_gain * gain,
                position_gain: law.position_gain * gain.sqrt(),
                ..law
            }
            .command(state),
            Sabotage::WrongVelocity => {
                PositionPd { velocity_gain: -size * law.velocity_gain, ..law }.command(state)
            }
            _ => law.command(&StateV1 {
                reference_position: (Vector3::from(state.reference_position) + speed * since_s)
                    .into(),
                reference_velocity: (Vector3::from(state.reference_velocity) + speed).into(),
                ..*state
            }),
        }
    }

    /// A good answer, falsified.
    fn falsified(&mut self, state: &StateV1, good: ExternalV1) -> ExternalV1 {
        let (direction, size, most) = (self.direction, self.size, state.greatest_rate[0]);
        let turned = |rate: Vector3<f64>| ExternalV1 {
            rate: rate.map(|rate| rate.clamp(-most, most)).into(),
            ..good
        };
        let lifted = |n: f64| ExternalV1 { thrust: n.clamp(0.0, state.greatest_thrust), ..good };
        let rate = Vector3::from(good.rate);
        match self.sabotage {
            Sabotage::WrongSign => turned(-rate * (1.0 + size)),
            Sabotage::FullStick => turned(direction.map(f64::signum) * most),
            Sabotage::ConstantBias => turned(rate + direction * size * most),
            Sabotage::Noise => {
                let random = &mut self.random;
                let rate = Vector3::from_fn(|_, _| random.between(-most, most) * size);
                ExternalV1 { rate: rate.into(), ..lifted(good.thrust * random.between(0.5, 1.5)) }
            }
            // Turns up to half a turn from the reference, then tilts.
            Sabotage::TurnedAway => {
                let [x, y, z, w] = state.attitude;
                let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
                let turn = (yaw - state.reference_yaw + PI).rem_euclid(TAU) - PI;
                let rate = match turn.abs() < 0.3 + 2.8 * size {
                    true => Vector3::new(rate.x, rate.y, 0.99 * state.greatest_rate[2]),
                    false => direction * most,
                };
                ExternalV1 { rate: rate.into(), ..good }
            }
            Sabotage::FullThrust => lifted(f64::INFINITY),
            Sabotage::NoThrust => lifted(0.0),
            Sabotage::ThrustBias => lifted(good.thrust * (1.0 + 0.5 * direction.z.signum() * size)),
            _ => ExternalV1 { rate: (direction * most * 3.0).into(), ..good },
        }
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
