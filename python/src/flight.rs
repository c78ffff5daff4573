//! Flights in this process, recordings of flights, and their columns and pages.

use std::path::{Path, PathBuf};

use numpy::PyArray1;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::topic::Role;
use oqtal_config::{ClockKind, Config};
use oqtal_daemon::{ExternalLaw, LawPort};
use oqtal_lab::faults;
use oqtal_lab::mission::Mission;
use oqtal_lab::simulation::{self, RecordedFlight};
use oqtal_lab::study::args;
use oqtal_observe::csv::{self, ColumnValues};
use oqtal_observe::flight::Flight;
use oqtal_observe::provenance::Provenance;
use oqtal_observe::recorder::Recorder;
use oqtal_observe::recording::{self, McapRecorder, RecordingFileError, RecordingPlan};
use oqtal_observe::report;
use oqtal_observe::summary::Summary;
use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::law::{LawTape, PythonLaw, TapedLaw};
use crate::settings::Sources;
use crate::task::{self, SignalPoll};

/// Version and revision of this build.
const PROVENANCE: Provenance =
    Provenance { version: env!("CARGO_PKG_VERSION"), revision: env!("REVISION_OF_OQTAL") };

/// Processes whose turns a flight in this process executes.
const ROLES: [Role; 3] = [Role::Plant, Role::Mocap, Role::Daemon];

/// A flight with its results.
#[pyclass(frozen, module = "oqtal._native", name = "Flight")]
pub struct PyFlight {
    /// The flight.
    pub flight: Flight,
    /// Reason why the recording ends early; empty for a complete one and for a flight of this process.
    #[pyo3(get)]
    cut_off: String,
    /// Answers of a law in Python; empty without one.
    tape: Option<LawTape>,
}

impl PyFlight {
    /// A flight of this process.
    pub fn of(flight: Flight) -> Self {
        Self { flight, cut_off: String::new(), tape: None }
    }
}

#[pymethods]
impl PyFlight {
    /// Arrays by the names of `docs/data.md`.
    fn columns<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let columns = py.detach(|| csv::columns(&self.flight));
        let arrays = PyDict::new(py);
        for (name, values) in columns {
            match values {
                ColumnValues::Numbers(numbers) => {
                    arrays.set_item(name, PyArray1::from_vec(py, numbers))?;
                }
                ColumnValues::Counts(counts) => {
                    let counts = counts.into_iter().map(u64::cast_signed).collect();
                    arrays.set_item(name, PyArray1::from_vec(py, counts))?;
                }
                ColumnValues::Signed(numbers) => {
                    arrays.set_item(name, PyArray1::from_vec(py, numbers))?;
                }
                ColumnValues::Words(words) => arrays.set_item(name, words)?,
            }
        }
        Ok(arrays)
    }

    /// `summary.json`.
    fn summary(&self, py: Python<'_>) -> String {
        py.detach(|| Summary::of(&self.flight).to_json(PROVENANCE))
    }

    /// The effective configuration as TOML.
    fn config(&self) -> String {
        self.flight.config.to_toml()
    }

    /// Writes the report, one HTML page.
    fn report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let page = || report::html(&self.flight, &Summary::of(&self.flight));
        task::detached(py, || written(&path, files::write(&path, page())))
    }

    /// Flies again, with the same configuration and the answers of the law, and records into `path`.
    fn fly_again(&self, py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let mut taped = self.tape.as_ref().map(|tape| TapedLaw(tape.iter()));
        let law = taped.as_mut().map(|law| law as &mut (dyn ExternalLaw + Send));
        flown(py, self.flight.config.clone(), Some(&path), law).map(Self::of)
    }

    /// Writes the ticks as CSV.
    fn write_csv(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        task::detached(py, || {
            let file = files::create(&path);
            written(
                &path,
                file.and_then(|file| Ok(csv::write(&self.flight, std::io::BufWriter::new(file))?)),
            )
        })
    }
}

fn written(path: &Path, result: std::io::Result<()>) -> Result<(), Failure> {
    let failed = |error| {
        Failure::new(Exit::System, format!("{}: {error}; give another path", path.display()))
    };
    result.map_err(failed)
}

/// Flies in this process, with `law` as `control.controller`, and records into `recording`.
#[pyfunction]
#[pyo3(signature = (sources, recording=None, law=None))]
fn fly(
    py: Python<'_>,
    sources: Sources,
    recording: Option<PathBuf>,
    law: Option<Py<PyAny>>,
) -> PyResult<PyFlight> {
    let config = task::detached(py, || {
        let mut config = sources.config()?;
        config.clock.kind = ClockKind::InProcess;
        faults::check(&config, &ROLES, ["faults:", "disturb:"])?;
        Ok(config)
    })?;
    let Some(law) = law else {
        return flown(py, config, recording.as_deref(), None).map(PyFlight::of);
    };
    let mut law = PythonLaw::new(law);
    let flight = flown(py, config, recording.as_deref(), Some(&mut law));
    let Some(raised) = law.raised else {
        return Ok(PyFlight { tape: Some(law.tape), ..PyFlight::of(flight?) });
    };
    if let Ok(flight) = flight
        && !flight.samples.is_empty()
    {
        raised.value(py).setattr("flight", Py::new(py, PyFlight::of(flight))?)?;
    }
    Err(raised)
}

/// Flies `config`. A signal ends the flight, and so does the end of the law.
fn flown(
    py: Python<'_>,
    config: Config,
    recording: Option<&Path>,
    law: Option<&mut (dyn ExternalLaw + Send)>,
) -> PyResult<Flight> {
    let mut poll = SignalPoll::new();
    let flown = task::detached(py, || {
        let mission = Mission::new(config)?;
        let recorder = recording.map(|path| recorder(path, &mission.config)).transpose()?;
        let watch = |_: &Recorder| poll.is_raised().then_some(OperatorCommand::Stop);
        let law = law.map_or_else(LawPort::default, LawPort::of);
        checked(simulation::fly_recorded(&mission, recorder, law, watch)?)
    });
    poll.raised.map_or(flown, Err)
}

/// A recorder of a flight under `config` into a new file.
fn recorder(path: &Path, config: &Config) -> Result<McapRecorder, Failure> {
    let plan = RecordingPlan {
        path: path.to_owned(),
        config,
        provenance: PROVENANCE,
        rotates: false,
        complain: |_| (),
    };
    McapRecorder::create(&plan).map_err(|error| {
        Failure::new(Exit::System, format!("{}: {error}; give another path", path.display()))
    })
}

/// The flight, if its recording is complete.
fn checked((flight, recording): RecordedFlight) -> Result<Flight, Failure> {
    match recording.and_then(|recording| recording.failure) {
        Some(failure) => Err(Failure::new(Exit::System, failure)),
        None => Ok(flight),
    }
}

/// Reads the flight of a recording, or one of several, `FILE#NUMBER`.
#[pyfunction]
fn read(py: Python<'_>, path: PathBuf) -> PyResult<PyFlight> {
    task::detached(py, || {
        let file = recording::read(&path).map_err(unreadable)?;
        let flight = recording::flight(&file).map_err(unreadable)?;
        if flight.samples.is_empty() {
            let message = format!("{} has no tick of a daemon: nothing to show", path.display());
            return Err(Failure::new(Exit::Data, message));
        }
        Ok(PyFlight { cut_off: file.cut_off.unwrap_or_default(), ..PyFlight::of(flight) })
    })
}

fn unreadable(error: RecordingFileError) -> Failure {
    let exit = if error.is_of_another_version() { Exit::Version } else { Exit::Data };
    Failure::new(exit, error.to_string())
}

/// The effective configuration of a call as TOML.
#[pyfunction]
fn config(py: Python<'_>, sources: Sources) -> PyResult<String> {
    task::detached(py, || Ok(sources.config()?.to_toml()))
}

/// The warnings of the program about the settings of a call.
#[pyfunction]
fn warnings(py: Python<'_>, sources: Sources) -> PyResult<Vec<String>> {
    task::interruptible(py, move |_| Ok(args::warnings(&sources.config()?)))
}

/// Registers the functions and the class.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyFlight>()?;
    module.add_function(wrap_pyfunction!(fly, module)?)?;
    module.add_function(wrap_pyfunction!(read, module)?)?;
    module.add_function(wrap_pyfunction!(config, module)?)?;
    module.add_function(wrap_pyfunction!(warnings, module)?)
}
