//! The extension module of the Python package `oqtal`: flights, studies and the mathematics of the paper, computed by the crates of
//! the workspace. The package's Python code in `../oqtal` is its only user.
//!
//! | file | subject |
//! |---|---|
//! | `error.rs` | failures and panics as Python exceptions |
//! | `task.rs` | work without the interpreter's lock, which signals end |
//! | `settings.rs` | Python values as settings of the configuration |
//! | `flight.rs` | flights and recordings, their columns and pages |
//! | `law.rs` | laws written in Python |
//! | `lanes.rs`, `lanes/` | environments stepped together |
//! | `instance.rs` | a running instance: commands and references |
//! | `observation.rs` | observation of a running instance |
//! | `studies.rs` | campaigns, sweeps, robustness, identification, tuning |
//! | `paper.rs` | tracking error, error models, Riccati equations, gravity turn |

mod error;
mod flight;
mod instance;
mod lanes;
mod law;
mod observation;
mod paper;
mod settings;
mod studies;
mod task;

use numpy::PyArray1;
use pyo3::prelude::*;

/// Registers the functions and classes of the module.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    error::install_panic_hook();
    // Loads NumPy now: during a later call, a signal could interrupt the import.
    PyArray1::<f64>::zeros(module.py(), 0, false);
    module.add("VERSION", env!("CARGO_PKG_VERSION"))?;
    module.add("REVISION", env!("REVISION_OF_OQTAL"))?;
    #[cfg(debug_assertions)]
    task::register(module)?;
    flight::register(module)?;
    lanes::register(module)?;
    instance::register(module)?;
    observation::register(module)?;
    studies::register(module)?;
    paper::register(module)
}
