//! The notebook of the first hour, executed cell by cell.

mod common;

use std::path::Path;
use std::process::Command;

use common::{Testbed, skipped, stderr};

/// Runs if `OQTAL_PEERS_PYTHON` names an interpreter with `tests/peers/requirements.txt`.
#[test]
fn every_cell_of_the_notebook_runs_and_draws() {
    let Some(python) = std::env::var_os("OQTAL_PEERS_PYTHON") else {
        return skipped("OQTAL_PEERS_PYTHON names no interpreter");
    };
    let testbed = Testbed::new("notebook");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = Command::new(python)
        .arg(root.join("tests/peers/notebook.py"))
        .arg(root.join("examples/first_hour.ipynb"))
        .current_dir(testbed.path(""))
        .env("OQTAL", env!("CARGO_BIN_EXE_oqtal"))
        .env("FIRST_HOUR_OUT", testbed.path("out"))
        .env("OQTAL_ROOT", testbed.path("run"))
        .env("OQTAL_INSTANCE__NAME", testbed.instance())
        .env("MPLCONFIGDIR", testbed.path("matplotlib"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("landed: mean position error") && said.contains("3 figures"), "{said}");
}
