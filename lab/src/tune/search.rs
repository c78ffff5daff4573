//! The search for gains: the same optimiser, budget and seeds for every law.

use std::slice;

use oqtal_config::{Config, Setting};
use oqtal_control::controller::{ControllerName, SearchRange};
use oqtal_runtime::process::{Exit, Failure};
use rayon::prelude::*;

use super::bee_colony::Best;
use super::objective::{figures, objective};
use super::space::{configured, present, values};
use super::trade;
pub use super::training::TrainingFlights;
pub use super::tuned::{Budget, SearchPath, Tuned, settings};
use crate::progress::Progress;
use crate::study::failure::counts;
use crate::study::law::StudyLaw;
use crate::study::{Case, Flown};

/// Searches for the least objective over the logarithms of `parameters`, from the best of the values `starts` on.
pub fn search(
    parameters: &[SearchRange],
    starts: &[Vec<(String, f64)>],
    budget: &Budget,
    evaluate: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
) -> Best {
    let bounds: Vec<_> = parameters.iter().map(|p| p.low.ln()..=p.high.ln()).collect();
    let starts = starts.iter().map(|start| start.iter().map(|(_, value)| value.ln()).collect());
    let starts: Vec<Vec<f64>> = starts.collect();
    let Budget { points, seed, optimiser } = *budget;
    optimiser.minimise(&bounds, &starts, (points, seed), evaluate)
}

/// Tunes a law, with the estimator and the position loops around it, on `flights`.
///
/// # Errors
/// A setting is invalid, the search was interrupted, or no gains land every flight (exit code 1).
pub fn law(
    controller: ControllerName,
    budget: &Budget,
    flights: &TrainingFlights,
    progress: &Progress,
) -> Result<Tuned, Failure> {
    let config = Config::from_settings(&flights.settings)?;
    let (name, parameters) = (controller.name(), flights.parameters(controller, &config));
    let bar = progress.start(&format!("tuning {name}"), budget.points);
    let (reference, weighted) = (flights.reference(progress)?, flights.weighted_case());
    let law = |gains: &[Setting]| flights.law(name, gains);
    let changed = |point: &[f64]| [values(&parameters, point), flights.computed.clone()].concat();
    let fly = |gains: &[Setting], case: &Case| flights.fly(&law(gains), case, progress);
    let figures = |flown: &Flown| figures(flights.draws, flown, &reference);
    let value = |flown: &Flown| objective(&figures(flown), &reference, &flights.weights);
    let before = fly(&[], &flights.case)?;
    let (start, from) = (value(&before), configured(&parameters, &config));
    flights.check_start((name, start), &before, progress)?;
    let mut path = SearchPath::default();
    let best = search(&parameters, &flights.starts(name, &parameters, &from), budget, |points| {
        let evaluate = |point: &Vec<f64>| {
            let flown = progress.check().and_then(|()| fly(&settings(&changed(point)), &weighted));
            bar.inc();
            flown.ok().map(|flown| value(&flown))
        };
        let found = batch(points, flights.is_hopeless(start, &path), evaluate);
        path.add(points, &found);
        found.into_iter().map(|value| value.unwrap_or(f64::INFINITY)).collect()
    });
    progress.check()?;
    let (values, objective, after) = match best.value < start {
        true => {
            let values = changed(&best.point);
            let after = fly(&settings(&values), &flights.case)?;
            (values, best.value, after)
        }
        false if start.is_finite() => (present(&parameters, &config), start, before.clone()),
        false => return Err(flights.nothing_lands(name, &path, &before)),
    };
    let (laws, flown) = ([law(&[]), law(&settings(&values))], [before, after]);
    let mut components = trade::components(&flights.weights, &flown, flown.each_ref().map(figures));
    components.extend(trade::margins(&laws[0], &laws[1]));
    let [(all, failed), (_, after)] = flown.each_ref().map(|flown| counts(slice::from_ref(flown)));
    let (target, options) = (name.to_owned(), flights.options.clone());
    let (budget, draws, failed) = (*budget, flights.draws, [failed, after, all]);
    Ok(Tuned { target, values, objective, start, budget, draws, options, components, failed, path })
}

/// Objectives of `points`; `None` for one that was not flown, as all of a hopeless search.
fn batch(
    points: &[Vec<f64>],
    is_hopeless: bool,
    evaluate: impl Fn(&Vec<f64>) -> Option<f64> + Send + Sync,
) -> Vec<Option<f64>> {
    match is_hopeless {
        true => vec![None; points.len()],
        false => points.par_iter().map(evaluate).collect(),
    }
}

impl TrainingFlights {
    /// Whether neither the daemon's gains nor the tuned ones, the first batch, land all flights: a vehicle that hovers during the search
    /// does not wait for further batches.
    fn is_hopeless(&self, start: f64, path: &SearchPath) -> bool {
        let flown = &path.objectives;
        self.live_keys_only
            && !start.is_finite()
            && !flown.is_empty()
            && flown.iter().all(|value| !value.is_finite())
    }

    /// Failure of a search in which no gains land all flights; `before` was flown with the configured ones.
    fn nothing_lands(&self, name: &str, path: &SearchPath, before: &Flown) -> Failure {
        let failures = self.failures(before);
        // A hopeless search leaves out all batches but the first.
        let extent = match (self.live_keys_only, path.objectives.len()) {
            (true, _) => "neither the present gains nor the tuned ones land".to_owned(),
            (false, 0..=1) => {
                "the budget has no room for others than the configured gains, which do not land"
                    .into()
            }
            (false, sets) => format!("none of {sets} sets of gains lands"),
        };
        let reason = format!(
            "tune {name}: {extent} every training flight, so none is better than another; with the configured gains:\n{failures}"
        );
        Failure::new(Exit::Flight, reason)
    }
}

/// Objective of a law with its shipped gains, and with the gains of `law`, on the training seeds.
///
/// # Errors
/// A setting is invalid.
pub fn before_and_after(law: &StudyLaw, progress: &Progress) -> Result<[f64; 2], Failure> {
    let flights = TrainingFlights::default();
    let reference = flights.reference(progress)?;
    let of = |law: &StudyLaw| {
        let flown = flights.fly(law, &flights.case, progress)?;
        let figures = figures(flights.draws, &flown, &reference);
        Ok(objective(&figures, &reference, &flights.weights))
    };
    let shipped: Result<f64, Failure> = of(&flights.law(law.controller, &[]));
    Ok([shipped?, of(law)?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::flights::Test;
    use crate::study::metric::{METRIC, OVERSHOOT, SETTLE};

    #[test]
    fn gains_beyond_their_range_are_kept_as_they_are() {
        let gains = [("control.pid.gain", 128.0), ("position.horizontal-position.ki", 0.0)];
        let settings = gains.map(|(key, value)| Setting::flag("test", key, value));
        let flights = TrainingFlights::near(settings.to_vec(), 101..102);
        let config = Config::from_settings(&flights.settings).unwrap();
        let parameters = flights.parameters(ControllerName::Pid, &config);
        let found = |values: Vec<(String, f64)>, key| {
            values.into_iter().find(|(it, _)| it == key).map(|(_, value)| value)
        };
        for (key, value) in gains {
            assert_eq!(found(present(&parameters, &config), key), Some(value));
        }
        assert_eq!(found(configured(&parameters, &config), gains[0].0), Some(128.0));
    }

    #[test]
    fn gains_of_a_law_whose_place_the_vehicle_takes_are_not_searched_for() {
        let attitude = Setting::flag("test", "vehicle.interface", "attitude");
        let flights = TrainingFlights::near(vec![attitude], 101..102);
        let config = Config::from_settings(&flights.settings).unwrap();
        let first = |law| flights.parameters(law, &config)[0].key.clone();
        assert_eq!(first(ControllerName::Oqtal), "control.estimator.velocity-cutoff-hz");
        assert_eq!(first(ControllerName::OqtalDt), "control.predictive.position-gain-per-s");
    }

    #[test]
    fn a_search_in_flight_without_a_result_in_its_first_batch_flies_no_other() {
        let flights = TrainingFlights { live_keys_only: true, ..TrainingFlights::default() };
        let mut path = SearchPath::default();
        assert!(!flights.is_hopeless(f64::INFINITY, &path), "the first batch is flown");
        path.add(&[vec![0.0]], &[Some(f64::INFINITY)]);
        assert!(flights.is_hopeless(f64::INFINITY, &path) && !flights.is_hopeless(1.0, &path));
        let offline = TrainingFlights::default();
        assert!(!offline.is_hopeless(f64::INFINITY, &path));
        let skipped = batch(&[vec![0.0]], true, |_| panic!("flown"));
        path.add(&[vec![0.0]], &skipped);
        assert_eq!(path.objectives, [f64::INFINITY], "the path holds only gains that were flown");
        path.add(&[vec![0.0]], &[Some(1.0)]);
        assert!(!flights.is_hopeless(f64::INFINITY, &path));
    }

    #[test]
    fn a_reference_that_does_not_land_has_the_figures_of_the_shipped_vehicle() {
        // Too heavy for its thrust: no flight takes off.
        let heavy = [Setting::flag("test", "plant.mass-kg", 2.0)];
        let flights = TrainingFlights::near(heavy.to_vec(), 101..102);
        let reference = flights.reference(&Progress::default()).unwrap();
        assert_eq!(reference, METRIC.map(|metric| metric.shipped));
        let budget = Budget { points: 1, ..Budget::default() };
        let failure = law(ControllerName::Pid, &budget, &flights, &Progress::default());
        let reason = failure.unwrap_err().to_string();
        assert!(reason.contains("do not land every training flight"), "{reason}");
        assert!(reason.contains("pid, training, hover: 1 of 1"), "{reason}");
    }

    #[test]
    fn a_path_without_corners_has_an_objective_beside_a_reference_that_does_not_land() {
        let circle = Setting::flag("test", "trajectory.kind", "circle");
        let mut flights = TrainingFlights::near(vec![circle], 101..102);
        flights.case = flights.case.flown_as(&[Test::Path]);
        flights.weights[OVERSHOOT + 1..].fill(0.0);
        let law = flights.law("oqtal-dt", &[]);
        let flown = flights.fly(&law, &flights.case, &Progress::default()).unwrap();
        let reference = METRIC.map(|metric| metric.shipped);
        for draws in [0, 1] {
            let found = figures(draws, &flown, &reference);
            assert!(found[SETTLE].is_nan(), "{draws}: {found:?}");
            let objective = objective(&found, &reference, &flights.weights);
            assert!(objective < 4.0, "{objective}");
        }
    }
}
