//! HTML pages in the style of the flight report.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::plot::palette;

const STYLE: &str = include_str!("page.css");
/// Reads values from plots and enlarges them; the page is complete without the script.
const SCRIPT: &str = include_str!("page.js");

/// Beginning of every page.
const BEGINNING: &[u8] = br#"<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><meta name="generator" content="oqtal">"#;

/// Whether `content` is that of a page made by [`page`].
pub fn is_page(content: &[u8]) -> bool {
    content.starts_with(BEGINNING)
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
        assert!(is_page(page("title", "", &html! { p { "text" } }).as_bytes()));
        assert!(!is_page(
            b"<!DOCTYPE html><html lang=\"en\"><head><meta charset=\"utf-8\"></head></html>"
        ));
    }
}
