//! Rows of a study as JSON and CSV: one for each law and test, one for each flight, one for each run.

use oqtal_observe::flight::Outcome;
use oqtal_runtime::process::Failure;
use serde_json::{Map, Value, json};

use super::flights::{Run, Test, TestEnd};
use super::metric::{METRIC, METRICS};
use super::table::{mean_of, spread};
use super::{Flown, failure};
use crate::csv_text;
use crate::sheet::SheetCell;

/// Figures of a run that belong to a test, by name.
fn figures(test: Test) -> Vec<(&'static str, usize)> {
    let mut figures: Vec<(&str, usize)> = test.figures().map(|k| (METRIC[k].key, k)).collect();
    figures.extend((test == Test::Hover).then_some(("hover_max_mm", METRICS)));
    figures
}

fn figure(run: &Run, index: usize) -> f64 {
    if index < METRICS { run.figures[index] } else { run.hover_max_mm }
}

/// One object for each law, case and test: counts of flights that landed, and of those that did so as planned, causes of the others,
/// mean and standard deviation of each figure over those as planned.
pub fn tests(flown: &[Flown]) -> Value {
    let tests = |row: &Flown| -> Vec<Test> {
        row.runs.first().map_or_else(Vec::new, |run| run.ends.iter().map(|end| end.test).collect())
    };
    flown.iter().flat_map(|row| tests(row).into_iter().map(|test| of_test(row, test))).collect()
}

fn of_test(row: &Flown, test: Test) -> Value {
    let as_planned: Vec<&Run> = row.runs.iter().filter(|run| run.is_as_planned(test)).collect();
    let ends = || row.runs.iter().flat_map(|run| &run.ends).filter(|end| end.test == test);
    let landed = ends().filter(|end| end.outcome == Outcome::Landed).count();
    let mut object = head(row, test);
    object["runs"] = json!(row.runs.len());
    object["landed"] = json!(landed);
    object["as_planned"] = json!(as_planned.len());
    let mut causes: Map<String, Value> = Map::new();
    for end in ends() {
        if let Some(cause) = &end.cause {
            let count = causes.get(cause).and_then(Value::as_u64).unwrap_or(0);
            causes.insert(cause.clone(), json!(count + 1));
        }
    }
    object["causes"] = Value::Object(causes);
    for (key, index) in figures(test) {
        // A settling time that was not reached has no value.
        let values = as_planned.iter().map(|run| figure(run, index));
        let values = values.filter(|value| value.is_finite());
        let values: Vec<f64> = values.collect();
        object[key] = spread(&values).to_json();
    }
    object
}

fn head(row: &Flown, test: Test) -> Value {
    let case = failure::case_name(&row.case);
    json!({ "controller": row.law.name, "case": case, "test": test.name() })
}

/// One object for each flight: outcome, cause if it did not land as planned, and its figures.
pub fn flights(flown: &[Flown]) -> Value {
    let of_run = |row: &Flown, seed: u64, run: &Run| -> Vec<Value> {
        let of_end = |TestEnd { test, outcome, cause }: &TestEnd| {
            let mut object = head(row, *test);
            object["seed"] = json!(seed);
            object["outcome"] = json!(outcome);
            object["cause"] = json!(cause);
            for (key, index) in figures(*test) {
                object[key] = json!(figure(run, index));
            }
            object
        };
        run.ends.iter().map(of_end).collect()
    };
    let of_row = |row: &Flown| {
        let runs = row.conditions.iter().zip(&row.runs);
        runs.flat_map(|(condition, run)| of_run(row, condition.seed, run)).collect::<Vec<_>>()
    };
    flown.iter().flat_map(of_row).collect()
}

/// The failed flights as JSON.
pub fn failures(flown: &[Flown]) -> Value {
    failure::failed(flown).iter().map(failure::FailedFlights::to_json).collect()
}

/// Every run as a row: law, seed, the metrics by name, empty for a flight that did not land; then the end of each flight,
/// `landed` or the cause.
///
/// # Errors
/// An internal error (exit code 70).
pub fn runs_csv<'a>(flown: impl Iterator<Item = &'a Flown>) -> Result<String, Failure> {
    let names = ["controller", "seed"].into_iter().chain(METRIC.map(|metric| metric.key));
    let ends = Test::ALL.map(Test::name);
    let row = |law: &Flown, seed: u64, run: &Run| {
        let named = [law.law.controller.to_owned(), seed.to_string()];
        let figures = run.figures.map(csv_text::number);
        let ends = run.ends.iter().map(|end| end.cause_or_landed().to_owned());
        named.into_iter().chain(figures).chain(ends).collect::<Vec<_>>()
    };
    let rows = flown.flat_map(|law| {
        let runs = law.conditions.iter().zip(&law.runs);
        runs.map(move |(condition, run)| row(law, condition.seed, run)).collect::<Vec<_>>()
    });
    csv_text::table(names.chain(ends), rows)
}

/// Mean of the greatest hover error over the landed flights \[mm\].
pub fn greatest_hover(flown: &Flown) -> SheetCell {
    mean_of(&flown.runs.iter().map(|run| run.hover_max_mm).collect::<Vec<_>>())
}
