//! The search for gains: the same optimiser, budget and seeds for every law.

use std::ops::Range;
use std::slice;

use oqtal_config::{Config, Setting};
use oqtal_control::controller::{ControllerName, SearchRange};
use oqtal_control::statistics::{mean, quantile};
use oqtal_runtime::process::{Exit, Failure};
use rayon::prelude::*;

use super::bee_colony::Best;
use super::objective::{figures, objective};
use super::space::{configured, parameters, present, values};
use super::trade::{self, MetricWeights, default_weights};
pub use super::tuned::{Budget, SearchPath, Tuned, settings};
use crate::progress::Progress;
use crate::robustness::draws::Draw;
use crate::study::args::say_notes;
use crate::study::failure::{self, Changes, counts};
use crate::study::flights::{AUTHORITY, Change, DELAY, NOMINAL, PlantVariant, RATE_LAG, Test};
use crate::study::gains::tuned;
use crate::study::law::StudyLaw;
use crate::study::metric::{Figures, METRIC, METRICS};
use crate::study::{Case, FlightCondition, Flown, Study, TRAINING_SEEDS};

/// Plants used for tuning, one per training seed, so that gains do not rely on one exactly known plant.
const TRAINING: [PlantVariant; 6] = [
    NOMINAL,
    NOMINAL,
    PlantVariant { name: "rate gain -12 %", changes: &[Change::Times(AUTHORITY, 0.88)] },
    PlantVariant { name: "rate gain +12 %", changes: &[Change::Times(AUTHORITY, 1.12)] },
    PlantVariant { name: "inner lag +30 %", changes: &[Change::Times(RATE_LAG, 1.3)] },
    PlantVariant {
        name: "inner lag -20 %, delay +25 %",
        changes: &[Change::Times(RATE_LAG, 0.8), Change::Times(DELAY, 1.25)],
    },
];

/// The flights on which gains are evaluated.
#[derive(Clone, Debug)]
pub struct TrainingFlights {
    /// Settings of all flights: the vehicle and its environment.
    pub settings: Vec<Setting>,
    /// The flights.
    pub case: Case,
    /// Number of draws of a spread \[-\]; 0 for plants near the configured one.
    pub draws: usize,
    /// Whether the search is restricted to keys that may change in flight.
    pub live_keys_only: bool,
    /// Keys and values computed for the vehicle, which change together with the gains \[units of the keys\]; the reference has them,
    /// too.
    pub computed: Vec<(String, f64)>,
    /// Weights of the metrics in the objective \[-\].
    pub weights: MetricWeights,
    /// Arguments of `oqtal tune` that select flights and weights, each preceded by a space; empty for the default ones.
    pub options: String,
}

impl Default for TrainingFlights {
    fn default() -> Self {
        Self::near(Vec::new(), TRAINING_SEEDS)
    }
}

impl TrainingFlights {
    /// One flight per seed, on six plants near the configured one in turn.
    pub fn near(settings: Vec<Setting>, seeds: Range<u64>) -> Self {
        Self::on(settings, seeds, &TRAINING)
    }

    /// One flight per seed, on `plants` in turn.
    pub fn on(settings: Vec<Setting>, seeds: Range<u64>, plants: &[PlantVariant]) -> Self {
        let plants = seeds.zip(plants.iter().copied().cycle());
        let condition = |(seed, plant)| FlightCondition { seed, plant, settings: Vec::new() };
        let case = Case::of("training", plants.map(condition).collect());
        let (weights, options) = (default_weights(), String::new());
        let computed = Vec::new();
        Self { settings, case, draws: 0, live_keys_only: false, computed, weights, options }
    }

    /// One flight per draw of a spread.
    pub fn over(settings: Vec<Setting>, draws: &[Draw]) -> Self {
        Self { draws: draws.len(), case: Draw::case("draws", draws), ..Self::near(settings, 0..0) }
    }

    /// Seeds of the flights.
    pub fn seeds(&self) -> Vec<u64> {
        self.case.conditions.iter().map(|condition| condition.seed).collect()
    }

    /// The law `controller` with `gains` in place of the configured ones.
    pub fn law(&self, controller: &'static str, gains: &[Setting]) -> StudyLaw {
        StudyLaw::new(controller, [&self.settings, gains].concat(), "")
    }

    /// Gains of the law `controller` that are searched for: without its own for a vehicle that holds its attitude by itself.
    fn parameters(&self, controller: ControllerName, config: &Config) -> Vec<SearchRange> {
        let mut parameters = parameters(controller, config.control.stack);
        parameters.retain(|range| !self.live_keys_only || Config::may_change_in_flight(&range.key));
        if config.vehicle.interface.holds_attitude() {
            let own = format!("control.{}.", controller.name());
            parameters.retain(|range| !range.key.starts_with(&own));
        }
        // The search begins at the configured gains.
        let values = present(&parameters, config);
        for (range, (_, value)) in parameters.iter_mut().zip(values) {
            if value > 0.0 {
                (range.low, range.high) = (range.low.min(value), range.high.max(value));
            }
        }
        parameters
    }

    /// Values of `parameters` at which a search begins: `from`, the configured ones. For a vehicle that hovers meanwhile, whose search should
    /// be short, also those tuned for the shipped vehicle.
    fn starts(
        &self,
        law: &str,
        parameters: &[SearchRange],
        from: &[(String, f64)],
    ) -> Vec<Vec<(String, f64)>> {
        let mut starts = vec![from.to_vec()];
        if self.live_keys_only {
            // Shipped gains may contradict the user's settings.
            let tuned = Config::from_settings(&[&self.settings[..], &tuned(law)].concat()).ok();
            let tuned = tuned.map(|tuned| configured(parameters, &tuned));
            starts.extend(tuned.filter(|tuned| tuned != from));
        }
        starts
    }

    fn fly(&self, law: &StudyLaw, case: &Case, progress: &Progress) -> Result<Flown, Failure> {
        let (laws, cases) = (slice::from_ref(law), slice::from_ref(case));
        let mut flown = Study { name: "training", laws, cases }.fly_without_bar(progress)?;
        Ok(flown.pop().expect("one law flew one case"))
    }

    /// The flights that have a figure with a weight.
    fn weighted_case(&self) -> Case {
        let has_weight = |test: &Test| self.weights[test.figures()].iter().any(|it| *it > 0.0);
        let tests: Vec<Test> = self.case.tests.iter().copied().filter(has_weight).collect();
        self.case.clone().flown_as(&tests)
    }

    /// Reference figures: those of `oqtal` with its configured gains and the computed values, without the gains of the study. Flights
    /// that did not land are left out; a metric without any flight that landed has the figure of the shipped vehicle.
    fn reference(&self, progress: &Progress) -> Result<Figures, Failure> {
        let stack = Setting::flag("tune", "control.stack", "default");
        let law = self.law("oqtal", &[settings(&self.computed), vec![stack]].concat());
        let flown = self.fly(&law, &self.case, progress)?;
        let mut of_shipped: Vec<&str> = Vec::new();
        let mut reference = [f64::NAN; METRICS];
        for (index, metric) in METRIC.iter().enumerate() {
            let mut values = flown.bounded_values(index);
            let has_failed = values.contains(&f64::INFINITY);
            values.retain(|value| *value != f64::INFINITY);
            reference[index] = match self.draws {
                _ if values.is_empty() && has_failed => {
                    of_shipped.push(metric.title);
                    metric.shipped
                }
                0 => mean(&values),
                _ => quantile(values, 0.5).unwrap_or(f64::NAN),
            };
        }
        say_notes((!of_shipped.is_empty()).then(|| {
            format!(
                "with the configured gains, `oqtal`, the reference, lands no flight that has {}: figures of the shipped vehicle take their place",
                of_shipped.join(", ")
            )
        }));
        Ok(reference)
    }

    /// Text on the failed flights of `flown`, with remedies that can be applied.
    fn failures(&self, flown: &Flown) -> String {
        let rows = slice::from_ref(flown);
        let changes = if self.live_keys_only { Changes::InFlight } else { Changes::All };
        failure::listed(rows, "") + &failure::remedies(&failure::failed(rows), changes)
    }
}

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
    say_notes(flights.not_landed(name, start, &before));
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
    /// Whether neither the daemon's gains nor the tuned ones, the first batch, land all flights: a vehicle that hovers during the search does
    /// not wait for more.
    fn is_hopeless(&self, start: f64, path: &SearchPath) -> bool {
        let flown = &path.objectives;
        self.live_keys_only
            && !start.is_finite()
            && !flown.is_empty()
            && flown.iter().all(|value| !value.is_finite())
    }

    /// Warning that a law does not land all flights with the configured gains, with which `before` was flown; its objective is `start`. A search
    /// for a vehicle that hovers has none: it ends at once if no flight lands, with the same reasons.
    fn not_landed(&self, name: &str, start: f64, before: &Flown) -> Option<String> {
        (!start.is_finite() && !self.live_keys_only).then(|| {
            format!(
                "{name} does not land every training flight as planned with the configured gains; the search may find none that do:\n{}",
                self.failures(before)
            )
        })
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
