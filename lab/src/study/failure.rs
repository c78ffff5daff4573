//! Flights of a study that did not land as planned, and those with a step that did not settle: counted by law, case, test and
//! cause, with the command that flies one again.

use std::collections::BTreeMap;

use oqtal_config::Setting;
use oqtal_observe::flight::{Outcome, is_of_fence};
use serde_json::{Value, json};

use super::Flown;
use super::args::words_of;
use super::flights::{FlightCondition, Run, Test, TestEnd, changed};
use super::law::StudyLaw;
pub use super::room::Changes;
use super::room::{self, SHOWN_SEEDS};

/// Mark of a figure that is the mean of a part of the flights.
const MARK: &str = " *";

/// Cause of a flight that landed as planned and whose settling time has no value.
const UNSETTLED: &str = "a step did not settle before the next";

/// Flights of one law in one case whose figures are not complete, all with one test and cause.
#[derive(Clone, Debug)]
pub struct FailedFlights<'a> {
    /// The law.
    pub law: &'a StudyLaw,
    /// Name of the case.
    pub case: &'a str,
    /// The test.
    pub test: Test,
    /// Outcome of the flights.
    pub outcome: Outcome,
    /// Cause, without figures.
    pub cause: &'a str,
    /// Conditions of the failed flights.
    pub conditions: Vec<&'a FlightCondition>,
    /// Number of flights of this law with this test in the case \[-\].
    pub of: usize,
}

/// The flights of all rows that did not land as planned, or with a step that did not settle.
pub fn failed(rows: &[Flown]) -> Vec<FailedFlights<'_>> {
    rows.iter().flat_map(of_row).collect()
}

fn of_row(row: &Flown) -> Vec<FailedFlights<'_>> {
    let mut groups: BTreeMap<(usize, &str), FailedFlights<'_>> = BTreeMap::new();
    for (run, condition) in row.runs.iter().zip(row.conditions.iter()) {
        for TestEnd { test, outcome, cause } in &run.ends {
            let unsettled = run.is_unsettled(*test).then_some(UNSETTLED);
            let Some(cause) = cause.as_deref().or(unsettled) else { continue };
            let group =
                groups.entry((*test.figures().start(), cause)).or_insert_with(|| FailedFlights {
                    law: &row.law,
                    case: &row.case,
                    test: *test,
                    outcome: *outcome,
                    cause,
                    conditions: Vec::new(),
                    of: row.runs.len(),
                });
            group.conditions.push(condition);
        }
    }
    groups.into_values().collect()
}

impl FailedFlights<'_> {
    /// Command that flies the first of these flights again.
    pub fn command(&self) -> String {
        again(self.law, self.conditions[0], self.test)
    }

    /// The group as JSON.
    pub fn to_json(&self) -> Value {
        let seeds: Vec<u64> = self.conditions.iter().map(|condition| condition.seed).collect();
        json!({
            "controller": self.law.name,
            "case": case_name(self.case),
            "test": self.test.name(),
            "outcome": self.outcome,
            "cause": self.cause,
            "count": seeds.len(),
            "of": self.of,
            "seeds": seeds,
            "again": self.command(),
        })
    }

    /// Case and test.
    fn flown(&self) -> String {
        let case = if self.case.is_empty() { String::new() } else { format!("{}, ", self.case) };
        format!("{case}{}", self.test.name())
    }

    fn to_text(&self) -> String {
        let seeds: Vec<String> =
            self.conditions.iter().take(SHOWN_SEEDS).map(|c| c.seed.to_string()).collect();
        let more = if self.conditions.len() > SHOWN_SEEDS { ", …" } else { "" };
        let plural = if self.conditions.len() == 1 { "seed" } else { "seeds" };
        format!(
            "  {}, {}: {} of {}, {}\n    {plural} {}{more}; again: {}",
            self.law.name,
            self.flown(),
            self.conditions.len(),
            self.of,
            self.cause,
            seeds.join(", "),
            self.command()
        )
    }
}

/// Name of a case; null for a case without one.
pub fn case_name(case: &str) -> Value {
    if case.is_empty() { Value::Null } else { json!(case) }
}

/// Command that flies a test of `law` in `condition` again in one process.
pub fn again(law: &StudyLaw, condition: &FlightCondition, test: Test) -> String {
    let plant = changed(law, condition.plant).expect("the condition was flown");
    let mut settings = [law.settings_under(&condition.settings), plant].concat();
    settings.extend(test.trajectory().map(|name| Setting::flag("", "trajectory.kind", name)));
    format!(
        "oqtal fly --clock in-process --controller {} --seed {}{}",
        law.controller,
        condition.seed,
        words_of(&settings)
    )
}

/// Number of flights of these rows, and of those that did not land as planned \[-\].
pub fn counts(rows: &[Flown]) -> (usize, usize) {
    let ends = || rows.iter().flat_map(|row| &row.runs).flat_map(|run: &Run| &run.ends);
    (ends().count(), ends().filter(|end| end.cause.is_some()).count())
}

/// Changes with which the flights that needed more room would be complete, a paragraph for each trajectory; empty without any.
pub fn remedies(groups: &[FailedFlights<'_>], changes: Changes) -> String {
    let cramped = groups.iter().filter(|group| room::is_cramped(group.cause));
    room::remedies(
        cramped.map(|it| ((it.law, &it.conditions[..], it.test), is_of_fence(it.cause))),
        changes,
    )
}

/// Text about all flights, [`listed`], and the remedies for those that needed more room.
pub fn text(rows: &[Flown], table: &str) -> String {
    listed(rows, table) + &remedies(&failed(rows), Changes::All)
}

/// How many of all flights landed as planned, and the others, and those with a step that did not settle, by law, test and cause.
/// `table` is the text of the figures above it; its marks are explained.
pub fn listed(rows: &[Flown], table: &str) -> String {
    let (flights, failures) = counts(rows);
    let failed = failed(rows);
    let unsettled = failed.iter().filter(|group| group.cause == UNSETTLED);
    let head = match (failures, unsettled.map(|group| group.conditions.len()).sum::<usize>()) {
        (0, 0) => format!("all {flights} flights landed as planned"),
        (0, some) => format!(
            "all {flights} flights landed as planned, {some} of them with a step that did not settle"
        ),
        (_, 0) => format!("{failures} of {flights} flights did not land as planned"),
        (_, some) => format!(
            "{failures} of {flights} flights did not land as planned, and {some} had a step that did not settle"
        ),
    };
    let groups: Vec<String> = failed.iter().map(FailedFlights::to_text).collect();
    match groups.is_empty() {
        true => head,
        false => {
            let marks = if table.contains(MARK) { "; figures marked * leave out" } else { "" };
            format!("{head}{marks}:\n{}", groups.join("\n"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::tests::flown;

    #[test]
    fn failed_flights_are_counted_by_test_and_cause_and_can_be_flown_again() {
        let mut row = flown("pid", &[1.0, f64::INFINITY, 2.0, f64::INFINITY]);
        row.law.settings.push(Setting::flag("--set", "vehicle.mass-kg", 0.6));
        row.runs[3].ends[0].cause = Some("hit the floor".to_owned());
        let rows = [flown("lqr", &[1.0]), row];
        let groups = failed(&rows);
        assert_eq!(groups.len(), 5, "two causes of the path, one of each other test");
        let path = groups.iter().find(|group| group.cause == "hit the floor").unwrap();
        assert_eq!((path.test, path.conditions[0].seed, path.of), (Test::Path, 3, 4));
        let hover = groups.iter().find(|group| group.test == Test::Hover).unwrap();
        assert_eq!(hover.conditions.len(), 2);
        let command = "oqtal fly --clock in-process --controller pid --seed 1 \
                       --set vehicle.mass-kg=0.6 --trajectory hover";
        assert_eq!(hover.command(), command);
        assert_eq!(hover.to_json()["case"], Value::Null, "as in the rows of tests and flights");
        let text = text(&rows, "–");
        assert!(text.starts_with("8 of 20 flights did not land as planned:"), "{text}");
        assert!(
            text.contains("hover: 2 of 4, motors stopped: speed\n    seeds 1, 3; again"),
            "{text}"
        );
        assert_eq!(super::text(&rows[..1], "–"), "all 4 flights landed as planned");
    }

    #[test]
    fn a_flight_on_another_plant_is_flown_again_on_it() {
        let plant = crate::study::flights::MISMATCHED[3];
        let condition = FlightCondition { seed: 7, plant, settings: Vec::new() };
        let command = again(&StudyLaw::new("pid", Vec::new(), ""), &condition, Test::Hover);
        let changed = "--seed 7 --set plant.rate-lag-ms=30.0 --trajectory hover";
        assert!(command.ends_with(changed), "{command}");
    }

    #[test]
    fn a_flight_with_a_step_that_did_not_settle_is_listed_and_has_landed() {
        let mut rows = [flown("pid", &[1.0, 2.0])];
        rows[0].runs[1].figures[crate::study::metric::SETTLE] = f64::INFINITY;
        assert!(!text(&rows, "0.28").contains("marked"), "nothing is marked");
        let text = text(&rows, "0.28 *");
        assert!(
            text.starts_with(
                "all 8 flights landed as planned, 1 of them with a step that did not settle; figures marked * leave out:"
            ),
            "{text}"
        );
        assert!(text.contains("pid, path: 1 of 2, a step did not settle"), "{text}");
        assert!(text.contains("seed 1; again"), "{text}");
        let failed = flown("lqr", &[f64::INFINITY]);
        let text = super::text(&[rows[0].clone(), failed], "");
        let head = "4 of 12 flights did not land as planned, and 1 had a step that did not settle:";
        assert!(text.starts_with(head), "{text}");
    }
}
