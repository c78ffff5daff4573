//! The linear model of the attitude loop about one axis, for commanded rates: law, filter, prediction, hold, delay, vehicle.
//!
//! A pose is captured at `s_k = k T`, and the command made of it acts from `s_k + D` for a period. The vehicle is
//! `theta' = omega`, `omega' = (A u - omega) / lag`. The position loop is open. Gains are taken from the laws and filters
//! themselves, by small errors.

use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix3, Vector3};
use oqtal_config::Config;
use oqtal_control::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, Controller, ControllerName, InputForm, OqtalDt,
    RateInput,
};
use oqtal_control::options::OptionError;
use oqtal_control::predictive::{AttitudeFilter, Rotation};
use oqtal_control::quaternion::Attitude;

use super::frequency::LoopResponse;

type ComplexVector = Vector3<Complex<f64>>;
type ComplexMatrix = Matrix3<Complex<f64>>;

/// Small error by which a law is made linear \[rad\].
const SMALL_RAD: f64 = 1e-6;
/// Poses after which a filter's gain is steady \[-\].
const STEADY: usize = 20_000;
/// Lowest frequency of a response \[Hz\], and number of its points.
const LOWEST_HZ: f64 = 0.05;
const POINTS: usize = 1500;

/// From input to motion of an axis: a vehicle, or a model of one.
#[derive(Clone, Copy, Debug)]
struct AxisModel {
    authority: f64,
    lag_s: f64,
    /// From the capture of a pose to the effect of the command made of it \[s\].
    delay_s: f64,
    period_s: f64,
}

/// What an attitude law does about a small error of one axis: `u = -(attitude + slope / (z - 1)) theta - rate omega`.
#[derive(Clone, Copy, Debug)]
struct LawGains {
    /// Of the attitude \[1/rad\].
    attitude: f64,
    /// Growth of the input in each tick, per attitude error \[1/rad\].
    slope: f64,
    /// Of the rate \[s/rad\].
    rate: f64,
}

/// The loop about one axis.
#[derive(Clone, Debug)]
pub struct LinearLoop {
    vehicle: AxisModel,
    law: LawGains,
    /// The model and the steady gain of the filter of `oqtal-dt`, where the law is within its surroundings.
    predictor: Option<(AxisModel, Vector3<f64>)>,
}

impl LinearLoop {
    /// The loop of `config` about axis number `axis`.
    ///
    /// # Errors
    /// An option of the law is invalid.
    pub fn new(config: &Config, axis: usize) -> Result<Self, OptionError> {
        let (vehicle, plant) = (&config.vehicle, &config.plant);
        let period_s = 1.0 / config.control.rate_hz;
        let latency_s = 1e-3 * (config.mocap.latency_ms + 0.5 * config.mocap.jitter_ms);
        let model = AxisModel {
            authority: vehicle.rate_authority_rad_s[axis],
            lag_s: 1e-3 * vehicle.rate_lag_ms,
            // The delay of commands is measured, as far as stamps show it.
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
        Ok(Self { vehicle: plant, law: law_gains(config, axis)?, predictor })
    }

    /// The loop over frequency, up to half of the loop's rate.
    #[must_use]
    pub fn response(&self) -> LoopResponse {
        let highest = 0.5 / self.vehicle.period_s;
        let step = (highest / LOWEST_HZ).powf(1.0 / POINTS as f64);
        let hertz = (0..POINTS).map(|index| LOWEST_HZ * step.powi(index as i32));
        LoopResponse { points: hertz.map(|hertz| (hertz, self.at(hertz))).collect() }
    }

    /// The loop gain at a frequency \[Hz\].
    #[must_use]
    pub fn at(&self, hertz: f64) -> Complex<f64> {
        let z = Complex::from_polar(1.0, TAU * hertz * self.vehicle.period_s);
        self.controller(z) * self.vehicle.motion(z).x
    }

    /// From the measured attitude to the input, with the sign of negative feedback.
    fn controller(&self, z: Complex<f64>) -> Complex<f64> {
        let LawGains { attitude, slope, rate } = self.law;
        let of_attitude = attitude + slope / (z - 1.0);
        let Some((model, gain)) = &self.predictor else { return of_attitude };
        let authority = Complex::from(model.authority.recip());
        let kappa = ComplexVector::new(of_attitude, rate.into(), authority);
        // x = (I - L h) (F x / z + g u) + L y, with g the effect of commands sent, a period later than in `motion`.
        let keep = (Matrix3::identity() - gain * Vector3::x().transpose()).map(Complex::from);
        let carried = keep * model.transition(model.period_s).map(Complex::from) / z;
        let Some(solve) = (ComplexMatrix::identity() - carried).try_inverse() else {
            return Complex::from(f64::NAN);
        };
        let by_input = solve * keep * model.between_poses(z) / z;
        let by_pose = solve * gain.map(Complex::from);
        let ahead = model.transition(model.delay_s).map(Complex::from);
        let own = kappa.dot(&(ahead * by_input + model.in_transit(z)));
        kappa.dot(&(ahead * by_pose)) / (own + 1.0)
    }
}

impl AxisModel {
    /// Transition of `[theta; omega; d]`, `d` a bias of the commanded rate, over `t_s` \[s\].
    fn transition(&self, t_s: f64) -> Matrix3<f64> {
        let decay = (-t_s / self.lag_s).exp();
        let turn = self.lag_s * (1.0 - decay);
        Matrix3::new(1.0, turn, t_s - turn, 0.0, decay, 1.0 - decay, 0.0, 0.0, 1.0)
    }

    /// Effect on `[theta; omega; d]` at the end of `t_s` \[s\] of an input held over the `held_s` \[s\] that end `after_s` \[s\] before.
    fn effect(&self, held_s: f64, after_s: f64) -> Vector3<f64> {
        let bias = self.transition(held_s).column(2).into_owned();
        let moved = self.transition(after_s) * Vector3::new(bias.x, bias.y, 0.0);
        moved * self.authority
    }

    /// Whole periods of the delay \[-\], and the rest \[s\].
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

    /// From the input to `[theta; omega; 0]` at the poses.
    fn motion(&self, z: Complex<f64>) -> ComplexVector {
        let transition = self.transition(self.period_s).map(Complex::from);
        let solve = (ComplexMatrix::identity() * z - transition).try_inverse();
        solve.map_or_else(
            || ComplexVector::repeat(Complex::from(f64::NAN)),
            |inverse| inverse * self.between_poses(z),
        )
    }

    /// Effect on `[theta; omega; d]`, at the instant at which input `k` acts, of the inputs before it that act since pose `k`.
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

/// Gain of the attitude filter once it is steady.
fn steady_gain(config: &Config, model: &AxisModel) -> Vector3<f64> {
    let options = &config.control.predictive.filter;
    let filter = AttitudeFilter::new(options);
    let transition = filter.transition(&Rotation::RateLoop { lag_s: model.lag_s }, model.period_s);
    let mut covariance = *filter.covariance();
    let mut gain = Vector3::zeros();
    for _ in 0..STEADY {
        covariance.predict(&transition);
        gain = covariance.correct(options.attitude_noise_deg.to_radians());
    }
    gain
}

/// The gains of the law about an axis.
fn law_gains(config: &Config, axis: usize) -> Result<LawGains, OptionError> {
    let (vehicle, control) = (&config.vehicle, &config.control);
    let period_s = 1.0 / control.rate_hz;
    let input = RateInput::new(Vector3::from(vehicle.rate_authority_rad_s))?
        .with_lag(1e-3 * vehicle.rate_lag_ms, period_s)?;
    if control.controller == ControllerName::OqtalDt {
        let law = OqtalDt::new(control.oqtal_dt, input, period_s)?;
        let gain = law.gain();
        // eps is half of the angle.
        return Ok(LawGains {
            attitude: 0.5 * gain[(axis, axis + 3)],
            slope: 0.0,
            rate: gain[(axis, axis)],
        });
    }
    let mut law = Controller::new(&control.controller_options(), input)?;
    let mut error = Vector3::zeros();
    error[axis] = SMALL_RAD;
    let state = AttitudeState {
        attitude: Attitude::from_rotation_vector(error),
        ..AttitudeState::default()
    };
    let mut answer = || {
        let command = law.update(&state, &AttitudeReference::default(), period_s);
        -RateInput::u_from(command)[axis] / SMALL_RAD
    };
    let [first, second] = [answer(), answer()];
    Ok(LawGains { attitude: first, slope: second - first, rate: 0.0 })
}
