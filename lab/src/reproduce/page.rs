//! The chapters as an HTML page and as Markdown.

use maud::{Markup, html};

use oqtal_observe::page::page;

use super::chapter::Chapter;
use crate::sheet::{Sheet, SheetCell, SheetRow, Variant};

const STYLE: &str = include_str!("page.css");
/// Number of columns above which a table is set in a smaller type.
const WIDE: usize = 8;
/// Number of rows above which a table is folded.
const LONG: usize = 40;
/// What a page says about itself.
#[derive(Clone, Copy, Debug)]
pub struct PageHead {
    /// Heading.
    pub title: &'static str,
    /// First paragraph.
    pub lead: &'static str,
    /// Name of its files, without extension.
    pub file: &'static str,
}

/// The page of the paper.
pub const PAPER: PageHead = PageHead {
    title: "The paper, reproduced",
    lead: "Each table has three blocks. Paper: the printed numbers. As printed: the paper's equations, with only the \
     corrections without which nothing flies, computed here, with all settings the paper leaves open named. Ours: with \
     something the paper does not have. Nothing is tuned to meet a printed number.",
    file: "reproduction",
};

/// The HTML page of `chapters`.
#[must_use]
pub fn html(head: &PageHead, chapters: &[Chapter]) -> String {
    let body = html! {
        header {
            p.eyebrow { "oqtal" }
            h1 { (head.title) }
            p.note { (head.lead) }
        }
        main { @for chapter in chapters { (section(chapter)) } }
    };
    page(&format!("oqtal: {}", head.title), STYLE, &body)
}

fn section(chapter: &Chapter) -> Markup {
    html! {
        section {
            h2 { (chapter.title) }
            @for paragraph in &chapter.intro { p.note { (paragraph) } }
            @for sheet in &chapter.sheets {
                (table(sheet))
                @for other in &sheet.mismatched { (table(other)) }
            }
            @if !chapter.figures.is_empty() {
                div.grid { @for figure in &chapter.figures { (figure.markup) } }
            }
        }
    }
}

fn table(sheet: &Sheet) -> Markup {
    html! {
        div.sheet {
            h3 { (sheet.title) }
            @if sheet.rows.len() > LONG {
                details { summary { (sheet.rows.len()) " rows" } (rows(sheet)) }
            } @else {
                (rows(sheet))
            }
            @for note in &sheet.notes { p.note { (note) } }
        }
    }
}

fn rows(sheet: &Sheet) -> Markup {
    let shown = Variant::ALL.into_iter().filter(|variant| sheet.of(*variant).next().is_some());
    html! {
        table.wide[sheet.columns.len() > WIDE] {
            thead {
                tr {
                    th { "controller" }
                    th { "settings" }
                    @for (_, title) in &sheet.columns { th { (title) } }
                }
            }
            tbody {
                @for variant in shown {
                    tr.variant { th colspan=(sheet.columns.len() + 2) { (variant.title()) } }
                    @for row in sheet.of(variant) { (line(row)) }
                }
            }
        }
    }
}

fn line(row: &SheetRow) -> Markup {
    html! {
        tr {
            th { (row.controller) }
            td.settings { (row.settings) }
            @for cell in &row.cells { td { (SheetCell::show(cell)) } }
        }
    }
}

/// The tables of `chapters` as Markdown; `command` is the command that makes them.
#[must_use]
pub fn markdown(head: &PageHead, chapters: &[Chapter], command: &str) -> String {
    let PageHead { title, lead, file } = head;
    let mut text = format!(
        "# {title}\n\n{lead}\n\n```sh\n{command}\n```\n\nmakes this page with all figures, `{file}.html`.\n\n"
    );
    for chapter in chapters {
        text += &format!("## {}\n\n", chapter.title);
        for paragraph in &chapter.intro {
            text += &format!("{paragraph}\n\n");
        }
        for sheet in
            chapter.sheets.iter().flat_map(|sheet| std::iter::once(sheet).chain(&sheet.mismatched))
        {
            text += &sheet.to_markdown();
        }
    }
    text
}
