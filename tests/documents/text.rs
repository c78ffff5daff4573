//! Parsers for Markdown (tables, links, code) and for citations of equations and errata in sources.

use std::collections::{BTreeMap, BTreeSet};

/// A row of a table: its cells by column heading.
pub type Row = BTreeMap<String, String>;

/// A Markdown table.
pub struct Table {
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// The tables of a document.
    pub fn all(text: &str) -> Vec<Self> {
        let mut tables: Vec<Self> = Vec::new();
        let mut inside = false;
        for line in text.lines() {
            match (line.starts_with('|'), inside) {
                (true, false) => tables.push(Self { head: cells(line), rows: Vec::new() }),
                (true, true) => tables.last_mut().unwrap().rows.push(cells(line)),
                (false, _) => {}
            }
            inside = line.starts_with('|');
        }
        tables
    }

    pub fn has(&self, column: &str) -> bool {
        self.head.iter().any(|name| name == column)
    }

    /// Rows below the header rule.
    pub fn rows(&self) -> impl Iterator<Item = Row> + '_ {
        self.rows.iter().skip(1).map(|cells| {
            assert_eq!(cells.len(), self.head.len(), "cells in {cells:?}");
            self.head.iter().cloned().zip(cells.iter().cloned()).collect()
        })
    }
}

/// The cells of a line; `|` inside backticks is text.
fn cells(line: &str) -> Vec<String> {
    let mut cells = vec![String::new()];
    let mut code = false;
    for c in line.trim().trim_start_matches('|').chars() {
        code ^= c == '`';
        if c == '|' && !code {
            cells.push(String::new());
        } else {
            cells.last_mut().unwrap().push(c);
        }
    }
    cells.pop();
    cells.into_iter().map(|cell| cell.trim().to_owned()).collect()
}

/// Texts in backticks, outside code blocks.
pub fn quoted(text: &str) -> Vec<&str> {
    let prose = text.split("```").step_by(2);
    prose.flat_map(|part| part.split('`').skip(1).step_by(2)).collect()
}

/// The targets of links and images.
pub fn links(text: &str) -> Vec<String> {
    let until = |end: char| move |part: &str| part.split(end).next().unwrap_or("").to_owned();
    let markdown = text.split("](").skip(1).map(until(')'));
    let html = text.split("src=\"").skip(1).map(until('"'));
    markdown.chain(html).collect()
}

/// Whether `word` occurs without a letter, digit or underscore directly after it.
pub fn has_word(text: &str, word: &str) -> bool {
    let ends = |rest: &str| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_');
    text.match_indices(word).any(|(at, _)| ends(&text[at + word.len()..]))
}

/// The text without line breaks and comment marks, since a citation may continue on the next line.
fn joined(text: &str) -> String {
    let bare = |line: &str| line.trim().trim_start_matches(['/', '!']).trim().to_owned();
    text.lines().map(bare).collect::<Vec<_>>().join(" ")
}

/// Numbers at the beginning of a text, as in `(43), (70)` or `(8) to (12)`.
pub fn numbers(list: &str) -> BTreeSet<u32> {
    let mut found = BTreeSet::new();
    let mut rest = list.trim_start();
    let mut range_from: Option<u32> = None;
    while let Some((number, after)) = rest.strip_prefix('(').and_then(|rest| rest.split_once(')')) {
        let Ok(number) = number.parse() else { break };
        found.extend(range_from.take().unwrap_or(number)..=number);
        let after = after.trim_start();
        rest = if let Some(rest) = after.strip_prefix("to ") {
            range_from = Some(number);
            rest
        } else if let Some(rest) = after.strip_prefix("and ").or(after.strip_prefix(',')) {
            rest.trim_start()
        } else {
            break;
        };
    }
    found
}

/// Equations cited by a source.
pub fn cited_equations(source: &str) -> BTreeSet<u32> {
    let text = joined(source);
    let lists = text.split("Eq. ").skip(1).chain(text.split("Eqs. ").skip(1));
    lists.flat_map(numbers).collect()
}

/// Errata cited by a source.
pub fn cited_errata(source: &str) -> BTreeSet<String> {
    let text = joined(source);
    let lists = text.split("erratum ").skip(1).chain(text.split("errata ").skip(1));
    lists.flat_map(errata).collect()
}

/// Ids at the beginning of a text, as in `E-45a, E-45b, as printed`.
pub fn errata(list: &str) -> BTreeSet<String> {
    let id = |part: &str| -> Option<String> {
        let name = part.trim().strip_prefix("E-")?;
        let end = name.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(name.len());
        Some(format!("E-{}", &name[..end]))
    };
    list.split(',').map_while(id).collect()
}
