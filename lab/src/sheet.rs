//! Sheets: tables of figures printed in the paper or computed here, as JSON, text and Markdown; the HTML page shows them too.

use oqtal_observe::plot::unit::{MISSING, rounded};
use serde_json::{Value, json};

use crate::bootstrap::BootstrapInterval;
use crate::text_table::{self, NamedRow};

/// The origin of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Variant {
    /// Printed in the paper.
    Paper,
    /// Computed here from the paper's equations, with only the corrections without which no flight succeeds.
    AsPrinted,
    /// Computed here with features that are not in the paper.
    Ours,
}

impl Variant {
    /// All variants in display order.
    pub const ALL: [Self; 3] = [Self::Paper, Self::AsPrinted, Self::Ours];

    /// Name in JSON.
    pub fn key(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::AsPrinted => "as-printed",
            Self::Ours => "ours",
        }
    }

    /// Heading.
    pub fn title(self) -> &'static str {
        match self {
            Self::Paper => "Paper",
            Self::AsPrinted => "As printed",
            Self::Ours => "Ours",
        }
    }
}

/// One cell of a row; numbers have the unit of their column.
#[derive(Clone, Debug, PartialEq)]
pub enum SheetCell {
    /// A number \[unit of the column\].
    Number(f64),
    /// Mean and standard deviation, NaN of one value \[unit of the column\].
    Spread(f64, f64),
    /// Mean and half the width of its confidence interval \[unit of the column\].
    Interval(f64, f64),
    /// A number between the ends of its confidence interval \[unit of the column\].
    Bounded(BootstrapInterval),
    /// A count.
    Count(u64),
    /// A text.
    Text(String),
    /// Value over a part of the flights: the others did not land as planned.
    Partial(Box<SheetCell>),
    /// No value.
    None,
}

impl SheetCell {
    /// The cell as JSON: a number, a text, an object of two numbers, or null.
    pub fn to_json(&self) -> Value {
        match self {
            Self::Number(number) => json!(number),
            Self::Spread(mean, sd) => json!({ "mean": mean, "sd": sd }),
            Self::Interval(mean, half) => json!({ "mean": mean, "half_width": half }),
            Self::Bounded(BootstrapInterval { value, low, high }) => {
                json!({ "value": value, "low": low, "high": high })
            }
            Self::Count(count) => json!(count),
            Self::Text(text) => json!(text),
            Self::Partial(cell) => cell.to_json(),
            Self::None => Value::Null,
        }
    }

    /// The number or the mean \[unit of the column\]; NaN if there is none.
    fn number(&self) -> f64 {
        match self {
            Self::Number(number) | Self::Spread(number, _) | Self::Interval(number, _) => *number,
            Self::Bounded(interval) => interval.value,
            Self::Count(count) => *count as f64,
            Self::Partial(cell) => cell.number(),
            Self::Text(_) | Self::None => f64::NAN,
        }
    }

    /// Text of the cell; numbers have four significant digits.
    pub fn show(&self) -> String {
        match self {
            Self::Number(number) => rounded(*number, 4),
            Self::Spread(one, sd) if sd.is_nan() => rounded(*one, 4),
            Self::Spread(mean, width) | Self::Interval(mean, width) => {
                format!("{} ± {}", rounded(*mean, 4), rounded(*width, 2))
            }
            Self::Bounded(BootstrapInterval { value, .. }) if !value.is_finite() => {
                rounded(*value, 4)
            }
            Self::Bounded(BootstrapInterval { value, low, high }) => {
                format!("{} ({} to {})", rounded(*value, 4), rounded(*low, 3), rounded(*high, 3))
            }
            Self::Count(count) => count.to_string(),
            Self::Text(text) => text.clone(),
            Self::Partial(cell) => format!("{} *", cell.show()),
            Self::None => MISSING.to_owned(),
        }
    }
}

impl From<f64> for SheetCell {
    fn from(number: f64) -> Self {
        Self::Number(number)
    }
}

impl From<BootstrapInterval> for SheetCell {
    fn from(interval: BootstrapInterval) -> Self {
        Self::Bounded(interval)
    }
}

impl From<u64> for SheetCell {
    fn from(count: u64) -> Self {
        Self::Count(count)
    }
}

impl From<&str> for SheetCell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl<T: Into<SheetCell>> From<Option<T>> for SheetCell {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::None, Into::into)
    }
}

/// Relative deviation up to which a printed figure counts as reproduced \[-\].
const NEAR: f64 = 0.1;

/// Whether a computed figure reproduces the printed one.
pub fn is_near(ours: f64, printed: f64) -> bool {
    (ours / printed - 1.0).abs() <= NEAR
}

/// A column: name in JSON, and heading.
pub type Column = (&'static str, &'static str);

/// One row of a [`Sheet`].
#[derive(Clone, Debug, PartialEq)]
pub struct SheetRow {
    /// Attitude law.
    pub controller: String,
    /// Origin.
    pub variant: Variant,
    /// Settings of the law.
    pub settings: String,
    /// Cells, one for each column.
    pub cells: Vec<SheetCell>,
}

impl SheetRow {
    /// A row of `variant`.
    pub fn new(
        variant: Variant,
        controller: impl Into<String>,
        settings: impl Into<String>,
        cells: Vec<SheetCell>,
    ) -> Self {
        Self { controller: controller.into(), variant, settings: settings.into(), cells }
    }

    /// Number in a column, including counts \[unit of the column\]; NaN if the cell has none.
    pub fn number(&self, columns: &[Column], key: &str) -> f64 {
        let cell = columns.iter().zip(&self.cells).find(|((name, _), _)| *name == key);
        cell.map_or(f64::NAN, |(_, cell)| cell.number())
    }

    /// The row as a JSON object with flat keys.
    pub fn to_json(&self, columns: &[Column]) -> Value {
        let (variant, settings) = (self.variant.key(), &self.settings);
        let mut object =
            json!({ "controller": self.controller, "variant": variant, "settings": settings });
        for ((key, _), cell) in columns.iter().zip(&self.cells) {
            object[*key] = cell.to_json();
        }
        object
    }
}

/// A table of figures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sheet {
    /// Name in JSON: the paper's number of the table, if it has one.
    pub name: String,
    /// Heading.
    pub title: String,
    /// Notes, one item for each paragraph.
    pub notes: Vec<String>,
    /// Columns after controller and settings.
    pub columns: Vec<Column>,
    /// Rows, those of the paper first.
    pub rows: Vec<SheetRow>,
    /// The same table for other plants, by name.
    pub mismatched: Vec<Sheet>,
    /// Whether figures of the variant as printed are marked as reproducing the paper's figure or not.
    pub is_marked: bool,
    /// Whether the table is a detail that is left out of Markdown.
    pub is_detail: bool,
}

impl Sheet {
    /// The sheet without the columns that have one of these keys.
    pub fn without(mut self, keys: &[&str]) -> Self {
        let is_kept = |column: &usize| !keys.contains(&self.columns[*column].0);
        let kept: Vec<usize> = (0..self.columns.len()).filter(is_kept).collect();
        self.columns = kept.iter().map(|k| self.columns[*k]).collect();
        for row in &mut self.rows {
            row.cells = kept.iter().map(|k| row.cells[*k].clone()).collect();
        }
        self
    }

    /// Rows of one variant.
    pub fn of(&self, variant: Variant) -> impl Iterator<Item = &SheetRow> {
        self.rows.iter().filter(move |row| row.variant == variant)
    }

    /// Whether the figure of `row` in column `column` reproduces the one printed for the law; `None` without a printed one.
    pub fn mark(&self, row: &SheetRow, column: usize) -> Option<bool> {
        if !self.is_marked || row.variant != Variant::AsPrinted {
            return None;
        }
        let (key, _) = self.columns[column];
        let paper = self.of(Variant::Paper).find(|paper| paper.controller == row.controller)?;
        let [printed, ours] = [paper, row].map(|row| row.number(&self.columns, key));
        printed.is_finite().then(|| is_near(ours, printed))
    }

    /// Text of a cell, with its mark.
    pub fn show(&self, row: &SheetRow, column: usize) -> String {
        let shown = row.cells[column].show();
        match self.mark(row, column) {
            None => shown,
            Some(true) => format!("{shown} ✓"),
            Some(false) => format!("{shown} ✗"),
        }
    }

    /// The sheet as JSON: `{"table", "rows"}`, and `"mismatched"` with other plants.
    pub fn to_json(&self) -> Value {
        let mut object = json!({ "table": self.name, "rows": self.json_rows() });
        if !self.mismatched.is_empty() {
            let other = |sheet: &Self| json!({ "plant": sheet.name, "rows": sheet.json_rows() });
            object["mismatched"] = self.mismatched.iter().map(other).collect();
        }
        object
    }

    fn json_rows(&self) -> Vec<Value> {
        self.rows.iter().map(|row| row.to_json(&self.columns)).collect()
    }

    /// The sheet as tables for the terminal; names common to all rows are above them, columns without a value left out.
    pub fn to_text(&self) -> String {
        let (shared, own) = self.names();
        let title = [self.title.clone()].into_iter().chain(shared).collect::<Vec<_>>().join("\n");
        let named: Vec<String> = own.iter().map(|(heading, _)| (*heading).to_owned()).collect();
        let filled: Vec<usize> = (0..self.columns.len())
            .filter(|k| self.rows.iter().any(|row| row.cells[*k] != SheetCell::None))
            .collect();
        let figures: Vec<String> = filled.iter().map(|k| self.columns[*k].1.to_owned()).collect();
        let row = |(k, row): (usize, &SheetRow)| {
            let names = own.iter().map(|(_, cells)| cells[k].clone()).collect();
            (names, filled.iter().map(|k| self.show(row, *k)).collect())
        };
        let rows: Vec<NamedRow> = self.rows.iter().enumerate().map(row).collect();
        format!("{title}\n{}", text_table::blocks(&named, &figures, &rows))
    }

    /// Texts common to all rows, and headings with the names of each row; settings that differ are listed above the table.
    fn names(&self) -> (Vec<String>, Vec<(&'static str, Vec<String>)>) {
        let column = |cell: fn(&SheetRow) -> &str| -> Vec<String> {
            self.rows.iter().map(|row| cell(row).to_owned()).collect()
        };
        let variants = column(|row| row.variant.key());
        let settings = column(|row| &row.settings);
        let is_same = |cells: &[String]| cells.windows(2).all(|pair| pair[0] == pair[1]);
        let mut own = vec![("controller", column(|row| &row.controller))];
        let mut above = Vec::new();
        if !is_same(&variants) {
            own.insert(0, ("", variants));
        }
        if is_same(&settings) {
            above.extend(settings.first().cloned());
        } else {
            let numbers: Vec<String> = (1..=settings.len()).map(|k| k.to_string()).collect();
            let listed = numbers.iter().zip(&settings).zip(&own[own.len() - 1].1);
            above.extend(listed.map(|((k, text), law)| format!("  {k} {law}: {text}")));
            own.insert(0, ("row", numbers));
        }
        (above, own)
    }

    /// The sheet as Markdown, a block for each variant; no variant if all rows are ours, no settings if all rows share them.
    pub fn to_markdown(&self) -> String {
        let variants = self.rows.iter().any(|row| row.variant != Variant::Ours);
        let settings = self.rows.windows(2).any(|pair| pair[0].settings != pair[1].settings);
        // An unescaped bar would end the cell.
        let cells = |variant: &str, law: &str, set: &str, figures: Vec<String>| -> Vec<String> {
            let names = [variants.then_some(variant), Some(law), settings.then_some(set)];
            let names = names.into_iter().flatten().map(|name| name.replace('|', "\\|"));
            names.chain(figures).collect()
        };
        let titles = self.columns.iter().map(|(_, title)| title.replace('|', "\\|")).collect();
        let headings = cells("", "controller", "settings", titles);
        let mut text = format!("### {}\n\n", self.title);
        for note in &self.notes {
            text += &format!("{note}\n\n");
        }
        let row = |row: &SheetRow| {
            let figures = (0..row.cells.len()).map(|k| self.show(row, k)).collect();
            cells(row.variant.title(), &row.controller, &row.settings, figures)
        };
        let rows = Variant::ALL.into_iter().flat_map(|variant| self.of(variant)).map(row);
        text + &text_table::markdown(&headings, rows) + "\n\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet() -> Sheet {
        let cells =
            vec![SheetCell::Number(0.004_992), SheetCell::Spread(1.25, 0.033), SheetCell::None];
        Sheet {
            name: "IV".to_owned(),
            title: "Table IV".to_owned(),
            columns: vec![("a", "∫|A|"), ("b", "B"), ("c", "C")],
            rows: vec![SheetRow::new(Variant::Ours, "oqtal", "q 256", cells)],
            ..Sheet::default()
        }
    }

    #[test]
    fn json_has_flat_rows() {
        let expected = json!({ "table": "IV", "rows": [{
            "controller": "oqtal", "variant": "ours", "settings": "q 256",
            "a": 0.004_992, "b": { "mean": 1.25, "sd": 0.033 }, "c": null,
        }] });
        assert_eq!(sheet().to_json(), expected);
    }

    #[test]
    fn a_figure_as_printed_is_marked_against_the_printed_one() {
        let row = |variant, number: f64| {
            let cells = vec![number.into(), SheetCell::None, SheetCell::None];
            SheetRow::new(variant, "oqtal", "", cells)
        };
        let rows =
            vec![row(Variant::Paper, 1.0), row(Variant::AsPrinted, 1.05), row(Variant::Ours, 1.0)];
        let marked = Sheet { rows, is_marked: true, ..sheet() };
        assert_eq!(
            [0, 1, 2].map(|k| marked.show(&marked.rows[k], 0)),
            ["1.000", "1.050 ✓", "1.000"]
        );
        let far = row(Variant::AsPrinted, 2.0);
        assert_eq!((marked.mark(&far, 0), marked.mark(&far, 1)), (Some(false), None));
    }

    #[test]
    fn a_bar_does_not_end_a_cell_of_markdown() {
        let text = sheet().to_markdown();
        assert!(text.contains("∫\\|A\\|"), "{text}");
        let cells = |line: &str| line.replace("\\|", "").matches('|').count();
        assert!(text.lines().filter(|line| line.starts_with('|')).all(|line| cells(line) == 5));
    }

    #[test]
    fn every_form_shows_every_figure() {
        for text in [sheet().to_text(), sheet().to_markdown()] {
            for word in ["0.004992", "1.250 ± 0.033", "oqtal"] {
                assert!(text.contains(word), "{word} in\n{text}");
            }
        }
        assert!(sheet().to_markdown().contains("–") && !sheet().to_text().contains("–"));
    }
}
