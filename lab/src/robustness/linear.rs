//! Linear model of the attitude loop about one axis, for commanded rates: law, filter, prediction, hold, delay, vehicle.
//!
//! A pose is captured at `s_k = k T`; its command is in effect from `s_k + D` for one period. The vehicle is `theta' = omega`,
//! `omega' = (A u - omega) / lag`. The position loop is open. The gains of laws and filters are measured with small errors.

use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix3, Vector3};
use oqtal_config::Config;
use oqtal_control::controller::RateInput;
use oqtal_control::options::OptionError;
use oqtal_control::predictive::{AttitudeFilter, Rotation};

use super::frequency::LoopResponse;
use super::impulse::ImpulseResponse;

type ComplexVector = Vector3<Complex<f64>>;
type ComplexMatrix = Matrix3<Complex<f64>>;

/// Number of poses after which the gain of a filter is steady \[-\].
const STEADY: usize = 20_000;
/// Lowest frequency of a response \[Hz\], and number of its points.
const LOWEST_HZ: f64 = 0.05;
const POINTS: usize = 1500;

/// Transfer function from input to motion about an axis, of a vehicle or a model.
#[derive(Clone, Copy, Debug)]
struct AxisModel {
    authority: f64,
    lag_s: f64,
    /// Time from the capture of a pose to the effect of its command \[s\].
    delay_s: f64,
    period_s: f64,
}

/// The loop about one axis.
#[derive(Clone, Debug)]
pub struct LinearLoop {
    vehicle: AxisModel,
    /// Responses of the law to attitude and rate.
    law: [ImpulseResponse; 2],
    /// Cut-off frequency of the rate estimate without prediction \[Hz\].
    rate_cutoff_hz: f64,
    /// Model and steady gain of the filter of `oqtal-dt`, for a law on the predictive stack.
    predictor: Option<(AxisModel, Vector3<f64>)>,
}

impl LinearLoop {
    /// The loop of `config` about axis number `axis`.
    ///
    /// # Errors
    /// An option of the law is invalid.
    pub fn new(config: &Config, axis: usize) -> Result<Self, OptionError> {
        let (vehicle, plant) = (&config.vehicle, &config.plant);
        let period_s = 1.0 / config.loop_rate_hz();
        let latency_s = 1e-3 * (config.mocap.latency_ms + 0.5 * config.mocap.jitter_ms);
        let model = AxisModel {
            authority: vehicle.rate_authority_rad_s[axis],
            lag_s: 1e-3 * vehicle.rate_lag_ms,
            // The delay of commands is measured from stamps; a hidden delay has no stamps.
            delay_s: latency_s + 1e-3 * plant.command_delay_ms,
            period_s,
        };
        let plant = AxisModel {
            authority: plant.rate_authority_rad_s[axis],
            lag_s: 1e-3 * plant.rate_lag_ms * plant.rate_lag_ratio[axis],
            delay_s: model.delay_s + 1e-3 * plant.hidden_delay_ms,
            period_s,
        };
        let is_predictive = config.control.is_predictive();
        let predictor = is_predictive.then(|| (model, steady_gain(config, &model)));
        let input = RateInput::new(Vector3::from(vehicle.rate_authority_rad_s))?
            .with_lag(1e-3 * vehicle.rate_lag_ms, 1.0 / config.control.rate_hz)?;
        let law = ImpulseResponse::of((&config.control, period_s), input, axis)?;
        let rate_cutoff_hz = config.control.estimator.rate_cutoff_hz;
        Ok(Self { vehicle: plant, law, rate_cutoff_hz, predictor })
    }

    /// Loop response up to half the loop rate.
    pub fn response(&self) -> LoopResponse {
        let highest = 0.5 / self.vehicle.period_s;
        let step = (highest / LOWEST_HZ).powf(1.0 / POINTS as f64);
        let hertz = (0..POINTS).map(|index| LOWEST_HZ * step.powi(index as i32));
        LoopResponse { points: hertz.map(|hertz| (hertz, self.at(hertz))).collect() }
    }

    /// The loop gain at a frequency \[Hz\].
    pub fn at(&self, hertz: f64) -> Complex<f64> {
        let z = Complex::from_polar(1.0, TAU * hertz * self.vehicle.period_s);
        self.controller(z) * self.vehicle.motion(z).x
    }

    /// Transfer from the measured attitude to the input, with the sign of negative feedback.
    fn controller(&self, z: Complex<f64>) -> Complex<f64> {
        let [of_attitude, of_rate] = self.law.each_ref().map(|response| response.at(z));
        let Some((model, gain)) = &self.predictor else {
            return of_attitude + of_rate * self.differentiated(z);
        };
        let authority = Complex::from(model.authority.recip());
        let kappa = ComplexVector::new(of_attitude, of_rate, authority);
        // x = (I - L h) (F x / z + g u) + L y; g is the effect of commands sent, one period later than in `motion`.
        let keep = (Matrix3::identity() - gain * Vector3::x().transpose()).map(Complex::from);
        let propagated = keep * model.transition(model.period_s).map(Complex::from) / z;
        let Some(solve) = (ComplexMatrix::identity() - propagated).try_inverse() else {
            return Complex::from(f64::NAN);
        };
        let by_input = solve * keep * model.between_poses(z) / z;
        let by_pose = solve * gain.map(Complex::from);
        let ahead = model.transition(model.delay_s).map(Complex::from);
        let own = kappa.dot(&(ahead * by_input + model.in_transit(z)));
        kappa.dot(&(ahead * by_pose)) / (own + 1.0)
    }

    /// Transfer from the measured attitude to the estimated rate.
    fn differentiated(&self, z: Complex<f64>) -> Complex<f64> {
        let period_s = self.vehicle.period_s;
        let weight = -(-TAU * self.rate_cutoff_hz * period_s).exp_m1();
        weight * (z - 1.0) / period_s / (z - 1.0 + weight)
    }
}

impl AxisModel {
    /// Transition of `[theta; omega; d]`, `d` a bias of the commanded rate, over `t_s` \[s\].
    fn transition(&self, t_s: f64) -> Matrix3<f64> {
        let decay = (-t_s / self.lag_s).exp();
        let turn = self.lag_s * (1.0 - decay);
        Matrix3::new(1.0, turn, t_s - turn, 0.0, decay, 1.0 - decay, 0.0, 0.0, 1.0)
    }

    /// Effect on `[theta; omega; d]` at the end of `t_s` \[s\] of an input applied for `held_s` \[s\], ending `after_s` \[s\]
    /// before that.
    fn effect(&self, held_s: f64, after_s: f64) -> Vector3<f64> {
        let bias = self.transition(held_s).column(2).into_owned();
        let moved = self.transition(after_s) * Vector3::new(bias.x, bias.y, 0.0);
        moved * self.authority
    }

    /// Whole periods of the delay \[-\], and the remainder \[s\].
    fn delay(&self) -> (i32, f64) {
        let whole = (self.delay_s / self.period_s + 1e-9).floor();
        (whole as i32, (self.delay_s - whole * self.period_s).max(0.0))
    }

    /// Effect of the inputs on the motion between the poses `k` and `k + 1`, per input `k`.
    fn between_poses(&self, z: Complex<f64>) -> ComplexVector {
        let (whole, rest) = self.delay();
        let newer = self.effect(self.period_s - rest, 0.0).map(Complex::from);
        let older = self.effect(rest, self.period_s - rest).map(Complex::from);
        newer * z.powi(-whole) + older * z.powi(-whole - 1)
    }

    /// Transfer from the input to `[theta; omega; 0]` at the poses.
    fn motion(&self, z: Complex<f64>) -> ComplexVector {
        let transition = self.transition(self.period_s).map(Complex::from);
        let solve = (ComplexMatrix::identity() * z - transition).try_inverse();
        solve.map_or_else(
            || ComplexVector::repeat(Complex::from(f64::NAN)),
            |inverse| inverse * self.between_poses(z),
        )
    }

    /// Effect on `[theta; omega; d]`, at the instant at which input `k` takes effect, of the earlier inputs in effect since pose
    /// `k`.
    fn in_transit(&self, z: Complex<f64>) -> ComplexVector {
        let (whole, rest) = self.delay();
        let mut sum = self.effect(rest, f64::from(whole) * self.period_s).map(Complex::from)
            * z.powi(-whole - 1);
        for age in 1..=whole {
            let after_s = f64::from(age - 1) * self.period_s;
            sum += self.effect(self.period_s, after_s).map(Complex::from) * z.powi(-age);
        }
        sum
    }
}

/// Steady gain of the attitude filter.
fn steady_gain(config: &Config, model: &AxisModel) -> Vector3<f64> {
    let options = &config.control.predictive.filter;
    let filter = AttitudeFilter::new(options);
    let transition = filter.transition(&Rotation::RateLoop { lag_s: model.lag_s }, model.period_s);
    let mut covariance = *filter.axis.covariance();
    let mut gain = Vector3::zeros();
    for _ in 0..STEADY {
        covariance.predict(&transition);
        gain = covariance.correct(options.attitude_noise_deg.to_radians());
    }
    gain
}
