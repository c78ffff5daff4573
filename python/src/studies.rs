//! Studies: figures of laws under conditions, draws of a spread, identification and tuning.

use std::ffi::CString;
use std::ops::Range;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};

use clap::ValueEnum;
use numpy::PyArray1;
use oqtal_config::{Config, Setting};
use oqtal_lab::identify::command::{check_distinct, check_interface, record_notes};
use oqtal_lab::identify::data::FlightData;
use oqtal_lab::identify::identification::{Identification, Scale, identify as identification_of};
use oqtal_lab::identify::{excitation_flight, overview, vehicle_toml};
use oqtal_lab::progress::Progress;
use oqtal_lab::robustness;
use oqtal_lab::robustness::draws::MOST_DRAWS;
use oqtal_lab::robustness::spread::PlantSpread;
use oqtal_lab::study::args::{receive_notes, say_notes, words_of};
use oqtal_lab::study::flights::{NOMINAL, Test};
use oqtal_lab::study::gains::{self, GainSource};
use oqtal_lab::study::law;
use oqtal_lab::study::metric::METRIC;
use oqtal_lab::study::{Case, FlightCondition, Flown, Run, Study};
use oqtal_lab::tune::optimiser::Optimiser;
use oqtal_lab::tune::search::{Budget, TrainingFlights, Tuned};
use oqtal_lab::tune::{options_of, space, training as flights_of, tune as tuned};
use oqtal_observe::flight::Flight;
use oqtal_runtime::process::{Exit, Failure};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use toml::Value;

use crate::error;
use crate::flight::PyFlight;
use crate::settings::{Sources, setting_of};
use crate::task;

/// Number of plants that are drawn between two looks at an interrupt \[-\].
const BATCH: usize = 20;

/// A setting of a call: its origin, key and value.
type GivenSetting<'py> = (String, String, Bound<'py, PyAny>);

/// Warnings of studies that were not taken yet.
static NOTES: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Takes the warnings of the studies so far.
#[pyfunction]
fn notes() -> Vec<String> {
    std::mem::take(&mut NOTES.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Names of the laws of studies, in the order of tables.
#[pyfunction]
fn laws() -> Vec<&'static str> {
    law::names().collect()
}

/// Refuses names that are not in `known`.
fn check_names(names: &[String], known: &[&str], what: &str) -> PyResult<()> {
    match names.iter().find(|name| !known.contains(&name.as_str())) {
        None if names.is_empty() => {
            Err(error::usage(format!("no {what}; give one of {}", known.join(", "))))
        }
        None => Ok(()),
        Some(name) => Err(error::usage(format!(
            "`{name}` is not a {what}; expected one of {}",
            known.join(", ")
        ))),
    }
}

/// Flies every law under every condition, `(seed, settings)`. Returns the columns of a table with one row for each law and
/// condition, grouped by law: the figures are those of `oqtal campaign`, NaN for a flight that did not land as planned.
#[pyfunction]
#[pyo3(signature = (sources, names, gain_source, conditions, progress=None, threads=0))]
fn study<'py>(
    py: Python<'py>,
    sources: Sources,
    names: Vec<String>,
    gain_source: &str,
    conditions: Vec<(u64, Vec<GivenSetting<'py>>)>,
    progress: Option<Bound<'py, PyAny>>,
    threads: usize,
) -> PyResult<Bound<'py, PyDict>> {
    check_names(&names, &law::names().collect::<Vec<_>>(), "law")?;
    let condition = |(seed, settings): (u64, Vec<GivenSetting<'py>>)| {
        let settings: PyResult<Vec<Setting>> = settings.into_iter().map(setting_of).collect();
        Ok(FlightCondition { seed, plant: NOMINAL, settings: settings? })
    };
    let conditions: PyResult<Vec<FlightCondition>> =
        conditions.into_iter().map(condition).collect();
    let (name, tests) = ("study".to_owned(), Test::ALL.to_vec());
    let case = Case { name, conditions: conditions?, tests };
    let gain_source: GainSource = gain_source.parse().unwrap_or_default();
    let flown = task::study(py, progress.as_ref(), threads, |progress| {
        let laws = gains::chosen(&names, &gain_source, &sources.settings()?)?;
        Study { name: "flights", laws: &laws, cases: std::slice::from_ref(&case) }.fly(progress)
    })?;
    table(py, &flown, &case)
}

/// The rows of a study as columns.
fn table<'py>(py: Python<'py>, flown: &[Flown], case: &Case) -> PyResult<Bound<'py, PyDict>> {
    let runs = || flown.iter().flat_map(|row| row.runs.iter());
    let columns = PyDict::new(py);
    let names = flown.iter().flat_map(|row| vec![row.law.name.clone(); row.runs.len()]);
    columns.set_item("controller", names.collect::<Vec<_>>())?;
    let seeds = flown.iter().flat_map(|_| case.conditions.iter().map(|c| c.seed.cast_signed()));
    columns.set_item("seed", PyArray1::from_iter(py, seeds))?;
    columns.set_item("landed", PyArray1::from_iter(py, runs().map(Run::all_landed)))?;
    columns.set_item("as_planned", PyArray1::from_iter(py, runs().map(Run::all_as_planned)))?;
    for (index, metric) in METRIC.iter().enumerate() {
        let figures = runs().map(|run| run.figures[index]);
        let shown = figures.map(|figure| if figure.is_finite() { figure } else { f64::NAN });
        columns.set_item(metric.key, PyArray1::from_iter(py, shown))?;
    }
    for (index, test) in Test::ALL.iter().enumerate() {
        let ends = runs().map(|run| run.ends[index].cause_or_landed());
        columns.set_item(test.name(), ends.collect::<Vec<_>>())?;
    }
    let solves = runs().map(|run| run.riccati_solves.cast_signed());
    columns.set_item("riccati_solves", PyArray1::from_iter(py, solves))?;
    Ok(columns)
}

/// Draws `runs` plants of a spread, as by `oqtal robustness`: `[(seed of the flights, [(origin, key, value), …]), …]`.
#[pyfunction]
#[pyo3(signature = (sources, spread, count, is_wide=false))]
fn draws<'py>(
    py: Python<'py>,
    sources: Sources,
    spread: &str,
    count: (u64, u64),
    is_wide: bool,
) -> PyResult<Bound<'py, PyList>> {
    let (runs, seed) = count;
    if !(1..=MOST_DRAWS).contains(&runs) || !(1..=1_000_000).contains(&seed) {
        let message = format!(
            "runs is from 1 to {MOST_DRAWS}, seed from 1 to 1000000; found {runs} and {seed}"
        );
        return Err(error::usage(message));
    }
    let spread = spread.to_owned();
    let drawn = task::interruptible(py, move |is_cancelled| {
        let named = PlantSpread::named(&spread)?;
        let named = if is_wide { named.twice_as_wide() } else { named };
        let common = robustness::with_defaults(sources.settings()?);
        say_notes(named.note(&common)?);
        let draw = |first| {
            let runs = first..runs.min(first + BATCH as u64);
            robustness::draw_plants(&named, &common, (seed, runs))
        };
        let is_wanted = |_: &u64| !is_cancelled.load(Ordering::Relaxed);
        let firsts = (0..runs).step_by(BATCH).take_while(is_wanted);
        firsts.map(draw).collect::<Result<Vec<_>, _>>()
    })?;
    let list = PyList::empty(py);
    for draw in drawn.into_iter().flatten() {
        list.append((draw.seed, given(py, draw.settings)?))?;
    }
    Ok(list)
}

/// The laws of a study with all their settings, those of files, environment and gains included: what another machine needs to fly
/// the same. `[(name, [(origin, key, value), …]), …]`.
#[pyfunction]
fn resolved<'py>(
    py: Python<'py>,
    sources: Sources,
    names: Vec<String>,
    gain_source: &str,
) -> PyResult<Vec<(String, Vec<GivenSetting<'py>>)>> {
    check_names(&names, &law::names().collect::<Vec<_>>(), "law")?;
    let gain_source: GainSource = gain_source.parse().unwrap_or_default();
    let laws = task::detached(py, || gains::chosen(&names, &gain_source, &sources.settings()?))?;
    laws.into_iter().map(|law| Ok((law.name, given(py, law.settings)?))).collect()
}

/// Settings in Python.
fn given(py: Python<'_>, settings: Vec<Setting>) -> PyResult<Vec<GivenSetting<'_>>> {
    let given = |Setting { origin, key, value }| Ok((origin, key, python_of(py, &value)?));
    settings.into_iter().map(given).collect()
}

/// `value` in Python.
fn python_of<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Float(number) => number.into_pyobject(py)?.into_any(),
        Value::Integer(number) => number.into_pyobject(py)?.into_any(),
        Value::Boolean(truth) => truth.into_pyobject(py)?.to_owned().into_any(),
        Value::Array(values) => {
            let values: PyResult<Vec<_>> =
                values.iter().map(|value| python_of(py, value)).collect();
            PyList::new(py, values?)?.into_any()
        }
        other => other
            .as_str()
            .map_or_else(|| other.to_string(), str::to_owned)
            .into_pyobject(py)?
            .into_any(),
    })
}

/// Identifies the vehicle that flew `flights`; returns the identification as JSON, the configuration as TOML, and remarks.
#[pyfunction]
#[pyo3(signature = (flights, mass_kg=None, max_thrust_n=None))]
fn identify(
    py: Python<'_>,
    flights: Vec<Py<PyFlight>>,
    mass_kg: Option<f64>,
    max_thrust_n: Option<f64>,
) -> PyResult<(String, String, Vec<String>)> {
    let scale = match (mass_kg, max_thrust_n) {
        (Some(mass_kg), _) => Scale::Mass(mass_kg),
        (None, Some(thrust_n)) => Scale::Thrust(thrust_n),
        (None, None) => Scale::Unknown,
    };
    task::interruptible(py, move |_| {
        let flights: Vec<&Flight> = flights.iter().map(|flight| &flight.get().flight).collect();
        let Some(first) = flights.first() else {
            return Err(Failure::new(
                Exit::Usage,
                "nothing to identify a vehicle from; give flights",
            ));
        };
        flights.iter().try_for_each(|flight| check_interface(&flight.config))?;
        check_distinct(&flights)?;
        let data: Vec<FlightData> = flights.iter().map(|flight| FlightData::of(flight)).collect();
        let flown = first.config_of_longest_flight();
        let identification = identification_of(&data, &flown.vehicle, scale)?;
        let toml = vehicle_toml::toml(&identification, &flown);
        let notes = flights.iter().flat_map(|flight| record_notes(flight));
        let remarks = notes.chain(overview::remarks(&identification)).collect();
        Ok((json(&identification)?, toml, remarks))
    })
}

fn json(identification: &Identification) -> Result<String, Failure> {
    serde_json::to_string(identification)
        .map_err(|error| Failure::new(Exit::Internal, error.to_string()))
}

/// Flies the excitation from which a vehicle is identified.
#[pyfunction]
fn fly_excitation(py: Python<'_>, sources: Sources) -> PyResult<PyFlight> {
    let flown = task::interruptible(py, move |_| {
        let config = sources.config()?;
        check_interface(&config)?;
        excitation_flight::fly(&config)
    })?;
    if let Some(assumption) = flown.assumption.and_then(|text| CString::new(text).ok()) {
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &assumption, 1)?;
    }
    Ok(PyFlight::of(flown.flight))
}

/// Tunes the gains of a law, or of the position loops; returns `{key: value}`, the keys of gains on a bound, the objective at these gains
/// and at the configured ones, and the configuration as TOML.
#[pyfunction]
#[pyo3(signature = (sources, target, search, seeds, spread=None, progress=None, threads=0))]
fn tune<'py>(
    py: Python<'py>,
    sources: Sources,
    target: &str,
    search: (usize, u64, String),
    seeds: (u64, u64),
    spread: Option<String>,
    progress: Option<Bound<'py, PyAny>>,
    threads: usize,
) -> PyResult<(Vec<(String, f64)>, Vec<String>, f64, f64, String)> {
    let (points, seed, optimiser) = search;
    let known: Vec<&str> = space::names().filter(|name| *name != "all").collect();
    check_names(&[target.to_owned()], &known, "target of tuning")?;
    let optimiser = Optimiser::from_str(&optimiser, false).map_err(|_| {
        error::usage(format!("`{optimiser}` is not cma-es, bee-colony or quasi-newton"))
    })?;
    if points == 0 || seeds.1 <= seeds.0 {
        return Err(error::usage(
            "the budget is at least 1 point, and seeds are a range that is not empty",
        ));
    }
    let budget = Budget { points, seed, optimiser };
    let work = |progress: &Progress| {
        let flights = training(&sources, seeds.0..seeds.1, spread.as_deref())?;
        let found = tuned(target, &budget, &flights, progress)?;
        Ok((flights, found))
    };
    let (flights, found): (TrainingFlights, Tuned) =
        task::study(py, progress.as_ref(), threads, work)?;
    let toml = found.to_toml(&flights.settings, "");
    let on_a_bound = found.on_a_bound().into_iter().map(|range| range.key.into_owned()).collect();
    Ok((found.values, on_a_bound, found.objective, found.start, toml))
}

/// The flights on which gains are evaluated.
fn training(
    sources: &Sources,
    seeds: Range<u64>,
    spread: Option<&str>,
) -> Result<TrainingFlights, Failure> {
    let settings = sources.settings()?;
    Config::from_settings(&settings)?;
    let options = options_of(&seeds, spread) + &words_of(&settings);
    Ok(TrainingFlights { options, ..flights_of(settings, seeds, spread)? })
}

/// Registers the functions.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    receive_notes(|note| NOTES.lock().unwrap_or_else(PoisonError::into_inner).push(note));
    module.add_function(wrap_pyfunction!(notes, module)?)?;
    module.add_function(wrap_pyfunction!(laws, module)?)?;
    module.add_function(wrap_pyfunction!(study, module)?)?;
    module.add_function(wrap_pyfunction!(draws, module)?)?;
    module.add_function(wrap_pyfunction!(resolved, module)?)?;
    module.add_function(wrap_pyfunction!(identify, module)?)?;
    module.add_function(wrap_pyfunction!(fly_excitation, module)?)?;
    module.add_function(wrap_pyfunction!(tune, module)?)
}
