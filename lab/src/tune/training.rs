//! The flights on which gains are evaluated, and those that no gains land.

use std::ops::Range;
use std::slice;

use oqtal_config::{Config, Setting};
use oqtal_control::controller::{ControllerName, SearchRange};
use oqtal_control::statistics::{mean, quantile};
use oqtal_observe::flight::is_of_fence;
use oqtal_runtime::process::{Exit, Failure};

use super::space::{configured, parameters, present};
use super::trade::{MetricWeights, default_weights};
use super::tuned::settings;
use crate::progress::Progress;
use crate::robustness::draws::Draw;
use crate::study::args::say_notes;
use crate::study::failure::{self, Changes};
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
    pub(super) fn parameters(
        &self,
        controller: ControllerName,
        config: &Config,
    ) -> Vec<SearchRange> {
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
    pub(super) fn starts(
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

    pub(super) fn fly(
        &self,
        law: &StudyLaw,
        case: &Case,
        progress: &Progress,
    ) -> Result<Flown, Failure> {
        let (laws, cases) = (slice::from_ref(law), slice::from_ref(case));
        let mut flown = Study { name: "training", laws, cases }.fly_without_bar(progress)?;
        Ok(flown.pop().expect("one law flew one case"))
    }

    /// The flights that have a figure with a weight.
    pub(super) fn weighted_case(&self) -> Case {
        let has_weight = |test: &Test| self.weights[test.figures()].iter().any(|it| *it > 0.0);
        let tests: Vec<Test> = self.case.tests.iter().copied().filter(has_weight).collect();
        self.case.clone().flown_as(&tests)
    }

    /// Reference figures: those of `oqtal` with its configured gains and the computed values, without the gains of the study. Flights
    /// that did not land are left out; a metric without any flight that landed has the figure of the shipped vehicle.
    pub(super) fn reference(&self, progress: &Progress) -> Result<Figures, Failure> {
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
    pub(super) fn failures(&self, flown: &Flown) -> String {
        let rows = slice::from_ref(flown);
        let changes = if self.live_keys_only { Changes::InFlight } else { Changes::All };
        failure::listed(rows, "") + &failure::remedies(&failure::failed(rows), changes)
    }

    /// Warns of a law that does not land all flights with the configured gains, with which `before` was flown; its objective is `start`. A
    /// search for a vehicle that hovers has no warning: it ends at once if no flight lands, with the same reasons.
    ///
    /// # Errors
    /// The room is too small with any gains (exit code 1).
    pub(super) fn check_start(
        &self,
        (name, start): (&str, f64),
        before: &Flown,
        progress: &Progress,
    ) -> Result<(), Failure> {
        if start.is_finite() || self.live_keys_only {
            return Ok(());
        }
        let cramped = self.cramped(before, progress);
        let failures = self.failures(before);
        if cramped.is_empty() {
            say_notes([format!(
                "{name} does not land every training flight as planned with the configured gains; the search may find none that do:\n{failures}"
            )]);
            return Ok(());
        }
        let tests: Vec<&str> = cramped.iter().map(|test| test.name()).collect();
        let weights =
            cramped.iter().map(|test| format!("{}=0", METRIC[*test.figures().start()].key));
        let reason = format!(
            "tune {name}: the room is too small for {}: the fence holds every such flight, with the configured gains and, at {SMALLER} of its size, under `oqtal-dt`, which hovers there. Their drift hardly depends on gains, so none are searched for. Change the room or the size as told below, or leave such flights out by `--weights {}`:\n{failures}",
            tests.join(" and "),
            weights.collect::<Vec<_>>().join(",")
        );
        Err(Failure::new(Exit::Flight, reason))
    }

    /// Tests with a prescribed attitude that the fence ends in every flight, `before` and, [`SMALLER`], under `oqtal-dt`, which hovers in
    /// every condition. The position loop is open in them: the drift follows from the prescribed attitude, and hardly depends on gains.
    fn cramped(&self, before: &Flown, progress: &Progress) -> Vec<Test> {
        let is_open = |test: &Test| matches!(test, Test::Chirp | Test::Doublet);
        let open = self.weighted_case().tests.into_iter().filter(is_open);
        let mut tests: Vec<Test> = open.filter(|test| all_of_fence(before, *test)).collect();
        // Shipped gains may contradict the user's settings.
        let flown = (!tests.is_empty()).then(|| {
            let trajectory = Config::from_settings(&self.settings)?.trajectory;
            let sizes = [
                ("attitude-chirp.sweep-s", trajectory.attitude_chirp.sweep_s),
                ("attitude-doublet.angle-deg", trajectory.attitude_doublet.angle_deg),
            ];
            let smaller = sizes.map(|(key, size)| {
                Setting::flag("tune", &format!("trajectory.{key}"), SMALLER * size)
            });
            let law = self.law("oqtal-dt", &[&tuned("oqtal-dt"), &smaller[..]].concat());
            let case = self.case.clone().flown_as(&[&[Test::Hover], &tests[..]].concat());
            self.fly(&law, &case, progress)
        });
        let Some(Ok(flown)) = flown else { return Vec::new() };
        let hovers = flown.runs.iter().all(|run| run.is_as_planned(Test::Hover));
        tests.retain(|test| hovers && all_of_fence(&flown, *test));
        tests
    }
}

/// Size of a manoeuvre over the configured size, less by more than gains change its drift \[-\].
const SMALLER: f64 = 0.8;

/// Whether every flight of `test` ended by the fence.
fn all_of_fence(flown: &Flown, test: Test) -> bool {
    let mut ends = flown.runs.iter().flat_map(|run| &run.ends).filter(|end| end.test == test);
    ends.all(|end| end.cause.as_deref().is_some_and(is_of_fence))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_room_that_is_too_small_with_any_gains_ends_the_search_before_it_begins() {
        let progress = Progress::default();
        let hover = Setting::flag("test", "trajectory.kind", "hover");
        let wide = TrainingFlights::near(vec![hover], 101..102);
        let fence = [("fence.x-m", [-2.5, 2.5]), ("fence.y-m", [-2.0, 2.0])];
        let fence = fence.map(|(key, range)| Setting::flag("test", key, range.to_vec()));
        let settings = [&wide.settings[..], &fence].concat();
        let narrow = TrainingFlights { settings, ..wide.clone() };
        let before = narrow.fly(&narrow.law("pid", &[]), &narrow.case, &progress).unwrap();
        let start = ("pid", f64::INFINITY);
        let failure = narrow.check_start(start, &before, &progress).unwrap_err();
        assert_eq!(failure.exit, Exit::Flight);
        let told = [
            "tune pid: the room is too small for",
            "attitude-doublet",
            "doublet_settle_s=0`",
            "set trajectory.attitude-doublet.angle-deg=",
        ];
        assert!(told.iter().all(|it| failure.message.contains(it)), "{failure}");
        assert!(wide.check_start(start, &before, &progress).is_ok(), "`oqtal-dt` has room");
    }
}
