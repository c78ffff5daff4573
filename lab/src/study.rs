//! The study engine: laws fly tests under cases; the result is one row of figures per law and case.
//!
//! | axis | type | example |
//! |---|---|---|
//! | laws | [`StudyLaw`] | `oqtal-dt` with its tuned gains |
//! | variation | [`Case`] | a rate lag of 80 ms |
//! | flights of a case | [`FlightCondition`]: seed, plant, settings | seeds 200 to 224, or one draw of a spread each |
//! | tests of a flight | [`Test`] | path, hover, chirp, doublet |
//!
//! A study of three rate lags, as a table:
//!
//! ```no_run
//! # use oqtal_config::Setting;
//! # use oqtal_lab::{progress::Progress, sheet::Sheet};
//! # use oqtal_lab::study::{*, gains::GainSource, metric::HOVER, table::column};
//! let laws = gains::chosen(&["pid".into(), "oqtal-dt".into()], &GainSource::Tuned, &[])?;
//! let lag = |ms: f64| Case::of_seeds(format!("{ms} ms"), 200..205).with(Setting::flag("", "plant.rate-lag-ms", ms));
//! let cases = [50.0, 80.0, 120.0].map(lag);
//! let rows = Study { name: "rate lags", laws: &laws, cases: &cases }.fly(&Progress::default())?;
//! let columns = [column("hover_rms_mm", "hover RMS [mm]", |row: &Flown| row.mean()[HOVER])];
//! let sheet = Sheet::tabulate(("lags", "Rate lags"), &columns, &rows, |row| row.names());
//! println!("{}", sheet.to_text());
//! # Ok::<(), oqtal_runtime::process::Failure>(())
//! ```
//!
//! Flights are flown on all cores; the result does not depend on the number of threads. A flight that does not land as planned
//! has infinite figures for its test ([`Run::is_as_planned`]), so that it ranks below any flight that does; [`failure`] counts such
//! flights by test and cause.

pub mod args;
pub mod failure;
pub mod flights;
pub mod gains;
pub mod law;
pub mod metric;
pub mod records;
mod room;
pub mod table;

use std::ops::Range;
use std::sync::Arc;

use oqtal_config::Setting;
use oqtal_control::statistics::{Interval, mean, median, quantile};
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use crate::mission::Mission;
use crate::progress::Progress;
pub use flights::{FlightCondition, Run};
use flights::{FlyMission, NOMINAL, PlantVariant, Test, TestFlights};
use law::StudyLaw;
use metric::Figures;

/// Seeds of the flights by which laws are compared; none is used for tuning.
pub const EVALUATION_SEEDS: Range<u64> = 200..225;
/// Seeds of the flights used for tuning.
pub const TRAINING_SEEDS: Range<u64> = 101..107;

/// A named set of flights; they form one row per law.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name in tables.
    pub name: String,
    /// The flights.
    pub conditions: Vec<FlightCondition>,
    /// Tests that are flown in each condition.
    pub tests: Vec<Test>,
}

impl Case {
    /// Flights on the configured plant, one per seed.
    pub fn of_seeds(name: impl Into<String>, seeds: Range<u64>) -> Self {
        Self::on(NOMINAL, seeds).named(name)
    }

    /// Flights on `plant`, one per seed; the case is named after the plant.
    pub fn on(plant: PlantVariant, seeds: Range<u64>) -> Self {
        let condition = |seed| FlightCondition { seed, plant, settings: Vec::new() };
        Self::of(plant.name, seeds.map(condition).collect())
    }

    /// Flights of every test in these conditions.
    pub fn of(name: impl Into<String>, conditions: Vec<FlightCondition>) -> Self {
        Self { name: name.into(), conditions, tests: Test::ALL.to_vec() }
    }

    /// The case with another name.
    pub fn named(self, name: impl Into<String>) -> Self {
        Self { name: name.into(), ..self }
    }

    /// The case with these tests alone.
    pub fn flown_as(self, tests: &[Test]) -> Self {
        Self { tests: tests.to_vec(), ..self }
    }

    /// The case with this setting in every flight.
    pub fn with(mut self, setting: Setting) -> Self {
        self.conditions.iter_mut().for_each(|condition| condition.settings.push(setting.clone()));
        self
    }
}

/// Laws and the cases that each of them flies.
#[derive(Clone, Copy, Debug)]
pub struct Study<'a> {
    /// Name at the progress bar.
    pub name: &'a str,
    /// The laws.
    pub laws: &'a [StudyLaw],
    /// The cases.
    pub cases: &'a [Case],
}

/// A row of a study: one law in one case.
#[derive(Clone, Debug)]
pub struct Flown {
    /// The law.
    pub law: StudyLaw,
    /// Name of the case.
    pub case: String,
    /// Conditions of the case.
    pub conditions: Arc<[FlightCondition]>,
    /// Runs, one per condition.
    pub runs: Vec<Run>,
}

impl Study<'_> {
    /// Flies the study on all cores. Returns the rows grouped by law, in the order of the cases. Runs are kept in the journal of
    /// `progress`, and those that it holds already are not flown again.
    ///
    /// # Errors
    /// A setting is invalid, or a trajectory is not inside the fence; in this case no flight is flown. The journal cannot be written
    /// (exit code 71).
    pub fn fly(&self, progress: &Progress) -> Result<Vec<Flown>, Failure> {
        self.check()?;
        let tests = self.flights().iter().map(|(_, case, _)| case.tests.len()).sum();
        let bar = progress.start(self.name, tests);
        self.fly_each(progress, |tests| bar.add(tests))
    }

    /// Flies the study as [`Self::fly`] does, without a progress bar.
    ///
    /// # Errors
    /// Like [`Self::fly`]; the settings are not checked before the first flight.
    pub fn fly_without_bar(&self, progress: &Progress) -> Result<Vec<Flown>, Failure> {
        self.fly_each(progress, |_| ())
    }

    /// Flies the study on all cores; `note` is called with the number of tests of each run.
    fn fly_each(
        &self,
        progress: &Progress,
        note: impl Fn(usize) + Sync,
    ) -> Result<Vec<Flown>, Failure> {
        let run = |(law, case, condition): (&StudyLaw, &Case, &FlightCondition)| {
            let flights = TestFlights::new(law, condition, &case.tests)?;
            let run =
                progress.kept(flights, TestFlights::key, |flights| flights.fly_here(progress));
            note(case.tests.len());
            progress.check().and(run)
        };
        let runs: Result<Vec<Run>, Failure> = self.flights().into_par_iter().map(run).collect();
        Ok(self.rows(runs?))
    }

    /// Flies the study sequentially, using `fly` for each flight. Returns the rows like [`Self::fly`].
    ///
    /// # Errors
    /// A setting is invalid, `fly` failed, or the journal cannot be written.
    pub fn fly_in_turn(
        &self,
        progress: &Progress,
        fly: &mut FlyMission<'_>,
    ) -> Result<Vec<Flown>, Failure> {
        self.check()?;
        let run = |(law, case, condition): (&StudyLaw, &Case, _)| {
            let flights = TestFlights::new(law, condition, &case.tests)?;
            progress.kept(flights, TestFlights::key, |flights| flights.fly(fly))
        };
        let runs: Result<Vec<Run>, Failure> = self.flights().into_iter().map(run).collect();
        Ok(self.rows(runs?))
    }

    /// Checks settings and trajectories of every law in every case, once for conditions that differ in the simulated vehicle alone: neither
    /// law nor trajectory depends on it.
    fn check(&self) -> Result<(), Failure> {
        let acts = |setting: &&Setting| !setting.key.starts_with("plant.");
        let is_like = |a: &FlightCondition, b: &FlightCondition| {
            a.settings.iter().filter(acts).eq(b.settings.iter().filter(acts))
        };
        let mut different = self.flights();
        different.dedup_by(|(law, case, condition), kept| {
            std::ptr::eq(*law, kept.0) && std::ptr::eq(*case, kept.1) && is_like(condition, kept.2)
        });
        let failure = different.into_par_iter().find_map_first(|(law, case, condition)| {
            let config = |test: &Test| flights::config(law, condition, *test);
            case.tests.iter().find_map(|test| config(test).and_then(Mission::new).err())
        });
        failure.map_or(Ok(()), Err)
    }

    fn flights(&self) -> Vec<(&StudyLaw, &Case, &FlightCondition)> {
        let mut flights = Vec::new();
        for law in self.laws {
            for case in self.cases {
                flights.extend(case.conditions.iter().map(|condition| (law, case, condition)));
            }
        }
        flights
    }

    fn rows(&self, runs: Vec<Run>) -> Vec<Flown> {
        let conditions: Vec<Arc<[FlightCondition]>> =
            self.cases.iter().map(|case| case.conditions.clone().into()).collect();
        let mut runs = runs.into_iter();
        let mut row = |law: &StudyLaw, index: usize| Flown {
            law: law.clone(),
            case: self.cases[index].name.clone(),
            conditions: conditions[index].clone(),
            runs: runs.by_ref().take(conditions[index].len()).collect(),
        };
        let pairs = self.laws.iter().flat_map(|law| (0..self.cases.len()).map(move |k| (law, k)));
        pairs.map(|(law, index)| row(law, index)).collect()
    }
}

impl Flown {
    /// One figure of every run.
    pub fn values(&self, metric: usize) -> Vec<f64> {
        self.runs.iter().map(|run| run.figures[metric]).collect()
    }

    /// One figure of every run, with the time until the next step for a step that did not settle.
    pub fn bounded_values(&self, metric: usize) -> Vec<f64> {
        self.runs.iter().map(|run| run.bounded(metric)).collect()
    }

    /// Mean of each figure over all runs.
    pub fn mean(&self) -> Figures {
        std::array::from_fn(|metric| mean(&self.values(metric)))
    }

    /// One figure of each flight that landed as planned, where it has a meaning.
    pub fn landed(&self, metric: usize) -> Vec<f64> {
        let mut landed = self.values(metric);
        landed.retain(|figure| figure.is_finite());
        landed
    }

    /// Mean of each figure over the flights that landed as planned; NaN if none did, or for a settling time that one did not reach.
    pub fn mean_of_landed(&self) -> Figures {
        std::array::from_fn(|metric| {
            let is_unreached = |run: &Run| {
                let of = |test: &Test| test.figures().contains(&metric) && run.is_as_planned(*test);
                run.figures[metric].is_infinite() && Test::ALL.iter().any(of)
            };
            let has_value = !self.runs.iter().any(is_unreached);
            if has_value { mean(&self.landed(metric)) } else { f64::NAN }
        })
    }

    /// Mean of a figure over all runs, with its confidence interval.
    pub fn interval(&self, metric: usize) -> Interval {
        Interval::of(&self.values(metric))
    }

    /// Median of a figure over the runs; flights that did not land count as the greatest values.
    pub fn median(&self, metric: usize) -> f64 {
        median(self.values(metric)).unwrap_or(f64::NAN)
    }

    /// Quantile by nearest rank of a figure over the runs, for a fraction in \[0..1\]; flights that did not land count as the greatest values.
    pub fn quantile(&self, metric: usize, share: f64) -> f64 {
        quantile(self.values(metric), share).unwrap_or(f64::NAN)
    }

    /// Percentage of the runs with a property \[%\].
    pub fn percent(&self, has: impl Fn(&Run) -> bool) -> f64 {
        1e2 * self.runs.iter().filter(|run| has(run)).count() as f64 / self.runs.len() as f64
    }

    /// Greatest number of Riccati equations solved on a path \[-\].
    pub fn riccati_solves(&self) -> u64 {
        self.runs.iter().map(|run| run.riccati_solves).max().unwrap_or(0)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use flights::TestEnd;
    use metric::{METRICS, OVERSHOOT, SETTLE};
    use oqtal_observe::flight::Outcome;

    /// Run whose figures all have this value; of a flight that was stopped if it is infinite.
    pub(crate) fn run(figure: f64, riccati_solves: u64) -> Run {
        let (outcome, cause) = match figure.is_finite() {
            true => (Outcome::Landed, None),
            false => (Outcome::Stopped, Some("motors stopped: speed".to_owned())),
        };
        let ends = Test::ALL.map(|test| TestEnd { test, outcome, cause: cause.clone() });
        Run {
            figures: [figure; METRICS],
            least_settle_s: [figure; 2],
            hover_max_mm: figure,
            riccati_solves,
            ends: ends.into(),
        }
    }

    /// Row whose figures all have these values, one per run; seeds from 0 on.
    pub(crate) fn flown(controller: &'static str, figures: &[f64]) -> Flown {
        Flown {
            law: StudyLaw::new(controller, Vec::new(), ""),
            case: String::new(),
            conditions: Case::of_seeds("", 0..figures.len() as u64).conditions.into(),
            runs: figures.iter().map(|figure| run(*figure, 0)).collect(),
        }
    }

    #[test]
    fn flights_that_did_not_land_are_the_worst() {
        let mut values: Vec<f64> = (0..100).map(f64::from).collect();
        values[17] = f64::INFINITY;
        let mut flown = flown("pid", &values);
        let quantiles = [0.95, 1.0].map(|share| flown.quantile(0, share));
        assert_eq!((flown.median(0), quantiles), (50.5, [95.0, f64::INFINITY]));
        assert_eq!((flown.percent(Run::all_as_planned), flown.mean()[0]), (99.0, f64::INFINITY));
        let mean = (4950.0 - 17.0) / 99.0;
        assert_eq!(flown.mean_of_landed(), [mean; METRICS]);
        flown.runs[0].figures[SETTLE] = f64::INFINITY;
        let figures = flown.mean_of_landed();
        assert!(figures[SETTLE].is_nan() && figures[OVERSHOOT] == mean, "{figures:?}");
    }

    #[test]
    fn rows_are_those_of_one_law_after_the_other() {
        let laws = ["pid", "lqr"].map(|name| StudyLaw::new(name, Vec::new(), ""));
        let cases = [Case::of_seeds("a", 1..3), Case::of_seeds("b", 7..8)];
        let study = Study { name: "", laws: &laws, cases: &cases };
        let seeds: Vec<u64> =
            study.flights().iter().map(|(.., condition)| condition.seed).collect();
        assert_eq!(seeds, [1, 2, 7, 1, 2, 7]);
        let rows = study.rows((0..6).map(|solves| run(0.0, solves)).collect());
        let shown = rows.iter().map(|row| (&*row.law.name, &*row.case, row.riccati_solves()));
        assert_eq!(
            shown.collect::<Vec<_>>(),
            [("pid", "a", 1), ("pid", "b", 2), ("lqr", "a", 4), ("lqr", "b", 5)]
        );
    }

    #[test]
    fn progress_counts_flights() {
        use std::sync::{Arc, Mutex};
        let laws = [StudyLaw::new("pid", Vec::new(), "")];
        let cases = [Case::of_seeds("", 1..3).flown_as(&[Test::Chirp, Test::Doublet])];
        let told = Arc::new(Mutex::new(Vec::new()));
        let teller = Arc::clone(&told);
        let watch = move |_: &str, done: u64, all: u64| teller.lock().unwrap().push((done, all));
        let progress = Progress::watched(Box::new(watch), Arc::default());
        let rows = Study { name: "", laws: &laws, cases: &cases }.fly(&progress).unwrap();
        assert_eq!(told.lock().unwrap().last(), Some(&(4, 4)));
        assert_eq!(rows[0].runs.iter().map(|run| run.ends.len()).sum::<usize>(), 4);
    }

    #[test]
    fn an_invalid_setting_is_found_before_the_first_flight() {
        let laws = [StudyLaw::new("pid", Vec::new(), "")];
        let mut cases = [Case::of_seeds("a", 1..2), Case::of_seeds("b", 1..4)];
        cases[1].conditions[2].settings.push(Setting::flag("", "plant.nothing", 1.0));
        let study = Study { name: "", laws: &laws, cases: &cases };
        let failure = study.fly(&Progress::default()).unwrap_err();
        assert!(failure.to_string().contains("plant.nothing"), "{failure}");
    }

    #[test]
    fn a_test_that_does_not_fit_the_fence_is_found_before_the_first_flight() {
        let laws = [StudyLaw::new("pid", Vec::new(), "")];
        let narrow = Setting::flag("", "fence.x-m", vec![-1.0, 1.0]);
        let cases = [Case::of_seeds("", 1..2).flown_as(&[Test::Hover, Test::Doublet]).with(narrow)];
        let mut flights = 0;
        let study = Study { name: "", laws: &laws, cases: &cases };
        let flown = study.fly_in_turn(&Progress::default(), &mut |mission| {
            flights += 1;
            crate::simulation::fly(mission)
        });
        assert!(flown.unwrap_err().to_string().contains("fence"));
        assert_eq!(flights, 0);
    }

    #[test]
    fn seeds_of_comparisons_are_not_those_of_tuning() {
        assert!(TRAINING_SEEDS.clone().all(|seed| !EVALUATION_SEEDS.contains(&seed)));
    }
}
