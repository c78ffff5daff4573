//! Fit of the rotation: delay, lag, authority and bias.

use nalgebra::Vector3;

use super::data::{FlightData, series};
use super::fit::{FitParameter, FitResult, StartingPoints, move_to_best, precise_fit};
use super::noise::{Likelihood, best_in_proportion, residuals};
use super::rotation::{RotationModel, RotationNoise, RotationPass, pass};

/// Number of alternations between a fit and an estimate of the noise.
const ROUNDS: usize = 2;
/// Index of the squared second lag among the parameters; those of `[vehicle]` are before it.
pub const FAST: usize = 5;
/// Number of parameters before the biases.
const SHARED: usize = 6;
/// Longest second lag \[s\].
const LONGEST_FAST_S: f64 = 15e-3;
/// Delays and lags from which the fit starts beside the configured ones \[s\].
const STARTS_S: [[f64; 2]; 3] = [[5e-3, 0.15], [0.08, 0.02], [0.03, 0.06]];
/// Range of the rate's random walk over the measurement noise \[1/s\].
const WALKS: [f64; 2] = [0.1, 1000.0];

/// Result of the fit of the rotation.
#[derive(Clone, Debug)]
pub struct TurningFit {
    /// Parameters, with the bias of each flight.
    pub models: Vec<RotationModel>,
    /// Values and covariance in the order delay \[s\], lag \[s\], authority \[rad/s, body\], square of the second lag \[s^2\],
    /// biases \[rad/s, body\].
    pub fit: FitResult,
    /// Noise of measurement and rotation.
    pub noise: RotationNoise,
    /// Predictions for each flight.
    pub passes: Vec<RotationPass>,
    /// Agreement of fits from several starting points.
    pub starts: StartingPoints,
}

/// Fits the rotation to `flights`, starting at `start`. The fit includes a second lag, so that a second-order loop does not bias
/// the other parameters. The loop of `[vehicle]` is of first order, so this lag becomes part of the delay.
pub fn turning(flights: &[FlightData], start: &RotationModel) -> Option<TurningFit> {
    let mut noise = RotationNoise { measured_rad: 3e-3, walk_ratio: 30.0 };
    let mut parameters = parameters(start, flights.len());
    let residuals = |values: &[f64]| residuals_of(flights, &models(values), &noise);
    let starts = STARTS_S.map(Vec::from);
    let starts = move_to_best(&mut parameters, &starts, &residuals)?;
    for _ in 0..ROUNDS {
        let found = fit_under(flights, &mut parameters, &noise)?;
        noise = noise_of(flights, &models(&found.values), noise);
    }
    // The second lag is fitted last: far from the solution it would end at its bound.
    parameters[FAST].is_fixed = false;
    let fit = fit_under(flights, &mut parameters, &noise)?;
    let models = models(&fit.values);
    let passes = passes(flights, &models, &noise);
    Some(TurningFit { models, fit, noise, passes, starts })
}

impl TurningFit {
    /// Predictions for `flights` with the delay increased by one standard deviation, and the other parameters fitted to it.
    pub fn delayed(&self, flights: &[FlightData]) -> Vec<RotationPass> {
        let covariance = self.fit.covariance.column(0);
        let sd_s = covariance[0].max(f64::MIN_POSITIVE).sqrt();
        let moved =
            self.fit.values.iter().zip(&covariance).map(|(value, with)| value + with / sd_s);
        passes(flights, &models(&moved.collect::<Vec<_>>()), &self.noise)
    }
}

fn fit_under(
    flights: &[FlightData],
    parameters: &mut [FitParameter],
    noise: &RotationNoise,
) -> Option<FitResult> {
    let residuals = |values: &[f64]| residuals_of(flights, &models(values), noise);
    precise_fit(parameters, &series(flights), &residuals)
}

fn parameters(start: &RotationModel, flights: usize) -> Vec<FitParameter> {
    let time = |start| FitParameter { start, bounds: [0.0, 0.3], step: 2e-4, is_fixed: false };
    let lag = FitParameter { bounds: [1e-3, 1.0], ..time(start.lag_s) };
    let rate = |start| FitParameter { start, bounds: [-50.0, 50.0], step: 1e-3, is_fixed: false };
    let authority = start.authority.iter().map(|authority| rate(*authority));
    let biases = (0..3 * flights).map(|_| rate(0.0));
    let times = [time(start.delay_s), lag].into_iter();
    // The lag is fitted as its square: the effect of a lag within the delay grows quadratically, and the derivative with respect
    // to the square does not vanish at 0.
    let longest = LONGEST_FAST_S * LONGEST_FAST_S;
    let fast = FitParameter { start: 0.0, bounds: [0.0, longest], step: 4e-6, is_fixed: true };
    times.chain(authority).chain([fast]).chain(biases).collect()
}

/// Parameters of each flight, from the values of a fit.
fn models(values: &[f64]) -> Vec<RotationModel> {
    let (delay_s, lag_s) = (values[0], values[1]);
    let authority = Vector3::from_column_slice(&values[2..FAST]);
    // Limited to the delay.
    let fast_s = values[FAST].max(0.0).sqrt().min(delay_s);
    let biases = values[SHARED..].chunks_exact(3).map(Vector3::from_column_slice);
    biases.map(|bias| RotationModel { delay_s, lag_s, fast_s, authority, bias }).collect()
}

fn passes(
    flights: &[FlightData],
    models: &[RotationModel],
    noise: &RotationNoise,
) -> Vec<RotationPass> {
    flights.iter().zip(models).map(|(data, model)| pass(data, model, noise)).collect()
}

fn residuals_of(
    flights: &[FlightData],
    models: &[RotationModel],
    noise: &RotationNoise,
) -> Vec<f64> {
    let passes = passes(flights, models, noise);
    residuals(passes.iter().map(|pass| &pass.innovations), noise.measured_rad)
}

fn likelihood(passes: &[RotationPass]) -> Likelihood {
    Likelihood::of(passes.iter().map(|pass| &pass.innovations))
}

/// Most likely noise at these parameters.
fn noise_of(
    flights: &[FlightData],
    models: &[RotationModel],
    noise: RotationNoise,
) -> RotationNoise {
    let with = |walk_ratio| RotationNoise { walk_ratio, ..noise };
    let log = |walk_ratio| likelihood(&passes(flights, models, &with(walk_ratio))).log;
    let noise = with(best_in_proportion(WALKS, 17, log));
    RotationNoise { measured_rad: likelihood(&passes(flights, models, &noise)).measured, ..noise }
}
