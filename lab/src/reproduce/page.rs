//! The chapters as an HTML page and as Markdown.

use std::path::PathBuf;

use maud::{Markup, PreEscaped, html};
use oqtal_observe::page::page;
use oqtal_runtime::process::Failure;

use super::chapter::Chapter;
use super::claims::{Claim, claims};
use crate::output::StudyOutput;
use crate::sheet::{Sheet, SheetCell, SheetRow, Variant};
use crate::study::args::command;
use crate::text_table;

const STYLE: &str = include_str!("page.css");
/// Sorts a table by the selected column; the page is complete without it.
const SCRIPT: &str = include_str!("page.js");
/// Number of columns above which a table is set in smaller type.
const WIDE: usize = 8;
/// Title of the section of claims.
const CLAIMS: &str = "The claims of the paper, and the results";
/// Number of rows above which a table is collapsed.
const LONG: usize = 40;
/// Heading and introduction of a page.
#[derive(Clone, Copy, Debug)]
pub struct PageHead {
    /// Heading.
    pub title: &'static str,
    /// First paragraph.
    pub lead: &'static str,
    /// Name of its files, without extension.
    pub file: &'static str,
}

impl PageHead {
    /// Names of the page, of the same as Markdown, and of the JSON document.
    pub fn files(&self) -> [String; 3] {
        ["html", "md", "json"].map(|extension| format!("{}.{extension}", self.file))
    }

    /// Writes the page, the same as Markdown, and `document` into the directory of `output`, and completes the study. Returns the path
    /// of the page.
    ///
    /// # Errors
    /// A file cannot be written (exit code 71).
    pub fn write(
        &self,
        output: &StudyOutput,
        chapters: &[Chapter],
        document: &str,
    ) -> Result<PathBuf, Failure> {
        let [page, markdown_page, json] = self.files();
        output.write(&page, html(self, chapters))?;
        output.write(&markdown_page, markdown(self, chapters, &command()))?;
        output.write(&json, document)?;
        output.complete()?;
        Ok(output.directory.join(page))
    }
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
fn html(head: &PageHead, chapters: &[Chapter]) -> String {
    let claims = claims(chapters);
    let body = html! {
        header {
            p.eyebrow { "oqtal" }
            h1 { (head.title) }
            p.note { (prose(head.lead)) }
        }
        main {
            @if !claims.is_empty() { (verdicts(&claims)) }
            (contents(chapters))
            @for chapter in chapters { (section(chapter)) }
        }
        script { (PreEscaped(SCRIPT)) }
    };
    page(&format!("oqtal: {}", head.title), STYLE, &body)
}

/// Claims of the paper, each with its verdict and the table that decides it.
fn verdicts(claims: &[Claim]) -> Markup {
    html! {
        section.verdicts {
            h2 { (CLAIMS) }
            ul {
                @for claim in claims {
                    li {
                        span.badge.(claim.verdict.class()) { (claim.verdict.shown()) }
                        div {
                            a href=(format!("#{}", anchor(claim.sheet))) { (claim.claim) }
                            p.note { (claim.found) "." }
                        }
                    }
                }
            }
        }
    }
}

/// Links to the chapters and their tables.
fn contents(chapters: &[Chapter]) -> Markup {
    html! {
        nav {
            h2 { "Contents" }
            ol {
                @for chapter in chapters {
                    li {
                        a href=(format!("#{}", anchor(chapter.title))) { (chapter.title) }
                        ul {
                            @for sheet in &chapter.sheets {
                                li { a href=(format!("#{}", anchor(&sheet.name))) { (sheet.title) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Anchor of a heading on the page.
fn anchor(name: &str) -> String {
    let lower = name.to_lowercase();
    lower.chars().map(|letter| if letter.is_alphanumeric() { letter } else { '-' }).collect()
}

fn section(chapter: &Chapter) -> Markup {
    html! {
        section id=(anchor(chapter.title)) {
            h2 { (chapter.title) }
            @for paragraph in &chapter.intro { p.note { (prose(paragraph)) } }
            @for sheet in &chapter.sheets {
                (table(sheet))
                @for other in &sheet.mismatched { (table(other)) }
            }
            @if !chapter.figures.is_empty() {
                div.grid { @for figure in &chapter.figures { (figure) } }
            }
        }
    }
}

fn table(sheet: &Sheet) -> Markup {
    html! {
        div.sheet id=(anchor(&sheet.name)) {
            h3 { (sheet.title) }
            @if sheet.rows.len() > LONG {
                details { summary { (sheet.rows.len()) " rows" } (rows(sheet)) }
            } @else {
                (rows(sheet))
            }
            @for note in &sheet.notes { p.note { (prose(note)) } }
        }
    }
}

fn rows(sheet: &Sheet) -> Markup {
    let shown = Variant::ALL.into_iter().filter(|variant| sheet.of(*variant).next().is_some());
    // As in Markdown: rows of one origin alone have no heading.
    let has_headings = sheet.rows.iter().any(|row| row.variant != Variant::Ours);
    html! {
        table.wide[sheet.columns.len() > WIDE] {
            thead {
                tr {
                    th { "controller" }
                    th { "settings" }
                    @for (column, (_, title)) in sheet.columns.iter().enumerate() {
                        th.words[has_words(sheet, column)] { (title) }
                    }
                }
            }
            @for variant in shown {
                tbody {
                    @if has_headings {
                        tr.variant { th colspan=(sheet.columns.len() + 2) { (variant.title()) } }
                    }
                    @for row in sheet.of(variant) { (line(sheet, row)) }
                }
            }
        }
    }
}

/// Whether a column holds texts, which are set as such, and not as figures.
fn has_words(sheet: &Sheet, column: usize) -> bool {
    sheet.rows.iter().any(|row| matches!(row.cells[column], SheetCell::Text(_)))
}

fn line(sheet: &Sheet, row: &SheetRow) -> Markup {
    html! {
        tr {
            th { (row.controller) }
            td.settings { (row.settings) }
            @for (column, (_, title)) in sheet.columns.iter().enumerate() {
                @let mark = sheet.mark(row, column).map(|near| if near { "near" } else { "far" });
                @let words = has_words(sheet, column).then_some("words");
                td class=[mark.or(words)] data-name=(title) { (sheet.show(row, column)) }
            }
        }
    }
}

/// Text with code marked in Markdown.
fn prose(text: &str) -> Markup {
    html! {
        @for (number, part) in text.split('`').enumerate() {
            @if number % 2 == 1 { code { (part) } } @else { (part) }
        }
    }
}

/// Tables of `chapters` as Markdown; `command` is the command that generates them.
fn markdown(head: &PageHead, chapters: &[Chapter], command: &str) -> String {
    let PageHead { title, lead, file } = head;
    let mut text = format!(
        "# {title}\n\n{lead}\n\n```sh\n{command}\n```\n\nmakes this page with all figures, `{file}.html`.\n\n"
    );
    let claims = claims(chapters);
    if !claims.is_empty() {
        let row = |Claim { claim, verdict, found, .. }: &Claim| {
            vec![(*claim).to_owned(), verdict.shown().to_owned(), found.replace('|', "\\|")]
        };
        let table = text_table::markdown(&["claim", "verdict", "found"], claims.iter().map(row));
        text += &format!("## {CLAIMS}\n\n{table}\n\n");
    }
    for chapter in chapters {
        text += &format!("## {}\n\n", chapter.title);
        for paragraph in &chapter.intro {
            text += &format!("{paragraph}\n\n");
        }
        let shown = chapter.sheets.iter().filter(|sheet| !sheet.is_detail);
        for sheet in shown.flat_map(|sheet| std::iter::once(sheet).chain(&sheet.mismatched)) {
            text += &sheet.to_markdown();
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_one_origin_have_no_heading_and_texts_are_set_as_words() {
        let row = |variant| {
            let cells = vec![1.0.into(), SheetCell::Text("oqtal fly".to_owned())];
            SheetRow::new(variant, "pid", "", cells)
        };
        let sheet = |variants: &[Variant]| Sheet {
            columns: vec![("a", "A"), ("again", "again")],
            rows: variants.iter().map(|variant| row(*variant)).collect(),
            ..Sheet::default()
        };
        let own = rows(&sheet(&[Variant::Ours])).into_string();
        assert!(!own.contains("Ours") && own.contains(r#"<td class="words""#), "{own}");
        assert_eq!(own.matches("words").count(), 2, "{own}");
        let several = rows(&sheet(&[Variant::Paper, Variant::Ours])).into_string();
        assert!(several.contains("Ours") && several.contains("Paper"), "{several}");
    }
}
