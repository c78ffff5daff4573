//! An environment for reinforcement learning: episodes of a lane with observation, reward and end.
//!
//! Plant, cameras, delays, radio and noise are those of a flight of the same configuration and seed; a step is one control tick.

use nalgebra::{Quaternion, UnitQuaternion, Vector3, Vector4};
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, TruthV1};
use oqtal_bus::time::Time;
use oqtal_config::Config;
use oqtal_control::estimator::{Estimate, Estimator};
use oqtal_control::quaternion::Attitude;
use oqtal_control::trajectory::Reference;
use oqtal_plant_sim::State;
use oqtal_runtime::process::Failure;

use crate::mission::Mission;
use crate::random::SplitMix64;
use crate::simulation::lane::Lane;

/// Length of an action: three sticks \[-1..1\], and the thrust \[0..1\].
pub const ACTION: usize = 4;
/// Number of past actions in an observation \[-\]: those in transit, and the one that acts.
const PAST: usize = 3;
/// Length of an observation: position error, velocity error, attitude, body rate, past actions.
pub const OBSERVATION: usize = 3 + 3 + 4 + 3 + PAST * ACTION;

/// Distance from the reference at which an episode ends \[m\].
const LOST_M: f64 = 2.0;
/// Height below which a vehicle in the air has fallen \[m\].
const FALLEN_M: f64 = 0.05;
/// Position error at which its reward is half \[m\].
const HALF_REWARD_M: f64 = 0.3;
/// Reward for a body rate of 1 rad/s, and for a change of the action of 1.
const PENALTY: f64 = 0.02;

/// Task of an environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// Hold the hover point, from a state close to it.
    Hover,
    /// Follow the configured trajectory, from its start.
    Track,
    /// Reach the hover point from any attitude, with velocity and rate.
    Recover,
    /// Like a flight: at rest on the floor; the episode does not end automatically.
    Floor,
}

impl Task {
    /// The task `name`.
    pub fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "hover" => Self::Hover,
            "track" => Self::Track,
            "recover" => Self::Recover,
            "floor" => Self::Floor,
            _ => return None,
        })
    }
}

/// The result of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepResult {
    /// Reward \[0..1 less penalties\].
    pub reward: f64,
    /// Whether the vehicle fell or was lost.
    pub terminated: bool,
    /// Whether the time of the episode is over.
    pub truncated: bool,
}

/// An environment in an episode.
#[derive(Debug)]
pub struct Environment {
    mission: Mission,
    task: Task,
    /// Duration of an episode \[s\].
    duration_s: f64,
    lane: Lane,
    /// Reference at the present tick.
    reference: Reference,
    estimator: Estimator,
    estimate: Estimate,
    /// Capture of the newest pose used.
    captured_at: Time,
    /// Past actions, the newest first.
    past: [[f64; ACTION]; PAST],
    /// Steps since the start of the episode \[-\].
    steps: u64,
}

impl Environment {
    /// The environment of `config`, in the episode of its seed.
    ///
    /// # Errors
    /// The configuration is invalid for an environment (exit code 78).
    pub fn new(config: Config, task: Task, duration_s: f64) -> Result<Self, Failure> {
        let estimator = Estimator::new(config.control.estimator);
        let mission = Mission::new(config)?;
        let lane = begin(&mission, task)?;
        let start = mission.trajectory.sample(0.0);
        // A trajectory may begin in motion.
        let reference = match task {
            Task::Track => start,
            Task::Hover | Task::Recover | Task::Floor => {
                Reference::rest(start.position, start.phase)
            }
        };
        let mut new = Self {
            mission,
            task,
            duration_s,
            lane,
            reference,
            estimator,
            estimate: Estimate::default(),
            captured_at: Time::UNSET,
            past: [[0.0; ACTION]; PAST],
            steps: 0,
        };
        new.begin_estimate();
        Ok(new)
    }

    /// Begins the episode of `seed`.
    ///
    /// # Errors
    /// Like [`Environment::new`].
    pub fn reset(&mut self, seed: u64) -> Result<(), Failure> {
        self.mission.config.clock.seed = seed;
        self.lane = begin(&self.mission, self.task)?;
        self.estimator = Estimator::new(self.mission.config.control.estimator);
        (self.estimate, self.captured_at) = (Estimate::default(), Time::UNSET);
        (self.past, self.steps) = ([[0.0; ACTION]; PAST], 0);
        self.begin_estimate();
        Ok(())
    }

    /// Commands `action` and simulates to the next tick. An action that is not finite switches the motors off.
    ///
    /// # Errors
    /// The transport failed.
    pub fn step(&mut self, action: [f64; ACTION]) -> Result<StepResult, Failure> {
        let [roll, pitch, yaw, thrust] = action;
        let command = CommandV1 {
            actuation: Actuation::Sticks.code(),
            sticks: [roll, pitch, yaw],
            thrust,
            ..CommandV1::default()
        };
        let is_finite = action.iter().all(|number| number.is_finite());
        self.lane.command(if is_finite { command } else { CommandV1::default() })?;
        let change = Vector4::from(action) - Vector4::from(self.past[0]);
        self.steps += 1;
        self.past.rotate_right(1);
        self.past[0] = if is_finite { action } else { [0.0; ACTION] };
        self.observe();
        Ok(self.result(if is_finite { change.norm() } else { 0.0 }))
    }

    /// The estimate at the first tick; for a vehicle in the air, before its first pose, the true position and attitude.
    fn begin_estimate(&mut self) {
        self.observe();
        if !self.captured_at.is_set() && self.task != Task::Floor {
            let TruthV1 { position, attitude, .. } = self.lane.truth();
            self.estimate.position = position.into();
            self.estimate.attitude = Attitude::from_xyzw(attitude).unwrap_or_default();
        }
    }

    /// Takes the reference of the present tick, and the newest pose into the estimate.
    fn observe(&mut self) {
        if self.task == Task::Track {
            self.reference = self.mission.trajectory.sample(self.elapsed_s());
        }
        let Some((header, pose)) = self.lane.pose() else { return };
        let captured_at = header.stamps.captured_at;
        if captured_at == self.captured_at {
            return;
        }
        self.captured_at = captured_at;
        if let Some(attitude) = Attitude::from_xyzw(pose.attitude) {
            let t_s = captured_at.since(Time::VIRTUAL_START).seconds();
            self.estimate = self.estimator.update(t_s, Vector3::from(pose.position), attitude);
        }
    }

    /// Time since the start of the episode \[s\].
    fn elapsed_s(&self) -> f64 {
        self.lane.now().since(Time::VIRTUAL_START).seconds()
    }

    fn result(&mut self, change: f64) -> StepResult {
        let truth = self.lane.truth();
        let error = (Vector3::from(truth.position) - self.reference.position).norm();
        let near = 1.0 / (1.0 + (error / HALF_REWARD_M).powi(2));
        let [x, y, ..] = truth.attitude;
        // Cosine of the tilt.
        let upright = 1.0 - 2.0 * (x * x + y * y);
        let reward = match self.task {
            Task::Recover => 0.5 * near + 0.25 * (1.0 + upright),
            Task::Hover | Task::Track | Task::Floor => near,
        };
        let rate = Vector3::from(truth.rate).norm();
        let rate_hz = self.mission.config.control.rate_hz;
        let is_floor = self.task == Task::Floor;
        let is_down = truth.position[2] < FALLEN_M || error > LOST_M || !error.is_finite();
        StepResult {
            reward: reward - PENALTY * (rate + change),
            terminated: is_down && !is_floor,
            truncated: self.steps as f64 >= (self.duration_s * rate_hz).round() && !is_floor,
        }
    }

    /// The observation from the poses of the cameras: position error \[m, world\], velocity error \[m/s, world\], attitude with the scalar
    /// last and not negative, body rate \[rad/s\], past actions with the newest first.
    pub fn observation(&self) -> [f64; OBSERVATION] {
        let (Estimate { position, velocity, attitude, rate }, reference) =
            (self.estimate, &self.reference);
        let q = attitude.xyzw();
        let sign = if q[3] < 0.0 { -1.0 } else { 1.0 };
        let mut numbers = [0.0; OBSERVATION];
        numbers[..3].copy_from_slice((position - reference.position).as_slice());
        numbers[3..6].copy_from_slice((velocity - reference.velocity).as_slice());
        numbers[6..10].copy_from_slice(&q.map(|number| sign * number));
        numbers[10..13].copy_from_slice(rate.0.as_slice());
        numbers[13..].copy_from_slice(self.past.as_flattened());
        numbers
    }

    /// Truth at the present tick.
    pub fn truth(&mut self) -> TruthV1 {
        self.lane.truth()
    }

    /// Reference at the present tick: position \[m, world\], velocity \[m/s, world\].
    pub fn reference(&self) -> [f64; 6] {
        let ([x, y, z], [vx, vy, vz]) =
            (self.reference.position.into(), self.reference.velocity.into());
        [x, y, z, vx, vy, vz]
    }

    /// Newest pose as measured: position \[m, world\], and attitude with the scalar last; NaN before the first one.
    pub fn pose(&self) -> [f64; 7] {
        let Some((_, pose)) = self.lane.pose() else { return [f64::NAN; 7] };
        let ([x, y, z], [i, j, k, w]) = (pose.position, pose.attitude);
        [x, y, z, i, j, k, w]
    }
}

/// The lane of the episode of the mission's seed.
fn begin(mission: &Mission, task: Task) -> Result<Lane, Failure> {
    let mut random = SplitMix64::new(mission.config.clock.seed);
    let mut vector = |size: f64| Vector3::from_fn(|_, _| random.between(-size, size));
    let hover = mission.trajectory.sample(0.0).position;
    let motion = |position, velocity, turn: Vector3<f64>, rate| State {
        position: hover + position,
        velocity,
        attitude: *UnitQuaternion::from_scaled_axis(turn),
        rate,
        actuators: Vector4::zeros(),
    };
    let start = match task {
        Task::Floor => None,
        Task::Track => Some(motion(vector(0.02), vector(0.05), vector(0.02), vector(0.05))),
        Task::Hover => Some(motion(vector(0.3), vector(0.3), vector(0.2), vector(0.3))),
        Task::Recover => {
            // A direction and a half turn at most: every attitude occurs.
            let turn = Quaternion::new(vector(1.0).x, vector(1.0).x, vector(1.0).x, vector(1.0).x);
            let turn = UnitQuaternion::try_new(turn, 1e-3).unwrap_or_default().scaled_axis();
            Some(motion(vector(0.5), vector(1.0), turn, vector(1.0)))
        }
    };
    Lane::begin(mission, start)
}

#[cfg(test)]
mod tests {
    use oqtal_config::Setting;

    use super::*;

    #[test]
    fn the_reference_of_a_fixed_point_is_at_rest() {
        let settings = ["trajectory.kind=circle", "trajectory.circle.ramp-s=0.0"];
        let settings = settings.map(|text| Setting::parse("test", text).unwrap());
        let config = Config::from_settings(&settings).unwrap();
        let velocity = |task| {
            let mut environment = Environment::new(config.clone(), task, 1.0).unwrap();
            environment.reset(2).unwrap();
            Vector3::from_row_slice(&environment.reference()[3..]).norm()
        };
        assert!(velocity(Task::Track) > 0.1);
        assert_eq!([Task::Hover, Task::Recover, Task::Floor].map(velocity), [0.0; 3]);
    }
}
