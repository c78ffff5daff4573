//! Columns of a study's tables: each with its key, its heading, and a function that gives the cell of a row.

use std::fmt;

use oqtal_control::statistics::{mean, quantile, standard_deviation};

use super::Flown;
use super::flights::Test;
use super::metric::{Figures, VELOCITY};
use crate::bootstrap::BootstrapInterval;
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

/// A column over rows `R`.
pub struct StudyColumn<'a, R: ?Sized> {
    /// Key in JSON and CSV, and heading.
    pub column: Column,
    cell: Box<dyn Fn(&R) -> SheetCell + 'a>,
}

/// Column with this key and heading; `cell` gives the cell of a row.
pub fn column<'a, R: ?Sized, C: Into<SheetCell>>(
    key: &'static str,
    title: &'static str,
    cell: impl Fn(&R) -> C + 'a,
) -> StudyColumn<'a, R> {
    StudyColumn { column: (key, title), cell: Box::new(move |row| cell(row).into()) }
}

impl<R: ?Sized> fmt::Debug for StudyColumn<'_, R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.column.fmt(f)
    }
}

/// Mean and standard deviation of `values`, NaN of a single one; no value if there are none.
pub fn spread(values: &[f64]) -> SheetCell {
    match values {
        [] => SheetCell::None,
        [one] => SheetCell::Spread(*one, f64::NAN),
        _ => SheetCell::Spread(mean(values), standard_deviation(values)),
    }
}

/// Mean of the finite values, marked if some are infinite: those of flights that did not land as planned, or did not settle.
pub fn mean_of(values: &[f64]) -> SheetCell {
    let finite: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    if finite.is_empty() {
        return SheetCell::None;
    }
    marked(SheetCell::Number(mean(&finite)), values.iter().any(|value| value.is_infinite()))
}

/// `cell`, marked if it is over a part of the flights.
pub fn marked(cell: SheetCell, is_partial: bool) -> SheetCell {
    let has_value = cell != SheetCell::None;
    if is_partial && has_value { SheetCell::Partial(Box::new(cell)) } else { cell }
}

/// Note on the errors of laws that predict.
const SET_POINTS: &str = "
Velocity and attitude errors are relative to the newest command of the law, in
`fly` to the command for the instant: laws that predict have smaller ones there.";

/// Note on the set-points if a table of `rows` has velocity and attitude errors of a law that predicts; otherwise empty.
pub fn set_point_note(rows: &[Flown]) -> &'static str {
    let predicts = |row: &Flown| {
        let first = row.conditions.first();
        first.is_some_and(|first| row.law.with(&first.settings).is_predictive())
    };
    let has_errors = |row: &&Flown| !row.landed(VELOCITY).is_empty();
    if rows.iter().filter(has_errors).any(predicts) { SET_POINTS } else { "" }
}

/// Beginnings of the keys of the columns of each test.
const TESTS: [(Test, &[&str]); 4] = [
    (Test::Path, &["settle", "attitude", "path", "position", "velocity", "overshoot"]),
    (Test::Hover, &["hover", "jitter"]),
    (Test::Chirp, &["chirp"]),
    (Test::Doublet, &["doublet"]),
];

/// Keys of the columns of tests that were not flown.
pub fn not_flown<R>(flown: &[Flown], columns: &[StudyColumn<'_, R>]) -> Vec<&'static str> {
    let missing = TESTS.iter().filter(|(test, _)| !flown.iter().any(|law| law.has_flown(*test)));
    let beginnings: Vec<&str> = missing.flat_map(|(_, keys)| keys.iter().copied()).collect();
    let keys = columns.iter().map(|column| column.column.0);
    keys.filter(|key| beginnings.iter().any(|beginning| key.starts_with(beginning))).collect()
}

/// Names of a row of a sheet: law, origin, settings.
pub type RowNames = (String, Variant, String);

impl Flown {
    /// Standard deviation of each figure over the flights that landed as planned; NaN of less than two, and where their mean is NaN.
    pub fn deviation_of_landed(&self) -> Figures {
        let means = self.mean_of_landed();
        std::array::from_fn(|metric| match self.landed(metric) {
            values if values.len() > 1 && means[metric].is_finite() => standard_deviation(&values),
            _ => f64::NAN,
        })
    }

    /// The quantile of [`Self::quantile`] with its confidence interval.
    pub fn quantile_interval(&self, metric: usize, share: f64) -> BootstrapInterval {
        let figure = |values: &[f64]| quantile(values.iter().copied(), share).unwrap_or(f64::NAN);
        BootstrapInterval::of(&self.values(metric), figure)
    }

    /// Whether a flight of the test was flown in every run.
    pub fn has_flown(&self, test: Test) -> bool {
        self.runs.iter().all(|run| run.ends.iter().any(|end| end.test == test))
    }

    /// Names of the row of a sheet: the law with the remark on its gains.
    pub fn names(&self) -> RowNames {
        (self.law.name.clone(), self.law.variant, self.law.remark.clone())
    }

    /// Names of the row of a sheet: the law with these settings.
    pub fn names_with(&self, settings: impl Into<String>) -> RowNames {
        (self.law.name.clone(), self.law.variant, settings.into())
    }
}

impl Sheet {
    /// Sheet with this name and title; each of `rows` has its names.
    pub fn tabulate<'r, R: 'r>(
        (name, title): (&str, &str),
        columns: &[StudyColumn<'_, R>],
        rows: impl IntoIterator<Item = &'r R>,
        names: impl Fn(&R) -> RowNames,
    ) -> Self {
        let row = |row: &R| {
            let (controller, variant, settings) = names(row);
            let cells = columns.iter().map(|column| (column.cell)(row)).collect();
            SheetRow::new(variant, controller, settings, cells)
        };
        Self {
            name: name.to_owned(),
            title: title.to_owned(),
            columns: columns.iter().map(|column| column.column).collect(),
            rows: rows.into_iter().map(row).collect(),
            ..Self::default()
        }
    }

    /// The sheet with an additional note.
    pub fn with_note(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    /// The sheet as a detail that is left out of Markdown.
    pub fn as_detail(self) -> Self {
        Self { is_detail: true, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::tests::flown;
    use oqtal_config::Setting;

    #[test]
    fn errors_of_laws_that_predict_have_a_note_on_their_set_points() {
        let of = |law, figure| set_point_note(&[flown("pid", &[1.0]), flown(law, &[figure])]);
        assert!(of("oqtal-dt", 1.0).starts_with("\nVelocity and attitude"));
        assert_eq!([of("lqr", 1.0), of("oqtal-dt", f64::INFINITY)], ["", ""]);
        let mut row = flown("pid", &[1.0]);
        let mut conditions = row.conditions.to_vec();
        conditions[0].settings.push(Setting::flag("sweep", "control.stack", "predictive"));
        row.conditions = conditions.into();
        assert_eq!(set_point_note(&[row]), SET_POINTS);
    }
}
