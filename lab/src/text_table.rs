//! Tables for a terminal of 80 columns; a wider table is split into several blocks, one below the other.

use std::borrow::Borrow;

use comfy_table::presets::UTF8_FULL_CONDENSED;
use comfy_table::{CellAlignment, Table};

/// Greatest width of a block \[columns\].
const WIDTH: usize = 80;

/// One row: its names, and its figures.
pub type NamedRow = (Vec<String>, Vec<String>);

/// Table in Markdown, without a trailing line break.
pub fn markdown(headings: &[impl Borrow<str>], rows: impl Iterator<Item = Vec<String>>) -> String {
    let head = format!("| {} |\n|{}", headings.join(" | "), "---|".repeat(headings.len()));
    let lines = rows.map(|cells| format!("\n| {} |", cells.join(" | ")));
    head + &lines.collect::<String>()
}

/// Rows under their headings. Each block begins with the row names, followed by the figures that fit.
pub fn blocks(named: &[String], figures: &[String], rows: &[NamedRow]) -> String {
    let width = |heading: &str, cell: &dyn Fn(&NamedRow) -> usize| {
        // A cell has a space on each side and a line.
        3 + rows.iter().map(cell).fold(heading.chars().count(), usize::max)
    };
    let names: usize = (0..named.len())
        .map(|k| width(&named[k], &|row: &NamedRow| row.0[k].chars().count()))
        .sum();
    let widths: Vec<usize> = (0..figures.len())
        .map(|k| width(&figures[k], &|row: &NamedRow| row.1[k].chars().count()))
        .collect();
    let (mut text, mut from) = (String::new(), 0);
    while from < figures.len() {
        let mut room = WIDTH.saturating_sub(1 + names);
        let fits = |width: &&usize| {
            let fits = **width <= room;
            room = room.saturating_sub(**width);
            fits
        };
        let count = widths[from..].iter().take_while(fits).count().max(1);
        text += &block(named, figures, rows, from..from + count);
        from += count;
    }
    text.trim_end().to_owned()
}

fn block(
    named: &[String],
    figures: &[String],
    rows: &[NamedRow],
    part: std::ops::Range<usize>,
) -> String {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED);
    table.set_header(named.iter().chain(&figures[part.clone()]));
    for (names, cells) in rows {
        table.add_row(names.iter().chain(&cells[part.clone()]));
    }
    for column in table.column_iter_mut().skip(named.len()) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    format!("{table}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(count: usize, word: &str) -> Vec<String> {
        (0..count).map(|k| format!("{word} {k}")).collect()
    }

    #[test]
    fn every_figure_is_shown_once_within_80_columns() {
        for count in [1, 4, 9, 14] {
            let rows: Vec<NamedRow> =
                (0..3).map(|row| (texts(1, "law"), texts(count, &format!("cell {row}")))).collect();
            let text = blocks(&texts(1, "name"), &texts(count, "figure"), &rows);
            assert!(text.lines().all(|line| line.chars().count() <= WIDTH), "{text}");
            for k in 0..count {
                assert_eq!(text.matches(&format!("figure {k} ")).count(), 1, "{text}");
                assert_eq!(text.matches(&format!("cell 2 {k} ")).count(), 1, "{text}");
            }
        }
    }

    #[test]
    fn a_column_wider_than_the_terminal_has_a_block_of_its_own() {
        let wide = "w".repeat(100);
        let rows = vec![(texts(1, "law"), vec![wide.clone(), "1".to_owned()])];
        let text = blocks(&texts(1, "name"), &texts(2, "figure"), &rows);
        assert!(text.contains(&wide) && text.matches("name 0").count() == 2, "{text}");
    }
}
