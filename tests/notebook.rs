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

#[test]
fn every_block_of_the_page_about_pandas_runs_on_the_flights_of_the_page() {
    let Some(python) = peers::python("notebook.py") else { return };
    let testbed = Testbed::new("pandas");
    let page = std::fs::read_to_string(root().join("docs/pandas.md")).unwrap();
    let blocks = |kind: &str| -> Vec<String> {
        let begun = format!("```{kind}\n");
        let blocks = page.split(&begun).skip(1).filter_map(|rest| rest.split("```").next());
        blocks.map(str::to_owned).collect()
    };
    let (lines, programs) = (blocks("sh").concat(), blocks("python"));
    let campaign = "oqtal campaign --runs 1 --controllers pid";
    for line in lines.lines().chain([campaign]) {
        let words: Vec<&str> = line.split_whitespace().skip(1).collect();
        let mut command = testbed.study(&words);
        command.env("OQTAL_ROOT", testbed.path("run"));
        let output = command.env("OQTAL_INSTANCE__NAME", testbed.instance()).output().unwrap();
        assert!(output.status.success(), "{line}: {}", stderr(&output));
    }
    assert_eq!(programs.len(), 3);
    for program in programs {
        let mut command = std::process::Command::new(python.get_program());
        let output = command.arg("-c").arg(&program).current_dir(testbed.path("")).output();
        let output = output.unwrap();
        assert!(output.status.success(), "{program}\n{}", stderr(&output));
        // A mean for each case: the hover alone, and with a gust and a payload.
        if program.contains("campaign") {
            let said = String::from_utf8_lossy(&output.stdout);
            let means = said.lines().filter(|line| line.starts_with("pid") || line.contains("NaN"));
            assert!(means.count() == 2 && said.contains("gust and payload"), "{said}");
        }
    }
}
