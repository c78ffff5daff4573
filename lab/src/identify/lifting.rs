//! Fit of the translation: thrust, its lag and curve, drag, and constant forces.

use nalgebra::{DVector, Vector3};

use super::data::{FlightData, series};
use super::fit::{
    FitParameter, FitResult, StartingPoints, least_squares, move_to_best, precise_fit,
};
use super::noise::{Likelihood, best_in_proportion, residuals};
use super::rotation::RotationPass;
use super::translation::{TranslationModel, TranslationNoise, TranslationPass, pass};

/// Number of alternations between a fit and an estimate of the noise.
const ROUNDS: usize = 2;
/// Index of the thrust in [`LiftingFit::fit`].
const THRUST: usize = 0;
/// Index of the curvature in [`LiftingFit::fit`]; the parameters of `[vehicle]` are before it.
pub const CURVATURE: usize = 3;
/// Number of parameters before the biases.
const SHARED: usize = 4;
/// Lags of the thrust from which the fit starts beside the configured one \[s\].
const STARTS_S: [f64; 2] = [0.01, 0.15];
/// Range of the gust strength over the measurement noise \[1/s^2\].
const GUSTS: [f64; 2] = [3.0, 10_000.0];
/// Range of the correlation time of the gusts \[s\].
const GUST_TIMES: [f64; 2] = [0.05, 12.8];

/// Result of the fit of the translation.
#[derive(Clone, Debug)]
pub struct LiftingFit {
    /// Parameters, with the external acceleration of each flight.
    pub models: Vec<TranslationModel>,
    /// Values and covariance in the order thrust \[m/s^2\], lag \[s\], drag \[1/s\], curvature \[-\], accelerations \[m/s^2, world\].
    pub fit: FitResult,
    /// Noise of measurement and translation.
    pub noise: TranslationNoise,
    /// Predictions for each flight.
    pub passes: Vec<TranslationPass>,
    /// Agreement of fits from several starting points.
    pub starts: StartingPoints,
}

impl LiftingFit {
    /// Thrust over the mass per commanded share where the thrust equals the weight, and its standard deviation \[m/s^2\]. With a straight
    /// line, it is the greatest thrust.
    pub fn thrust_at_hover(&self) -> (f64, f64) {
        let model = &self.models[0];
        let (slope, share) = model.hover();
        // The change of the share for a change of thrust and curvature keeps the thrust: its total derivative is 0.
        let per_share = model.gravity_m_s2 / share;
        let of_thrust = per_share / slope * per_share / model.thrust_m_s2;
        let off = share / model.hover_share - 1.0;
        let of_curvature = per_share / slope * model.thrust_m_s2 * off;
        let covariance = |row, column| self.fit.covariance[(row, column)];
        let variance = of_thrust.powi(2) * covariance(THRUST, THRUST)
            + of_curvature.powi(2) * covariance(CURVATURE, CURVATURE)
            + 2.0 * of_thrust * of_curvature * covariance(THRUST, CURVATURE);
        (per_share, variance.max(0.0).sqrt())
    }
}

/// Flights with their predicted rotation.
#[derive(Clone, Copy, Debug)]
pub struct TurnedFlights<'a> {
    /// The flights.
    pub flights: &'a [FlightData],
    /// Rotation of each flight.
    pub rotations: &'a [RotationPass],
    /// Rotation of each flight with the command delay increased by one standard deviation.
    pub delayed: &'a [RotationPass],
}

/// Fits the translation, starting at `start`; the thrust is linear in its command unless `is_curved`.
pub fn lifting(
    turned: TurnedFlights,
    start: &TranslationModel,
    is_curved: bool,
) -> Option<LiftingFit> {
    let mut noise = TranslationNoise { measured_m: 0.5e-3, gust_ratio: 100.0, gust_s: 0.8 };
    let mut parameters = parameters(start, turned.flights.len(), is_curved);
    let series = series(turned.flights);
    let residuals = |values: &[f64]| residuals_of(turned, &models(values, start), &noise);
    let starts = STARTS_S.map(|lag_s| vec![start.thrust_m_s2, lag_s]);
    let starts = move_to_best(&mut parameters, &starts, &residuals)?;
    for _ in 0..ROUNDS {
        let residuals = |values: &[f64]| residuals_of(turned, &models(values, start), &noise);
        let found = precise_fit(&mut parameters, &series, &residuals)?;
        noise = noise_of(turned, &models(&found.values, start), noise);
    }
    let residuals = |values: &[f64]| residuals_of(turned, &models(values, start), &noise);
    let mut fit = precise_fit(&mut parameters, &series, &residuals)?;
    // The delay is taken from the rotation: the change of the parameters for one standard deviation of the delay adds to their
    // covariance.
    let delayed = TurnedFlights { rotations: turned.delayed, ..turned };
    let residuals = |values: &[f64]| residuals_of(delayed, &models(values, start), &noise);
    let beside = least_squares(&parameters, &residuals)?;
    let change = DVector::from_vec(beside) - DVector::from_column_slice(&fit.values);
    fit.covariance += &change * change.transpose();
    let models = models(&fit.values, start);
    let passes = passes(turned, &models, &noise);
    Some(LiftingFit { models, fit, noise, passes, starts })
}

fn parameters(start: &TranslationModel, flights: usize, is_curved: bool) -> Vec<FitParameter> {
    let free = |start, bounds, step| FitParameter { start, bounds, step, is_fixed: false };
    let thrust = free(start.thrust_m_s2, [0.1, 1000.0], 0.02);
    let lag = free(start.thrust_lag_s, [0.0, 0.5], 5e-4);
    let drag = free(start.drag_per_s, [-1.0, 10.0], 5e-3);
    let bend = FitParameter { is_fixed: !is_curved, ..free(0.0, [-2.0, 2.0], 1e-2) };
    let bias = free(0.0, [-9.0, 9.0], 1e-3);
    let biases = std::iter::repeat_n(bias, 3 * flights);
    [thrust, lag, drag, bend].into_iter().chain(biases).collect()
}

fn models(values: &[f64], start: &TranslationModel) -> Vec<TranslationModel> {
    let biases = values[SHARED..].chunks_exact(3).map(Vector3::from_column_slice);
    let model = |bias| TranslationModel {
        thrust_m_s2: values[0],
        thrust_lag_s: values[1],
        drag_per_s: values[2],
        curvature_ratio: values[3],
        bias,
        ..*start
    };
    biases.map(model).collect()
}

fn passes(
    turned: TurnedFlights,
    models: &[TranslationModel],
    noise: &TranslationNoise,
) -> Vec<TranslationPass> {
    let flights = turned.flights.iter().zip(turned.rotations).zip(models);
    flights.map(|((data, rotation), model)| pass(data, rotation, model, noise)).collect()
}

fn residuals_of(
    turned: TurnedFlights,
    models: &[TranslationModel],
    noise: &TranslationNoise,
) -> Vec<f64> {
    let passes = passes(turned, models, noise);
    residuals(passes.iter().map(|pass| &pass.innovations), noise.measured_m)
}

fn likelihood(passes: &[TranslationPass]) -> Likelihood {
    Likelihood::of(passes.iter().map(|pass| &pass.innovations))
}

/// Most likely noise at these parameters.
fn noise_of(
    turned: TurnedFlights,
    models: &[TranslationModel],
    noise: TranslationNoise,
) -> TranslationNoise {
    let log = |noise: TranslationNoise| likelihood(&passes(turned, models, &noise)).log;
    let mut noise = noise;
    for _ in 0..2 {
        noise.gust_ratio = best_in_proportion(GUSTS, 15, |gust_ratio| {
            log(TranslationNoise { gust_ratio, ..noise })
        });
        noise.gust_s =
            best_in_proportion(GUST_TIMES, 9, |gust_s| log(TranslationNoise { gust_s, ..noise }));
    }
    TranslationNoise { measured_m: likelihood(&passes(turned, models, &noise)).measured, ..noise }
}
