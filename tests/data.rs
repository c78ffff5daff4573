//! The dictionary of flight data, docs/data.md, agrees with the written files.

use crate::common::Testbed;
use oqtal_lab::study::metric::METRIC;

const DOCUMENT: &str = include_str!("../docs/data.md");

#[test]
fn the_columns_of_telemetry_are_described_as_in_the_code() {
    let dictionary = oqtal_observe::csv::DICTIONARY;
    assert!(DOCUMENT.contains(dictionary), "docs/data.md must hold this table:\n\n{dictionary}");
}

#[test]
fn every_entry_of_a_summary_and_every_figure_of_a_study_is_described() {
    let testbed = Testbed::new("dictionary");
    let summary =
        testbed.summary(&["--clock", "in-process", "--trajectory", "hover", "--duration", "1"]);
    let entries = summary.as_object().unwrap().keys().map(String::as_str);
    for name in entries.chain(METRIC.map(|metric| metric.key)) {
        assert!(DOCUMENT.contains(&format!("`{name}`")), "{name} has no meaning in docs/data.md");
    }
}
