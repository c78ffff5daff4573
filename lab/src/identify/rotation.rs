//! Prediction of the attitude from pose to pose: the on-board rate loop with the commands in effect, corrected by a Kalman filter
//! at each pose. The residuals of a fit are the innovations over their expected deviations.

use nalgebra::{UnitQuaternion, Vector3};

use super::data::FlightData;
use super::inner_loop::{LoopState, LoopStep};
use super::noise::Innovations;
use super::robust::{LostTrack, limited};
use super::timeline::CommandTimeline;

/// Standard deviation of the rate before the first pose \[rad/s\].
const INITIAL_RATE: f64 = 0.5;

/// Parameters of the rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotationModel {
    /// Time from sending a command to its effect, including [`Self::fast_s`] \[s\].
    pub delay_s: f64,
    /// Time constant of the rate loop \[s\].
    pub lag_s: f64,
    /// Time constant of a second, shorter lag, included in the delay \[s\].
    pub fast_s: f64,
    /// Rate at full stick \[rad/s, body\].
    pub authority: Vector3<f64>,
    /// Bias of the rate set-point of the vehicle \[rad/s, body\].
    pub bias: Vector3<f64>,
}

/// Noise of the rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotationNoise {
    /// Standard deviation of a measured attitude about each axis \[rad\].
    pub measured_rad: f64,
    /// Standard deviation of the rate's random walk after one second, over [`Self::measured_rad`] \[1/s\].
    pub walk_ratio: f64,
}

/// Time interval with a constant thrust command, and the direction of the thrust at its middle.
#[derive(Clone, Copy, Debug)]
pub struct ThrustPiece {
    /// Duration \[s\].
    pub h_s: f64,
    /// Commanded thrust, as a fraction of the maximum \[0..1\].
    pub share: f64,
    /// Body z \[world\].
    pub axis: Vector3<f64>,
    /// Whether the interval ends at a pose.
    pub ends_at_pose: bool,
}

/// Predictions for one flight.
#[derive(Clone, Debug, Default)]
pub struct RotationPass {
    /// Measured minus predicted attitude of every pose but the first \[rad, body\].
    pub innovations: Innovations,
    /// Intervals from the first pose to the last.
    pub pieces: Vec<ThrustPiece>,
    /// Duration \[s\] and commanded thrust \[0..1\] of the intervals before the first pose.
    pub before: Vec<(f64, f64)>,
    /// Body rate at every pose but the first \[rad/s, body\].
    pub rates: Vec<Vector3<f64>>,
}

/// The state of the predictor.
struct Predictor<'a> {
    model: &'a RotationModel,
    attitude: UnitQuaternion<f64>,
    /// The loop of each axis \[body\].
    axes: [LoopState; 3],
    /// Covariance of angle and rate over the measurement variance: `[angle, both, rate]`.
    covariance: [f64; 3],
    /// Growth of the rate variance per second, over the measurement variance \[1/s^3\].
    walk: f64,
    lost: LostTrack,
}

/// Predicts all poses of `data` in the air.
pub fn pass(data: &FlightData, model: &RotationModel, noise: &RotationNoise) -> RotationPass {
    let Some((first, poses)) = data.air.split_first() else { return RotationPass::default() };
    let mut pass = RotationPass::default();
    let mut thrusts = CommandTimeline::new(&data.commands, model.delay_s);
    let began_s = data.commands.first().map_or(first.captured_s, |first| first.sent_s);
    thrusts.pieces((began_s, first.captured_s), |h_s, command| {
        pass.before.push((h_s, command.map_or(0.0, |command| command.thrust)));
    });
    let mut sticks = CommandTimeline::new(&data.commands, model.delay_s - model.fast_s);
    let mut predictor = Predictor::new(model, *first.attitude.unit_quaternion(), noise);
    let mut last_s = first.captured_s;
    for pose in poses {
        let mut from_s = last_s;
        sticks.pieces((last_s, pose.captured_s), |h_s, command| {
            let sticks = command.map_or_else(Vector3::zeros, |command| command.sticks);
            thrusts.pieces((from_s, from_s + h_s), |h_s, command| {
                let share = command.map_or(0.0, |command| command.thrust);
                let axis = predictor.advance(h_s, &sticks);
                pass.pieces.push(ThrustPiece { h_s, share, axis, ends_at_pose: false });
            });
            from_s += h_s;
        });
        if let Some(piece) = pass.pieces.last_mut() {
            piece.ends_at_pose = true;
        }
        pass.rates.push(predictor.rate());
        let innovation = predictor.correct(pose.attitude.unit_quaternion(), noise.measured_rad);
        pass.innovations.push(innovation);
        last_s = pose.captured_s;
    }
    pass
}

impl<'a> Predictor<'a> {
    fn new(model: &'a RotationModel, attitude: UnitQuaternion<f64>, noise: &RotationNoise) -> Self {
        Self {
            model,
            attitude,
            axes: [LoopState::default(); 3],
            covariance: [1.0, 0.0, (INITIAL_RATE / noise.measured_rad).powi(2)],
            walk: noise.walk_ratio * noise.walk_ratio,
            lost: LostTrack::default(),
        }
    }

    /// Body rate \[rad/s\].
    fn rate(&self) -> Vector3<f64> {
        self.axes.map(|axis| axis.rate).into()
    }

    /// Advances by `h_s` \[s\]; returns body z in the middle of that time \[world\].
    fn advance(&mut self, h_s: f64, sticks: &Vector3<f64>) -> Vector3<f64> {
        let step = LoopStep::new(self.model.lag_s, self.model.fast_s, h_s);
        let demand = self.model.authority.component_mul(sticks) + self.model.bias;
        let before = self.rate();
        let turned = Vector3::from_fn(|axis, _| step.advance(&mut self.axes[axis], demand[axis]));
        // Rotations about changing axes do not commute: coning correction for a linearly changing rate.
        let coning = before.cross(&self.rate()) * (h_s * h_s / 12.0);
        let half = UnitQuaternion::from_scaled_axis((turned + coning) * 0.5);
        let middle = self.attitude * half;
        self.attitude = UnitQuaternion::new_normalize((middle * half).into_inner());
        let ([p, c, r], (keep, lever)) = (self.covariance, step.of_rate());
        let added = self.walk * h_s;
        self.covariance = [
            p + 2.0 * lever * c + lever * lever * r + added * h_s * h_s / 3.0,
            keep * (c + lever * r) + added * h_s / 2.0,
            keep * keep * r + added,
        ];
        middle * Vector3::z()
    }

    /// Corrects the state by a measured attitude; returns the innovation \[rad, body\] and its expected variance over the
    /// measurement variance.
    fn correct(
        &mut self,
        measured: &UnitQuaternion<f64>,
        measured_rad: f64,
    ) -> (Vector3<f64>, f64) {
        let innovation = (self.attitude.inverse() * measured).scaled_axis();
        let [p, c, r] = self.covariance;
        let variance = p + 1.0;
        let sd = measured_rad * variance.sqrt();
        if self.lost.detects(&innovation, sd) {
            self.attitude = *measured;
            self.covariance = [1.0, 0.0, (INITIAL_RATE / measured_rad).powi(2)];
            return (innovation, variance);
        }
        let counted = limited(&innovation, sd);
        self.attitude *= UnitQuaternion::from_scaled_axis(counted * (p / variance));
        for (axis, by) in self.axes.iter_mut().zip(counted.iter()) {
            axis.rate += by * (c / variance);
        }
        self.covariance = [p / variance, c / variance, r - c * c / variance];
        (innovation, variance)
    }
}
