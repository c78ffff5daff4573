//! HTML pages in the style of the flight report.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::plot::palette;

const STYLE: &str = include_str!("page.css");
/// Reads values from plots and enlarges them; the page is complete without the script.
const SCRIPT: &str = include_str!("page.js");

/// Beginning of every page.
const BEGINNING: &[u8] = br#"<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><meta name="generator" content="oqtal">"#;

/// Whether the file at `path` is a page made by [`page`].
pub fn is_page(path: &Path) -> bool {
    let mut start = [0; BEGINNING.len()];
    File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == *BEGINNING
}

/// A complete HTML document in the style of the reports, with the style sheet `style` appended.
pub fn page(title: &str, style: &str, body: &Markup) -> String {
    let has_plots = body.0.contains("data-plot=");
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="generator" content="oqtal";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                style { (PreEscaped(palette::css())) (PreEscaped(STYLE)) (PreEscaped(style)) }
            }
            body {
                (body)
                @if has_plots { script { (PreEscaped(SCRIPT)) } }
            }
        }
    };
    page.into_string()
}

/// A section of a page: a heading above a grid.
pub fn section(title: &str, content: Markup) -> Markup {
    html! { section { h2 { (title) } div.grid { (content) } } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_recognised() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let is_page_of = |content: &str| {
            std::fs::write(file.path(), content).unwrap();
            is_page(file.path())
        };
        assert!(is_page_of(&page("title", "", &html! { p { "text" } })));
        assert!(!is_page_of("<!DOCTYPE html><html lang=\"en\"><head></head></html>"));
        assert!(!is_page_of("short"));
    }
}
