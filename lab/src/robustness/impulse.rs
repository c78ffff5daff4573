//! Attitude law about one axis as a linear filter: responses to a small impulse of attitude and of rate.
//!
//! The law itself is updated tick by tick, so that the response includes its integrals, filters and past inputs.

use nalgebra::{Complex, Vector3};
use oqtal_control::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, ControlOptions, Controller, InputForm, RateInput,
};
use oqtal_control::options::OptionError;
use oqtal_control::quantity::BodyRate;
use oqtal_control::quaternion::Attitude;

/// Size of the impulse \[rad, rad/s\].
const SMALL: f64 = 1e-6;
/// Number of ticks after which a response is steady \[-\]; the remainder is due to an integral.
const TICKS: usize = 4096;

/// Response of a law to an impulse, per unit of the impulse, for negative feedback.
#[derive(Clone, Debug, PartialEq)]
pub struct ImpulseResponse {
    /// Input in each tick after the impulse; the last one continues indefinitely.
    ticks: Vec<f64>,
}

impl ImpulseResponse {
    /// Responses of the law of `options`, updated once in `period_s` \[s\], to attitude \[1/rad\] and rate \[s/rad\] about axis number
    /// `axis`.
    ///
    /// # Errors
    /// An option of the law is not allowed.
    pub fn of(
        (options, period_s): (&ControlOptions, f64),
        input: RateInput,
        axis: usize,
    ) -> Result<[Self; 2], OptionError> {
        let mut small = Vector3::zeros();
        small[axis] = SMALL;
        let turned = AttitudeState {
            attitude: Attitude::from_rotation_vector(small),
            ..AttitudeState::default()
        };
        let turning = AttitudeState { rate: BodyRate(small), ..AttitudeState::default() };
        let response = |impulse: AttitudeState| -> Result<Self, OptionError> {
            let mut law = Controller::new(options, input)?;
            // The first update initialises the filters.
            law.update(&AttitudeState::default(), &AttitudeReference::default(), period_s);
            let tick = |index: usize| {
                let state = if index == 0 { impulse } else { AttitudeState::default() };
                let command = law.update(&state, &AttitudeReference::default(), period_s);
                -RateInput::u_from(command)[axis] / SMALL
            };
            Ok(Self { ticks: shortened((0..TICKS).map(tick).collect()) })
        };
        Ok([response(turned)?, response(turning)?])
    }

    /// Transfer function at `z`.
    pub fn at(&self, z: Complex<f64>) -> Complex<f64> {
        let Some((last, others)) = self.ticks.split_last() else { return Complex::from(0.0) };
        let per_tick = z.inv();
        // Tail of the last value: sum_{j >= 0} z^-j = z / (z - 1).
        let tail = if *last == 0.0 { Complex::from(0.0) } else { *last * z / (z - 1.0) };
        others.iter().rev().fold(tail, |sum, tick| sum * per_tick + tick)
    }
}

/// Response without the ticks that repeat the last one; values below the rounding error are set to zero.
fn shortened(mut ticks: Vec<f64>) -> Vec<f64> {
    let greatest = ticks.iter().fold(0.0, |most: f64, tick| most.max(tick.abs()));
    let mut last = ticks.last().copied().unwrap_or(0.0);
    if last.abs() < 1e-9 * greatest {
        last = 0.0;
    }
    let steady = |tick: &f64| (tick - last).abs() < 1e-9 * greatest;
    let kept = ticks.iter().rposition(|tick| !steady(tick)).map_or(0, |index| index + 1);
    ticks.truncate(kept);
    ticks.push(last);
    ticks
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_control::controller::ControllerName;

    fn responses(controller: ControllerName, options: ControlOptions) -> [ImpulseResponse; 2] {
        let period_s = 1.0 / 60.0;
        let input = RateInput::new(Vector3::repeat(2.0)).unwrap().with_lag(0.05, period_s).unwrap();
        let options = ControlOptions { controller, ..options };
        ImpulseResponse::of((&options, period_s), input, 1).unwrap()
    }

    #[test]
    fn a_proportional_law_is_a_number_at_every_frequency() {
        let options = ControlOptions::default();
        let [attitude, rate] = responses(ControllerName::Px4, options);
        for turn in [0.01, 0.5, 3.0] {
            let z = Complex::from_polar(1.0, turn);
            let expected = options.px4.attitude_gain_per_s / 2.0;
            assert!((attitude.at(z) - expected).norm() < 1e-6);
            assert!(rate.at(z).norm() < 1e-6);
        }
    }

    #[test]
    fn an_integral_is_a_pole_at_one() {
        let options = ControlOptions::default();
        let [attitude, _] = responses(ControllerName::Pid, options);
        let (k, t) = (options.pid.gain, options.pid.integral_time_s);
        let z = Complex::from_polar(1.0, 0.3);
        // eps is half of the angle; the authority is 2 rad/s.
        let expected = k / 2.0 * (1.0 + 1.0 / t / 60.0 / (z - 1.0));
        let error = (attitude.at(z) - expected).norm() / expected.norm();
        assert!(error < 1e-3, "{} {expected}", attitude.at(z));
    }
}
