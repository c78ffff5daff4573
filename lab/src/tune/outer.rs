//! Tuning of the six PIDs of Fig. 16, one at a time: single input, single output, as in the in-flight tuning of the paper's
//! reference \[27\].
//!
//! X and Y share their gains, so there are four searches, inner loops first. Each has a separate objective: the error of the
//! controlled variable relative to the loop's reference, and the command jitter.

use oqtal_config::Config;
use oqtal_control::statistics::mean;
use oqtal_observe::flight::{Flight, FlightSample};
use oqtal_runtime::process::{Exit, Failure};
use rayon::prelude::*;

use super::search::{Budget, SearchPath, TrainingFlights, Tuned, search, settings};
use super::space::{OUTER, configured, present, values};
use crate::progress::Progress;
use crate::study::flights::path;
use crate::study::metric::of_hover;

/// Weight of the command jitter relative to the error \[-\]: close tracking must not come at the expense of the attitude.
const JITTER_WEIGHT: f64 = 1.0;

/// Error of the variable that a loop controls.
type LoopError = fn(&FlightSample) -> f64;

/// Errors of the loops of [`OUTER`].
static ERRORS: [LoopError; 4] = [
    |sample| sample.velocity_error().z.abs(),
    |sample| sample.velocity_error().xy().norm(),
    |sample| sample.position_error().z.abs(),
    |sample| sample.position_error().xy().norm(),
];

/// Checks the error and the jitter with the configured gains, which the search improves. The jitter has a meaning only for a vehicle that
/// is commanded by rates.
fn check_reference([off, jitter]: [f64; 2]) -> Result<(), Failure> {
    if off.is_finite() && !jitter.is_infinite() {
        return Ok(());
    }
    let reason = "tune outer: a path with the configured gains of `oqtal` does not land, so that there is nothing to improve; tune the law first with `oqtal tune oqtal` and the configuration of this command";
    Err(Failure::new(Exit::Flight, reason))
}

/// Objective of a loop: error and jitter over those of the reference \[-\]; the error alone where the jitter has no meaning.
fn loop_objective([off, jitter]: [f64; 2], reference: [f64; 2]) -> f64 {
    let off = off / reference[0];
    match reference[1].is_nan() {
        true => off,
        false => (off + JITTER_WEIGHT * jitter / reference[1]) / (1.0 + JITTER_WEIGHT),
    }
}

/// Tunes the loops in turn around `oqtal` with its configured gains; each loop has its share of the budget and uses the gains
/// found for the previous loops.
///
/// # Errors
/// A setting is invalid, the search was interrupted, or a path with the configured gains does not land (exit code 1).
pub fn tune(
    budget: &Budget,
    flights: &TrainingFlights,
    progress: &Progress,
) -> Result<Tuned, Failure> {
    let bar = progress.start("tuning the outer loops", budget.points);
    let share = Budget { points: budget.points / OUTER.len(), ..*budget };
    let config = Config::from_settings(&flights.settings)?;
    let mut found: Vec<(String, f64)> = Vec::new();
    let mut objective = 0.0;
    for (parameters, error) in OUTER.iter().zip(ERRORS) {
        let reference = figures(error, &found, flights)?;
        check_reference(reference)?;
        let start = configured(parameters, &config);
        let best = search(parameters, std::slice::from_ref(&start), &share, |points| {
            let evaluate = |point: &Vec<f64>| {
                if progress.check().is_err() {
                    return f64::INFINITY;
                }
                let gains = [found.clone(), values(parameters, point)].concat();
                let found = figures(error, &gains, flights).unwrap_or([f64::INFINITY; 2]);
                bar.inc();
                loop_objective(found, reference)
            };
            points.par_iter().map(evaluate).collect()
        });
        progress.check()?;
        let is_better = best.value < 1.0;
        // The start of the search lies within its bounds, the present gains need not.
        let kept = || present(parameters, &config);
        found.extend(if is_better { values(parameters, &best.point) } else { kept() });
        objective += best.value.min(1.0) / OUTER.len() as f64;
    }
    Ok(Tuned {
        target: "outer".to_owned(),
        values: found,
        objective,
        start: 1.0,
        budget: *budget,
        draws: 0,
        options: flights.options.clone(),
        components: Vec::new(),
        failed: [0; 3],
        path: SearchPath::default(),
    })
}

/// Mean error of the loop along the trajectories, and command jitter.
fn figures(
    error: LoopError,
    gains: &[(String, f64)],
    flights: &TrainingFlights,
) -> Result<[f64; 2], Failure> {
    let law = flights.law("oqtal", &settings(gains));
    let fly = |seed| {
        let figures = |flight: Flight| {
            let errors: Vec<f64> = flight.scored().map(error).collect();
            [mean(&errors), of_hover(&flight)[1]]
        };
        Ok(path(&law, seed)?.map_or([f64::INFINITY; 2], figures))
    };
    let all: Result<Vec<[f64; 2]>, Failure> = flights.seeds().into_par_iter().map(fly).collect();
    let all = all?;
    Ok([0, 1].map(|i| mean(&all.iter().map(|each| each[i]).collect::<Vec<_>>())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_config::Setting;

    #[test]
    fn a_vehicle_that_is_not_commanded_by_rates_is_tuned_by_the_errors_alone() {
        let attitude = Setting::flag("test", "vehicle.interface", "attitude");
        let flights = TrainingFlights::near(vec![attitude], 101..102);
        let reference = figures(ERRORS[0], &[], &flights).unwrap();
        check_reference(reference).unwrap();
        let half = [0.5 * reference[0], reference[1]];
        assert_eq!(loop_objective(half, reference), 0.5);
        assert_eq!(loop_objective([1.0, 6.0], [2.0, 4.0]), 1.0);
        assert!(check_reference([f64::INFINITY; 2]).is_err());
    }
}
