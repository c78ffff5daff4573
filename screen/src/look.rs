//! Colours and symbols of the picture. Without colour every state is still said in words, and what matters is bold or inverse.

use std::ffi::OsStr;

use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::bar;

/// How much a text matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weight {
    /// As expected, and worth seeing.
    Good,
    /// A value.
    Plain,
    /// Worse than it should be.
    Warning,
    /// To be acted on.
    Alarm,
    /// A label or a title.
    Label,
}

/// Bars of letters, for terminals without block characters.
const LETTERS: bar::Set<'static> = bar::Set {
    full: "#",
    seven_eighths: "#",
    three_quarters: "*",
    five_eighths: "+",
    half: "=",
    three_eighths: "-",
    one_quarter: ":",
    one_eighth: ".",
    empty: " ",
};

/// How the picture looks.
#[derive(Clone, Copy, Debug)]
pub struct ScreenLook {
    /// Whether colours are used.
    pub has_colour: bool,
    /// Whether the terminal shows characters beyond ASCII.
    pub has_blocks: bool,
}

impl ScreenLook {
    /// The look that the environment asks for: `variable` returns the value of a variable if it is set and not empty.
    #[must_use]
    pub fn of_environment(variable: impl Fn(&str) -> Option<std::ffi::OsString>) -> Self {
        // The first of them that is set rules, locale(7).
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

    /// Style of a text.
    #[must_use]
    pub fn style(self, weight: Weight) -> Style {
        let style = match weight {
            Weight::Good | Weight::Plain => Style::new(),
            Weight::Warning | Weight::Label => Style::new().add_modifier(Modifier::BOLD),
            Weight::Alarm => Style::new().add_modifier(Modifier::BOLD | Modifier::REVERSED),
        };
        match (self.has_colour, weight) {
            (true, Weight::Good) => style.fg(Color::Green),
            (true, Weight::Warning) => style.fg(Color::Yellow),
            (true, Weight::Alarm) => style.fg(Color::Red),
            (true, Weight::Label) => style.fg(Color::Cyan),
            _ => style,
        }
    }

    /// Symbols of a chart.
    #[must_use]
    pub fn bars(self) -> bar::Set<'static> {
        if self.has_blocks { bar::NINE_LEVELS } else { LETTERS }
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
        assert!(plain.style(Weight::Alarm).fg.is_none());
        assert!(!look(&[]).has_blocks);
    }
}
