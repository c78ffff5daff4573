//! Sheets: rows of figures, each from the paper, as printed or ours. Every table, in every form, is made from one.

use serde_json::{Map, Value, json};

use oqtal_observe::plot::unit::{MISSING, rounded};

/// Where a row comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Variant {
    /// Printed in the paper.
    Paper,
    /// The paper's equations with only the corrections without which nothing flies, computed here.
    AsPrinted,
    /// With something the paper does not have.
    Ours,
}

impl Variant {
    /// All of them, in the order in which they are shown.
    pub const ALL: [Self; 3] = [Self::Paper, Self::AsPrinted, Self::Ours];

    /// As JSON has it.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::AsPrinted => "as-printed",
            Self::Ours => "ours",
        }
    }

    /// As people read it.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Paper => "Paper",
            Self::AsPrinted => "As printed",
            Self::Ours => "Ours",
        }
    }
}

/// One figure of a row.
#[derive(Clone, Debug, PartialEq)]
pub enum SheetCell {
    /// A number.
    Number(f64),
    /// Mean and standard deviation.
    Spread(f64, f64),
    /// Mean and half the width of its confidence interval.
    Interval(f64, f64),
    /// A count.
    Count(u64),
    /// A word.
    Text(String),
    /// Nothing to say.
    None,
}

impl SheetCell {
    fn to_json(&self) -> Value {
        match self {
            Self::Number(number) => json!(number),
            Self::Spread(mean, sd) => json!({ "mean": mean, "sd": sd }),
            Self::Interval(mean, half) => json!({ "mean": mean, "half_width": half }),
            Self::Count(count) => json!(count),
            Self::Text(text) => json!(text),
            Self::None => Value::Null,
        }
    }

    /// As people read it, four significant digits.
    #[must_use]
    pub fn show(&self) -> String {
        match self {
            Self::Number(number) => rounded(*number, 4),
            Self::Spread(mean, width) | Self::Interval(mean, width) => {
                format!("{} ± {}", rounded(*mean, 4), rounded(*width, 2))
            }
            Self::Count(count) => count.to_string(),
            Self::Text(text) => text.clone(),
            Self::None => MISSING.to_owned(),
        }
    }
}

impl From<f64> for SheetCell {
    fn from(number: f64) -> Self {
        Self::Number(number)
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

/// A column: its name in JSON, and its heading.
pub type Column = (&'static str, &'static str);

/// One row of a [`Sheet`].
#[derive(Clone, Debug, PartialEq)]
pub struct SheetRow {
    /// Which attitude law.
    pub controller: String,
    /// Where it comes from.
    pub variant: Variant,
    /// With which settings.
    pub settings: String,
    /// One for each column.
    pub cells: Vec<SheetCell>,
}

impl SheetRow {
    /// A row of `variant`.
    #[must_use]
    pub fn new(
        variant: Variant,
        controller: impl Into<String>,
        settings: impl Into<String>,
        cells: Vec<SheetCell>,
    ) -> Self {
        Self { controller: controller.into(), variant, settings: settings.into(), cells }
    }

    /// The number in a column, counts included; not a number where there is none.
    #[must_use]
    pub fn number(&self, columns: &[Column], key: &str) -> f64 {
        let cell = columns.iter().zip(&self.cells).find(|((name, _), _)| *name == key);
        match cell {
            Some((
                _,
                SheetCell::Number(number)
                | SheetCell::Spread(number, _)
                | SheetCell::Interval(number, _),
            )) => *number,
            Some((_, SheetCell::Count(count))) => *count as f64,
            _ => f64::NAN,
        }
    }

    /// The row as a JSON object with flat keys.
    #[must_use]
    pub fn to_json(&self, columns: &[Column]) -> Value {
        let mut object = Map::new();
        object.insert("controller".to_owned(), json!(self.controller));
        object.insert("variant".to_owned(), json!(self.variant.key()));
        object.insert("settings".to_owned(), json!(self.settings));
        for ((key, _), cell) in columns.iter().zip(&self.cells) {
            object.insert((*key).to_owned(), cell.to_json());
        }
        Value::Object(object)
    }
}

/// A table of figures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sheet {
    /// Its name in JSON: the paper's number where it has one.
    pub name: String,
    /// Its heading.
    pub title: String,
    /// What a reader must know, a paragraph each.
    pub notes: Vec<String>,
    /// The columns behind controller and settings.
    pub columns: Vec<Column>,
    /// The rows, paper first.
    pub rows: Vec<SheetRow>,
    /// The same under other conditions, which their names say.
    pub mismatched: Vec<Sheet>,
}

impl Sheet {
    /// The rows of one variant.
    pub fn of(&self, variant: Variant) -> impl Iterator<Item = &SheetRow> {
        self.rows.iter().filter(move |row| row.variant == variant)
    }

    /// The figures of the first row of a law and variant whose settings hold all of `words`; none of them is a number if there
    /// is no such row.
    #[must_use]
    pub fn figures<const N: usize>(
        &self,
        (controller, variant): (&str, Variant),
        words: &[&str],
        keys: [&str; N],
    ) -> [f64; N] {
        let is_meant = |row: &&SheetRow| {
            row.controller == controller && words.iter().all(|word| row.settings.contains(word))
        };
        let row = self.of(variant).find(is_meant);
        keys.map(|key| row.map_or(f64::NAN, |row| row.number(&self.columns, key)))
    }

    /// As JSON: `{"table", "rows"}`, and `"mismatched"` if there is any.
    #[must_use]
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

    /// The headings, controller and settings included.
    fn headings(&self) -> Vec<&str> {
        let own = self.columns.iter().map(|(_, title)| *title);
        ["", "controller", "settings"].into_iter().chain(own).collect()
    }

    /// As a plain table for a terminal.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut table = comfy_table::Table::new();
        table.load_style(comfy_table::presets::UTF8_FULL_CONDENSED);
        table.set_header(self.headings());
        for row in &self.rows {
            let named = [row.variant.key(), &row.controller, &row.settings].map(str::to_owned);
            table.add_row(named.into_iter().chain(row.cells.iter().map(SheetCell::show)));
        }
        for column in table.column_iter_mut().skip(3) {
            column.set_cell_alignment(comfy_table::CellAlignment::Right);
        }
        format!("{}\n{table}", self.title)
    }

    /// As Markdown, one block of rows for each variant.
    #[must_use]
    pub fn to_markdown(&self) -> String {
        // A bar in a cell would end it.
        let headings: Vec<String> =
            self.headings().iter().map(|heading| heading.replace('|', "\\|")).collect();
        let mut text = format!("### {}\n\n", self.title);
        for note in &self.notes {
            text += &format!("{note}\n\n");
        }
        text += &format!("| {} |\n|{}\n", headings.join(" | "), "---|".repeat(headings.len()));
        for variant in Variant::ALL {
            for row in self.of(variant) {
                let cells: Vec<String> = row.cells.iter().map(SheetCell::show).collect();
                let (name, settings) = (&row.controller, row.settings.replace('|', "\\|"));
                let cells = cells.join(" | ");
                text += &format!("| {} | {name} | {settings} | {cells} |\n", variant.title());
            }
        }
        text + "\n"
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
    fn a_bar_does_not_end_a_cell_of_markdown() {
        let text = sheet().to_markdown();
        assert!(text.contains("∫\\|A\\|"), "{text}");
        let cells = |line: &str| line.replace("\\|", "").matches('|').count();
        assert!(text.lines().filter(|line| line.starts_with('|')).all(|line| cells(line) == 7));
    }

    #[test]
    fn every_form_shows_every_figure() {
        for text in [sheet().to_text(), sheet().to_markdown()] {
            for word in ["0.004992", "1.250 ± 0.033", "–", "oqtal", "q 256"] {
                assert!(text.contains(word), "{word} in\n{text}");
            }
        }
    }
}
