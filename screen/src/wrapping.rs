//! Texts in lines of limited width.

/// Breaks `text` into lines of at most `width` characters, at spaces, or inside a word that is longer than a line \[cells\]. Returns at
/// least one line.
pub fn wrapped(text: &str, width: u16) -> Vec<String> {
    let width = usize::from(width.max(1));
    let mut lines = vec![String::new()];
    let mut used = 0;
    for word in text.split(' ') {
        let length = word.chars().count();
        if used > 0 && used + 1 + length <= width {
            lines.last_mut().expect("there is a line").extend([" ", word]);
            used += 1 + length;
            continue;
        }
        if used > 0 {
            lines.push(String::new());
            used = 0;
        }
        for character in word.chars() {
            if used == width {
                lines.push(String::new());
                used = 0;
            }
            lines.last_mut().expect("there is a line").push(character);
            used += 1;
        }
    }
    lines
}

/// Wraps like [`wrapped`], into at most `rows` lines, but at least one; the last line contains the rest of the text.
pub fn folded(text: &str, width: u16, rows: u16) -> Vec<String> {
    let mut lines = wrapped(text, width);
    let kept = usize::from(rows.max(1)) - 1;
    if lines.len() > kept + 1 {
        let rest = lines.split_off(kept).join(" ");
        lines.push(rest);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_character_is_lost_and_no_line_is_too_long() {
        assert_eq!(
            wrapped("not ready: the vehicle is tilted", 12),
            ["not ready:", "the vehicle", "is tilted"]
        );
        assert_eq!(wrapped("a /a/long/path b", 5), ["a", "/a/lo", "ng/pa", "th b"]);
        assert_eq!(
            (wrapped("", 5), wrapped("ab", 0)),
            (vec![String::new()], vec!["a".into(), "b".into()])
        );
        assert_eq!(folded("one two three four", 5, 2), ["one", "two three four"]);
        assert_eq!(folded("one two", 9, 1), ["one two"]);
    }
}
