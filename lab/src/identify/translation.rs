//! Prediction of the position from pose to pose: a point mass under thrust, weight, drag and gusts, corrected by a Kalman filter
//! at each pose. The [`RotationPass`] gives the direction of the thrust.

use nalgebra::{Matrix3, Vector3};

use super::data::FlightData;
use super::noise::Innovations;
use super::robust::{LostTrack, limited};
use super::rotation::{RotationPass, ThrustPiece};

/// Standard deviation of the velocity before the first pose \[m/s\].
const INITIAL_VELOCITY: f64 = 1.0;
/// Shortest lag of the thrust \[s\].
const SHORTEST_S: f64 = 1e-4;

/// Parameters of the translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TranslationModel {
    /// Gravity \[m/s^2\], along -z of the world.
    pub gravity_m_s2: f64,
    /// Greatest thrust over the mass \[m/s^2\].
    pub thrust_m_s2: f64,
    /// Time constant of the thrust \[s\].
    pub thrust_lag_s: f64,
    /// Linear drag over the mass \[1/s\].
    pub drag_per_s: f64,
    /// Constant external acceleration \[m/s^2, world\].
    pub bias: Vector3<f64>,
    /// Curvature of the thrust over its command at [`Self::hover_share`] \[-\]: 0 for a straight line, 1 for a parabola.
    pub curvature_ratio: f64,
    /// Fraction of the maximum thrust at which curve and straight line meet \[0..1\].
    pub hover_share: f64,
}

/// Noise of the translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TranslationNoise {
    /// Standard deviation of a measured position along each axis \[m\].
    pub measured_m: f64,
    /// Standard deviation of the gusts' acceleration over [`Self::measured_m`] \[1/s^2\].
    pub gust_ratio: f64,
    /// Correlation time of the gusts \[s\].
    pub gust_s: f64,
}

/// Predictions for one flight.
#[derive(Clone, Debug, Default)]
pub struct TranslationPass {
    /// Measured minus predicted position of every pose but the first \[m, world\].
    pub innovations: Innovations,
    /// Mean acceleration of the model between poses, without gusts \[m/s^2, world\].
    pub accelerations: Vec<Vector3<f64>>,
}

/// The state of the predictor.
struct Predictor<'a> {
    model: &'a TranslationModel,
    noise: &'a TranslationNoise,
    thrust: f64,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    gust: Vector3<f64>,
    /// Covariance of position, velocity and gust along an axis, over the measurement variance.
    covariance: Matrix3<f64>,
    /// Time since the last pose \[s\].
    since_s: f64,
    /// Velocity change of the model since the last pose, without gusts \[m/s\].
    gained: Vector3<f64>,
    lost: LostTrack,
}

/// Predicts all poses of `data` in the air.
pub fn pass(
    data: &FlightData,
    rotation: &RotationPass,
    model: &TranslationModel,
    noise: &TranslationNoise,
) -> TranslationPass {
    let Some((first, poses)) = data.air.split_first() else { return TranslationPass::default() };
    let mut pass = TranslationPass::default();
    let mut predictor = Predictor::new(model, noise, first.position);
    for (h_s, share) in &rotation.before {
        predictor.lag_thrust(*h_s, *share);
    }
    let mut pieces = rotation.pieces.iter();
    for pose in poses {
        for piece in pieces.by_ref() {
            predictor.advance(piece);
            if piece.ends_at_pose {
                break;
            }
        }
        pass.accelerations.push(predictor.mean_acceleration());
        pass.innovations.push(predictor.correct(&pose.position));
    }
    pass
}

impl TranslationNoise {
    /// Covariance of position, velocity and gust after a single pose, over the measurement variance.
    fn initial(&self) -> Matrix3<f64> {
        let velocity = INITIAL_VELOCITY / self.measured_m;
        let diagonal = Vector3::new(1.0, velocity * velocity, self.gust_ratio.powi(2));
        Matrix3::from_diagonal(&diagonal)
    }
}

impl TranslationModel {
    /// Thrust over the mass for a commanded fraction of the maximum \[m/s^2\].
    pub fn thrust_at(&self, share: f64) -> f64 {
        let bend = self.curvature_ratio * (share / self.hover_share - 1.0);
        self.thrust_m_s2 * share * (1.0 + bend)
    }

    /// Operating point of a hover: derivative of the thrust over the mass with respect to the command \[m/s^2\], and the command \[0..1\].
    pub fn hover(&self) -> (f64, f64) {
        let bend = self.curvature_ratio / self.hover_share;
        let linear = self.thrust_m_s2 * (1.0 - self.curvature_ratio);
        // The greater root of `thrust_m_s2 bend u^2 + linear u = gravity_m_s2`, whose slope is the root of its discriminant.
        let square = linear.powi(2) + 4.0 * self.thrust_m_s2 * bend * self.gravity_m_s2;
        let slope = square.max(0.0).sqrt();
        (slope, 2.0 * self.gravity_m_s2 / (linear + slope))
    }
}

impl<'a> Predictor<'a> {
    fn new(
        model: &'a TranslationModel,
        noise: &'a TranslationNoise,
        position: Vector3<f64>,
    ) -> Self {
        Self {
            model,
            noise,
            thrust: 0.0,
            position,
            velocity: Vector3::zeros(),
            gust: Vector3::zeros(),
            covariance: noise.initial(),
            since_s: 0.0,
            gained: Vector3::zeros(),
            lost: LostTrack::default(),
        }
    }

    /// Advances the lag of the thrust by `h_s`; returns the mean thrust over the mass \[m/s^2\].
    fn lag_thrust(&mut self, h_s: f64, share: f64) -> f64 {
        let lag_s = self.model.thrust_lag_s.max(SHORTEST_S);
        let commanded = self.model.thrust_at(share);
        let keep = (-h_s / lag_s).exp();
        let off = self.thrust - commanded;
        self.thrust = commanded + off * keep;
        commanded + off * (1.0 - keep) * lag_s / h_s
    }

    fn advance(&mut self, piece: &ThrustPiece) {
        let h_s = piece.h_s;
        let thrust = self.lag_thrust(h_s, piece.share);
        let TranslationModel { gravity_m_s2, drag_per_s, bias, .. } = self.model;
        let force = piece.axis * thrust - Vector3::z() * *gravity_m_s2 + bias + self.gust;
        let middle = self.velocity + (force - self.velocity * *drag_per_s) * (h_s / 2.0);
        let gained = (force - middle * *drag_per_s) * h_s;
        self.velocity += gained;
        self.gained += gained - self.gust * h_s;
        self.position += middle * h_s;
        self.since_s += h_s;
    }

    /// Mean acceleration since the last pose, without gusts \[m/s^2\].
    fn mean_acceleration(&mut self) -> Vector3<f64> {
        std::mem::take(&mut self.gained) / self.since_s.max(SHORTEST_S)
    }

    /// Propagates the covariance over the time since the last pose, in which the gust decays.
    fn propagate(&mut self) {
        let h = self.since_s;
        let keep = (-h / self.noise.gust_s).exp();
        let transition = Matrix3::new(
            1.0,
            h,
            h * h / 2.0, //
            0.0,
            1.0 - self.model.drag_per_s * h,
            h, //
            0.0,
            0.0,
            keep,
        );
        self.covariance = transition * self.covariance * transition.transpose();
        let added = self.noise.gust_ratio.powi(2) * (1.0 - keep * keep);
        self.covariance[(2, 2)] += added;
        // Velocity variance caused by the gust added in this time, as for a random walk.
        self.covariance[(1, 1)] += added * h * h / 3.0;
        self.covariance[(1, 2)] += added * h / 2.0;
        self.covariance[(2, 1)] += added * h / 2.0;
        self.gust *= keep;
        self.since_s = 0.0;
    }

    /// Corrects the state by a measured position; returns the innovation \[m, world\] and its expected variance over the
    /// measurement variance.
    fn correct(&mut self, measured: &Vector3<f64>) -> (Vector3<f64>, f64) {
        self.propagate();
        let innovation = measured - self.position;
        let variance = self.covariance[(0, 0)] + 1.0;
        let sd = self.noise.measured_m * variance.sqrt();
        if self.lost.detects(&innovation, sd) {
            self.position = *measured;
            self.covariance = self.noise.initial();
            return (innovation, variance);
        }
        let counted = limited(&innovation, sd);
        let column = self.covariance.column(0).into_owned();
        let gain = column / variance;
        self.position += counted * gain.x;
        self.velocity += counted * gain.y;
        self.gust += counted * gain.z;
        self.covariance -= gain * column.transpose();
        (innovation, variance)
    }
}
