//! Texts of the reproduction: titles, columns, notes and claims, read from `text.toml`.
//!
//! Expressions in the texts are described in [`super::expression`].

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;

use super::chapter::Chapter;
use super::expression::{NamedRows, TextScope, TextValues};
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

/// All texts of the reproduction.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Texts {
    chapter: BTreeMap<String, ChapterText>,
    table: BTreeMap<String, TableText>,
    claim: Vec<ClaimText>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ChapterText {
    title: String,
    #[serde(default)]
    intro: Vec<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TableText {
    title: String,
    #[serde(default)]
    columns: Vec<[String; 2]>,
    /// Rows printed in the paper.
    #[serde(default)]
    paper: Vec<PrintedRow>,
    #[serde(default)]
    rows: NamedRows,
    #[serde(default)]
    notes: Vec<String>,
}

/// Row of a table of the paper.
#[derive(Debug, Deserialize)]
struct PrintedRow {
    law: String,
    #[serde(default)]
    settings: String,
    /// Cells by column key; an array is mean and standard deviation.
    #[serde(flatten)]
    cells: BTreeMap<String, toml::Value>,
}

impl PrintedRow {
    fn row(&self, columns: &[Column]) -> SheetRow {
        let cell = |(key, _): &Column| match self.cells.get(*key) {
            Some(toml::Value::Float(number)) => SheetCell::Number(*number),
            Some(toml::Value::Integer(count)) => SheetCell::Count(count.unsigned_abs()),
            Some(toml::Value::String(text)) => SheetCell::Text(text.clone()),
            Some(toml::Value::Array(spread)) => {
                let [mean, sd] = [0, 1].map(|k| spread[k].as_float().unwrap_or(f64::NAN));
                SheetCell::Spread(mean, sd)
            }
            _ => SheetCell::None,
        };
        let cells = columns.iter().map(cell).collect();
        SheetRow::new(Variant::Paper, self.law.clone(), self.settings.clone(), cells)
    }
}

/// A claim of the paper with its bounds.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClaimText {
    /// Name of the table that decides the claim.
    pub table: String,
    /// Text of the claim.
    pub claim: String,
    /// Conditions, one per part of the claim.
    pub holds: Vec<String>,
    /// Result shown beside the verdict.
    pub found: String,
}

static TEXTS: LazyLock<Texts> =
    LazyLock::new(|| toml::from_str(include_str!("text.toml")).expect("a test reads the file"));

/// All claims of the paper.
pub fn claims() -> &'static [ClaimText] {
    &TEXTS.claim
}

/// Chapter `name` without tables and figures.
pub fn chapter(name: &str, values: &TextValues) -> Chapter {
    let ChapterText { title, intro } = &TEXTS.chapter[name];
    let (sheet, rows) = (&Sheet::default(), &NamedRows::new());
    let scope = TextScope { sheet, rows, values };
    let intro = intro.iter().map(|text| scope.render(text)).collect();
    Chapter { title, intro, ..Chapter::default() }
}

/// Table `name` with the printed rows and `rows`, without notes.
pub fn table(name: &str, rows: Vec<SheetRow>) -> Sheet {
    let columns = TEXTS.table[name].columns.iter();
    table_of(name, columns.map(|[key, heading]| -> Column { (key, heading) }).collect(), rows)
}

/// Table `name` with the printed rows, `rows` and `columns`, without notes.
pub fn table_of(name: &str, columns: Vec<Column>, rows: Vec<SheetRow>) -> Sheet {
    let TableText { title, paper, .. } = &TEXTS.table[name];
    let rows = paper.iter().map(|row| row.row(&columns)).chain(rows).collect();
    Sheet { name: name.to_owned(), title: title.clone(), columns, rows, ..Sheet::default() }
}

/// `sheet` with its notes.
pub fn with_notes(sheet: Sheet, values: &TextValues) -> Sheet {
    let scope = scope(&sheet, values);
    let notes = TEXTS.table[&sheet.name].notes.iter().map(|note| scope.render(note)).collect();
    Sheet { notes, ..sheet }
}

/// Names that the texts about `sheet` can use.
pub fn scope<'a>(sheet: &'a Sheet, values: &'a TextValues) -> TextScope<'a> {
    TextScope { sheet, rows: &TEXTS.table[&sheet.name].rows, values }
}

/// A list as text: "a, b and c", or "none".
pub fn listed<T: AsRef<str>>(items: &[T]) -> String {
    let items: Vec<&str> = items.iter().map(AsRef::as_ref).collect();
    match items.as_slice() {
        [] => "none".to_owned(),
        [only] => (*only).to_owned(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::table::COLUMNS;

    #[test]
    fn lists_read_as_sentences() {
        assert_eq!(listed::<&str>(&[]), "none");
        assert_eq!(listed(&["a"]), "a");
        assert_eq!(listed(&["a", "b", "c"]), "a, b and c");
    }

    #[test]
    fn every_text_of_the_file_is_known() {
        assert!(claims().iter().all(|claim| TEXTS.table.contains_key(&claim.table)));
        let rows = TEXTS.table.values().flat_map(|table| table.rows.values());
        let origins: Vec<&str> = Variant::ALL.map(Variant::key).to_vec();
        assert!(rows.into_iter().all(|row| origins.contains(&row[0].as_str())));
    }

    fn is_separator(letter: char) -> bool {
        !letter.is_alphanumeric() && letter != '_'
    }

    /// Every word is a value here, and the tables have no rows: an unknown row, column or function ends the test.
    #[test]
    fn every_expression_can_be_evaluated() {
        for (name, text) in &TEXTS.table {
            let further = [("better", ""), ("worse", "")];
            let sheet = match text.columns.is_empty() {
                true => table_of(name, COLUMNS.into_iter().chain(further).collect(), Vec::new()),
                false => table(name, Vec::new()),
            };
            let about: Vec<&ClaimText> = claims().iter().filter(|it| it.table == *name).collect();
            let texts: Vec<&'static String> =
                about.iter().map(|claim| &claim.found).chain(&text.notes).collect();
            let words = texts.iter().flat_map(|text| text.split(is_separator));
            let values: TextValues = words.map(|word| (word, 1.0.into())).collect();
            let scope = scope(&sheet, &values);
            assert!(texts.iter().all(|text| !scope.render(text).contains('{')), "{name}");
            let parts: Vec<&String> = about.iter().flat_map(|claim| &claim.holds).collect();
            let held = parts.iter().filter(|part| scope.holds(part)).count();
            assert!(parts.is_empty() || held < parts.len(), "{name} without rows");
        }
    }
}
