//! A flight of the configured law on the model of `[vehicle]`, without noise and disturbances, before a real one.

use std::collections::VecDeque;

use oqtal_config::Config;
use oqtal_control::estimator::Estimator;
use oqtal_control::predictive::{MeasuredPose, Motion, MotionTracker, Track};
use oqtal_control::quaternion::Attitude;
use oqtal_control::trajectory::Reference;

use crate::command_model::{CommandModel, motion_tracker};
use crate::stack::{ControlStack, LawInput};

/// Height of a floor that the model does not reach \[m, world\].
const NO_FLOOR_M: f64 = -1e3;

/// The model of a vehicle, flown by the configured law.
pub(super) struct ModelFlight {
    stack: ControlStack,
    tracker: MotionTracker,
    commands: CommandModel,
    estimator: Estimator,
    /// Motions that the cameras have seen and not yet reported, with their times \[s\].
    in_transit: VecDeque<(f64, Motion)>,
    latency_s: f64,
}

impl ModelFlight {
    /// The model in hover, or in the motion of `reference`, at `t_s` \[s\].
    pub(super) fn at(reference: &Reference, t_s: f64, config: &Config) -> Option<Self> {
        let commands = CommandModel::new(config).ok()?;
        let stack = ControlStack::new(config).ok()?;
        let mut tracker = motion_tracker(config, commands.model);
        let attitude = Attitude::from_rotation_vector(nalgebra::Vector3::z() * reference.yaw_rad);
        tracker.begin(t_s, &MeasuredPose { position: reference.position, attitude }, NO_FLOOR_M);
        let mut track: Track = tracker.track()?.lifted();
        track.motion.velocity = reference.velocity;
        track.motion.thrust_n = commands.model.mass_kg * commands.model.gravity_m_s2;
        tracker.restore(track);
        Some(Self {
            stack,
            tracker,
            commands,
            estimator: Estimator::new(config.control.estimator),
            in_transit: VecDeque::from([(t_s, track.motion)]),
            latency_s: config.mocap.latency_ms * 1e-3,
        })
    }

    /// Advances to `now_s` and sends the command of this tick, `dt_s` after the last one \[s\]. Returns the motion; `None` if it is not
    /// finite.
    pub(super) fn tick(
        &mut self,
        number: u64,
        (now_s, dt_s): (f64, f64),
        reference: &Reference,
    ) -> Option<Motion> {
        self.tracker.propagate(now_s);
        let motion = self.tracker.motion_at(now_s).filter(Motion::is_finite)?;
        self.in_transit.push_back((now_s, motion));
        while let Some((t_s, seen)) = self.in_transit.front().copied()
            && (t_s <= now_s - self.latency_s || number == 1)
        {
            self.estimator.update(t_s, seen.position, seen.attitude);
            self.in_transit.pop_front();
        }
        let input = LawInput {
            now_s,
            dt_s,
            estimate: self.estimator.latest(),
            tracker: &self.tracker,
            reference,
        };
        let output = self.stack.compute(&input)?;
        self.tracker.sent(number, now_s, self.commands.input(&output.command));
        Some(motion)
    }
}
