//! Explanations of the terms of the closing table.

use oqtal_config::Config;

use crate::flight::Flight;
use crate::summary::Summary;

/// Width of a line \[columns\].
const WIDTH: usize = 80;

/// Terms of the closing table with their meanings: lines `term: meaning`, each below the condition for showing it.
const TERMS: &str = include_str!("explain.txt");

/// Terms in the closing table of `flight`, for the figures in `summary`, with their meanings.
pub fn terms(flight: &Flight, summary: &Summary) -> Vec<(&'static str, String)> {
    let mut condition = "";
    let mut terms = Vec::new();
    for line in TERMS.lines() {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            condition = name;
        } else if let Some((term, meaning)) = line.split_once(": ")
            && is_shown(condition, summary)
        {
            terms.push((term, with_values(meaning, &flight.config, summary)));
        }
    }
    terms
}

fn is_shown(condition: &str, summary: &Summary) -> bool {
    let has_hops = summary.hops.values().any(|hop| hop.count > 0);
    let is_real_time = summary.wakeup_lateness.is_some();
    match condition {
        "errors" => summary.position_error_m.is_some(),
        "corners" => summary.corners.is_some(),
        "attitude steps" => summary.attitude_steps.is_some(),
        "hops" => has_hops,
        "hops in real time" => has_hops && is_real_time,
        "answers" => is_real_time && summary.answers.is_some(),
        "wire" => has_hops && summary.wire.is_some(),
        "real time" => is_real_time,
        _ => true,
    }
}

/// `meaning` with the values of the flight in place of their names.
fn with_values(meaning: &str, config: &Config, summary: &Summary) -> String {
    let source = match summary.error_source {
        "truth" => "the true motion of the simulator",
        _ => "the measured poses",
    };
    meaning
        .replace("{scored}", &format!("{:.1}", summary.scored_s))
        .replace("{source}", source)
        .replace("{period}", &format!("{:.1}", 1e3 / config.loop_rate_hz()))
        .replace("{coast}", &config.safety.coast_ms.to_string())
}

/// The terms as text of at most 80 columns.
pub fn text(terms: &[(&'static str, String)]) -> String {
    let longest = terms.iter().map(|(term, _)| term.len()).max().unwrap_or(0);
    let lines = terms.iter().flat_map(|(term, meaning)| {
        let wrapped = wrap(meaning, WIDTH - longest - 2);
        let names = std::iter::once(*term).chain(std::iter::repeat(""));
        wrapped.into_iter().zip(names).map(move |(line, name)| format!("{name:<longest$}  {line}"))
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// `text` in lines of at most 80 columns; continuation lines are indented by `indent` columns.
pub fn wrapped(text: &str, indent: usize) -> String {
    wrap(text, WIDTH - indent).join(&format!("\n{}", " ".repeat(indent)))
}

/// `text` in lines of at most `width` characters, broken between words.
fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let last = lines.len() - 1;
        let line = &mut lines[last];
        if !line.is_empty() && line.chars().count() + 1 + word.chars().count() > width {
            lines.push(word.to_owned());
        } else {
            line.push_str(if line.is_empty() { "" } else { " " });
            line.push_str(word);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::fixture;

    #[test]
    fn every_line_fits_a_terminal_and_what_is_not_shown_is_not_explained() {
        let flight = fixture::square();
        let summary = Summary::of(&flight);
        let said = text(&terms(&flight, &summary));
        assert!(said.lines().all(|line| line.chars().count() <= WIDTH), "{said}");
        for word in ["error over", "sensor to actuator", "states", "Coast"] {
            assert!(said.contains(word), "{word} in\n{said}");
        }
        assert!(!said.contains("wire, air"), "{said}");
        let replay = fixture::replay();
        let said = text(&terms(&replay, &Summary::of(&replay)));
        assert!(!said.contains("error over"), "{said}");
    }
}
