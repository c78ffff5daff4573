//! Recursive prediction-error estimate of the response to commanded rates: gain, lag and hidden delay.
//!
//! About each axis the state `[theta; omega; d]` follows `omega' = (g u(t - s) + d - omega) / l`, the sticks' demand `u` with
//! the gain `g`, the lag `l` and the delay `s` that no report shows. A Kalman filter estimates the state for the present
//! parameters. The sensitivity of its prediction to the parameters is propagated with the state; through it the innovations
//! correct the parameters, too (Friedland, *Treatment of bias in recursive filtering*, IEEE Trans. Automatic Control 14, 1969;
//! Ljung, *Asymptotic behavior of the extended Kalman filter as a parameter estimator*, the same, 24, 1979). The axes share the
//! parameters; their coupling, of the size of the angle turned between two poses, is neglected as in the attitude filter. Only
//! roll and pitch correct the parameters: yaw, which rotors turn by their drag alone, responds more slowly on most vehicles.

use nalgebra::{Matrix3, RowVector3, Vector3};

use super::attitude_filter::AttitudeFilter;
use super::history::CommandHistory;
use super::model::{Motion, Rotation};
use super::options::FilterOptions;
use crate::quaternion::Attitude;

/// Walk of the body rate \[rad/s\] and of the bias of the demand \[rad/s\] per second: smaller than in a filter that must
/// compensate a wrong model.
const RATE_WALK: f64 = 0.05;
const BIAS_WALK: f64 = 0.002;

/// Time constant with which the uncertainty of a parameter returns to its initial value \[s\].
const MEMORY_S: f64 = 120.0;

/// Least estimated lag \[s\]: a shorter one decays between two poses and cannot be distinguished from zero. With a bound of 5 ms,
/// a vehicle with that lag and no delay oscillated until it was stopped when commands were lost in bursts.
const LEAST_LAG_S: f64 = 10e-3;

/// Innovation above which a pose corrects no parameter \[standard deviations\].
const OUTLIER_SIGMA: f64 = 5.0;

/// Relative step of the differences by which sensitivities are computed \[-\].
const STEP: f64 = 1e-4;

/// Number of axes whose innovations correct the parameters: roll and pitch \[-\].
const TEACHING_AXES: usize = 2;

/// Number of parameters \[-\].
const PARAMETERS: usize = 3;

/// Response to commanded rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateResponse {
    /// Rate over the commanded one, at rest \[-\].
    pub gain: f64,
    /// Time constant \[s\].
    pub lag_s: f64,
    /// Delay that no report shows \[s\].
    pub delay_s: f64,
}

impl RateResponse {
    fn vector(&self) -> Vector3<f64> {
        Vector3::new(self.gain, self.lag_s, self.delay_s)
    }

    fn of(vector: &Vector3<f64>) -> Self {
        Self { gain: vector.x, lag_s: vector.y, delay_s: vector.z }
    }
}

/// Prior knowledge of a response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ResponseBounds {
    /// Expected response.
    pub nominal: RateResponse,
    /// Greatest deviation from it; zero for a known parameter.
    pub deviation: RateResponse,
}

impl ResponseBounds {
    /// Prior covariance: the bounds are two standard deviations away.
    fn covariance(&self) -> Matrix3<f64> {
        let sd = self.deviation.vector() * 0.5;
        Matrix3::from_diagonal(&sd.component_mul(&sd))
    }

    fn clamp(&self, parameters: &Vector3<f64>) -> Vector3<f64> {
        let (nominal, most) = (self.nominal.vector(), self.deviation.vector());
        let off = (parameters - nominal).zip_map(&most, |off, most| off.clamp(-most, most));
        let mut clamped = nominal + off;
        clamped.y = clamped.y.max(nominal.y.min(LEAST_LAG_S)).max(0.1 * nominal.y);
        clamped
    }
}

/// State and parameters of the rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotationEstimator {
    bounds: ResponseBounds,
    filter: AttitudeFilter,
    motion: Motion,
    /// Sensitivity of `[theta; omega; d]` about each axis to the parameters \[units of both\].
    sensitivity: [Matrix3<f64>; 3],
    parameters: Vector3<f64>,
    covariance: Matrix3<f64>,
}

impl RotationEstimator {
    /// An estimator within `bounds`, for poses with the attitude noise of `options`, from `attitude` on.
    pub fn new(bounds: ResponseBounds, options: &FilterOptions, attitude: Attitude) -> Self {
        let options =
            FilterOptions { rate_walk_rad_s: RATE_WALK, demand_bias_walk: BIAS_WALK, ..*options };
        Self {
            bounds,
            filter: AttitudeFilter::new(&options),
            motion: Motion { attitude, ..Motion::default() },
            sensitivity: [Matrix3::zeros(); 3],
            parameters: bounds.nominal.vector(),
            covariance: bounds.covariance(),
        }
    }

    /// The estimator with its initial parameters, in the state of `other`.
    pub fn restarted(&self, other: &Self) -> Self {
        let (parameters, covariance) = (self.bounds.nominal.vector(), self.bounds.covariance());
        let sensitivity = [Matrix3::zeros(); 3];
        Self { bounds: self.bounds, parameters, covariance, sensitivity, ..*other }
    }

    /// Takes further poses with the attitude noise of `options`.
    pub fn set_noise(&mut self, options: &FilterOptions) {
        self.filter.axis.set_noise(options.attitude_noise_deg.to_radians());
    }

    /// Estimated response.
    pub fn response(&self) -> RateResponse {
        RateResponse::of(&self.parameters)
    }

    /// Standard deviations of the estimate.
    pub fn deviations(&self) -> RateResponse {
        RateResponse::of(&self.covariance.diagonal().map(f64::sqrt))
    }

    /// Body rate estimated at the last pose \[rad/s, body axes\].
    pub fn rate(&self) -> &Vector3<f64> {
        &self.motion.rate
    }

    /// Takes the attitude measured at the end of an interval \[s\]. Returns the innovation \[rad, body axes\] and its variance about
    /// each axis without that of the parameters \[rad^2\].
    pub fn take(
        &mut self,
        measured: &Attitude,
        history: &CommandHistory,
        interval: (f64, f64),
    ) -> (Vector3<f64>, f64) {
        self.predict(history, interval);
        let innovation = self.motion.attitude.rotation_to(measured);
        let variance = self.filter.axis.innovation_variance();
        let noise = self.filter.axis.noise();
        let gain = self.filter.correct(&mut self.motion, &innovation, noise);
        let before = self.parameters;
        for (axis, off) in innovation.iter().enumerate() {
            let slope: RowVector3<f64> = self.sensitivity[axis].row(0).into_owned();
            self.sensitivity[axis] -= gain * slope;
            if axis >= TEACHING_AXES {
                continue;
            }
            // Part of the innovation is explained by the corrections from the other axes.
            let explained = slope.dot(&(self.parameters - before).transpose());
            self.learn((*off - explained, variance), &slope);
            // A command does not take effect before it is sent.
            self.parameters.z = self.parameters.z.max(-history.delay_s());
        }
        self.shift(&(self.parameters - before));
        (innovation, variance)
    }

    /// Corrects the parameters by an innovation \[rad\] of this variance, whose sensitivity to them is `slope`.
    fn learn(&mut self, (off, variance): (f64, f64), slope: &RowVector3<f64>) {
        let spread = self.covariance * slope.transpose();
        let expected = variance + slope.dot(&spread.transpose());
        if off * off > OUTLIER_SIGMA * OUTLIER_SIGMA * expected || expected <= 0.0 {
            return;
        }
        let gain = spread / expected;
        self.parameters = self.bounds.clamp(&(self.parameters + gain * off));
        self.covariance -= gain * spread.transpose();
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
    }

    /// Moves the state to the value that it would have if the parameters had always differed by `change`.
    fn shift(&mut self, change: &Vector3<f64>) {
        let shifts = self.sensitivity.map(|sensitivity| sensitivity * change);
        let part = |state: usize| Vector3::from(shifts.map(|shift| shift[state]));
        self.motion.attitude = self.motion.attitude.turned_by(part(0));
        self.motion.rate += part(1);
        self.filter.axis.shift_bias(&part(2));
    }

    /// Propagates everything over `interval` \[s\].
    fn predict(&mut self, history: &CommandHistory, (from_s, to_s): (f64, f64)) {
        let dt_s = to_s - from_s;
        let parameters = self.parameters;
        let (turn, rate) = self.turned(&parameters, history, (from_s, to_s));
        let is_fixed = self.bounds.deviation.vector() == Vector3::zeros();
        let slopes: [(Vector3<f64>, Vector3<f64>); PARAMETERS] = std::array::from_fn(|index| {
            if is_fixed {
                return Default::default();
            }
            let step = STEP * [1.0, parameters.y, parameters.y][index];
            let mut beside = parameters;
            beside[index] += step;
            let (beside_turn, beside_rate) = self.turned(&beside, history, (from_s, to_s));
            ((beside_turn - turn) / step, (beside_rate - rate) / step)
        });
        let rotation = Rotation::RateLoop { lag_s: parameters.y };
        let transition = self.filter.transition(&rotation, dt_s);
        for axis in 0..3 {
            let mut forced = Matrix3::zeros();
            for (index, (of_turn, of_rate)) in slopes.iter().enumerate() {
                (forced[(0, index)], forced[(1, index)]) = (of_turn[axis], of_rate[axis]);
            }
            self.sensitivity[axis] = transition.f * self.sensitivity[axis] + forced;
        }
        self.filter.axis.predict(&transition);
        self.motion.attitude = self.motion.attitude.turned_by(turn);
        self.motion.rate = rate;
        let forgotten = (dt_s / MEMORY_S).clamp(0.0, 1.0);
        self.covariance += (self.bounds.covariance() - self.covariance) * forgotten;
    }

    /// Rotation vector over an interval \[rad, body axes\] and rate at its end \[rad/s, body axes\], from the state at its
    /// beginning with these parameters.
    fn turned(
        &self,
        parameters: &Vector3<f64>,
        history: &CommandHistory,
        (from_s, to_s): (f64, f64),
    ) -> (Vector3<f64>, Vector3<f64>) {
        let RateResponse { gain, lag_s, delay_s } = RateResponse::of(parameters);
        let (mut turn, mut rate) = (Vector3::zeros(), self.motion.rate);
        let mut t_s = from_s;
        while t_s < to_s {
            let (input, until_s) = history.reported(t_s, delay_s);
            let end_s = until_s.min(to_s);
            let duration_s = end_s - t_s;
            let aim = input.demand * gain + self.filter.axis.bias();
            let decay = (-duration_s / lag_s).exp();
            turn += aim * duration_s + (rate - aim) * (lag_s * (1.0 - decay));
            rate = aim + (rate - aim) * decay;
            t_s = end_s;
        }
        (turn, rate)
    }
}
