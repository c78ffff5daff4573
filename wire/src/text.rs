//! Text of another machine, escaped for a log.

/// Most characters that are kept \[-\]: more than any regular name or message.
const MAX_CHARS: usize = 256;

/// The text as one short line: control characters and invisible ones are escaped, longer text is cut off.
pub fn printable(text: &str) -> String {
    let mut line = String::with_capacity(text.len().min(MAX_CHARS));
    let mut rest = text.chars();
    for c in rest.by_ref().take(MAX_CHARS) {
        if c.is_control() || is_invisible(c) {
            line.extend(c.escape_unicode());
        } else {
            line.push(c);
        }
    }
    if rest.next().is_some() {
        line.push('…');
    }
    line
}

/// Marks of direction, separators of lines and paragraphs, spaces without width.
fn is_invisible(c: char) -> bool {
    matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn printable_text_is_unchanged() {
        assert_eq!(printable("Größe `7` \"x\""), "Größe `7` \"x\"");
    }

    #[test]
    fn lines_colours_and_lengths_do_not_reach_a_log() {
        let text = printable("\n\u{1b}[31m\u{202e}x\0");
        assert_eq!(text, "\\u{a}\\u{1b}[31m\\u{202e}x\\u{0}");
        let long = printable(&"\n".repeat(1 << 20));
        assert!(long.len() <= 8 * MAX_CHARS && long.ends_with('…'), "{}", long.len());
    }
}
