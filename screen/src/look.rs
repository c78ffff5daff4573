//! Colours and symbols of the picture. Every state is also shown in words, and important texts are bold or inverse: no
//! information depends on colour alone.

use std::ffi::OsStr;

/// Importance of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weight {
    /// Expected, and highlighted.
    Good,
    /// A value.
    Plain,
    /// Worse than expected.
    Warning,
    /// Requires action.
    Alarm,
    /// A label or a title.
    Label,
}

/// Bars of a chart by their height \[eighths of a cell\]: of block characters, and of letters for terminals without them.
const BLOCKS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
const LETTERS: [char; 9] = [' ', '.', ':', '-', '=', '+', '*', '#', '#'];

/// Look of the picture.
#[derive(Clone, Copy, Debug)]
pub struct ScreenLook {
    /// Whether colours are used.
    pub has_colour: bool,
    /// Whether the terminal shows characters beyond ASCII.
    pub has_blocks: bool,
}

impl ScreenLook {
    /// Look for an environment in which `variable` returns the value of a variable that is set and not empty.
    pub fn of_environment(variable: impl Fn(&str) -> Option<std::ffi::OsString>) -> Self {
        // The first variable that is set takes precedence, locale(7).
        let locale = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter().find_map(&variable);
        let is_utf8 = |locale: &OsStr| {
            let name = locale.to_string_lossy().to_lowercase();
            name.contains("utf-8") || name.contains("utf8")
        };
        Self {
            has_colour: variable("NO_COLOR").is_none(),
            has_blocks: locale.is_some_and(|locale| is_utf8(&locale)),
        }
    }

    /// Control sequence before a text: SGR of ECMA-48.
    pub fn sequence(self, weight: Weight) -> &'static str {
        match (weight, self.has_colour) {
            (Weight::Plain, _) | (Weight::Good, false) => "\x1b[0m",
            (Weight::Good, true) => "\x1b[0;32m",
            (Weight::Warning | Weight::Label, false) => "\x1b[0;1m",
            (Weight::Warning, true) => "\x1b[0;1;33m",
            (Weight::Label, true) => "\x1b[0;1;36m",
            (Weight::Alarm, false) => "\x1b[0;1;7m",
            (Weight::Alarm, true) => "\x1b[0;1;7;31m",
        }
    }

    /// Character of a bar of this height \[eighths of a cell\].
    pub fn bar(self, eighths: usize) -> char {
        if self.has_blocks { BLOCKS[eighths] } else { LETTERS[eighths] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(variables: &[(&str, &str)]) -> ScreenLook {
        ScreenLook::of_environment(|name| {
            let found = variables.iter().find(|(known, _)| *known == name);
            found.map(|(_, value)| value.into())
        })
    }

    #[test]
    fn colour_and_characters_follow_the_environment() {
        let modern = look(&[("LANG", "en_GB.UTF-8")]);
        assert!(modern.has_colour && modern.has_blocks);
        let plain = look(&[("LANG", "C.utf8"), ("LC_ALL", "C"), ("NO_COLOR", "1")]);
        assert!(!plain.has_colour && !plain.has_blocks);
        assert_eq!(plain.sequence(Weight::Alarm), "\x1b[0;1;7m");
        assert!(!look(&[]).has_blocks);
    }
}
