//! The notebook for new users, executed cell by cell.

use crate::common::sources::root;
use crate::common::{Testbed, peers, stderr};

#[test]
fn every_cell_of_the_notebook_runs_and_draws() {
    let Some(mut python) = peers::python("notebook.py") else { return };
    let testbed = Testbed::new("notebook");
    let output = python
        .arg(root().join("examples/first_hour.ipynb"))
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
