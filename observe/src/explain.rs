//! The words of the closing table, each explained in a line.

use oqtal_config::Config;

use crate::flight::Flight;
use crate::summary::Summary;

/// Width of a line \[columns\].
const WIDTH: usize = 80;

/// The terms of the closing table of `flight` that its `summary` has, with their meanings.
#[must_use]
pub fn terms(flight: &Flight, summary: &Summary) -> Vec<(&'static str, String)> {
    let mut terms = scoring(summary);
    if summary.hops.values().any(|hop| hop.count > 0) {
        terms.extend(latency(summary));
    }
    terms.extend(counts(&flight.config, summary));
    terms
}

/// The terms as text of at most 80 columns.
#[must_use]
pub fn text(terms: &[(&'static str, String)]) -> String {
    let longest = terms.iter().map(|(term, _)| term.len()).max().unwrap_or(0);
    let lines = terms.iter().flat_map(|(term, meaning)| {
        let wrapped = wrap(meaning, WIDTH - longest - 2);
        let names = std::iter::once(*term).chain(std::iter::repeat(""));
        wrapped.into_iter().zip(names).map(move |(line, name)| format!("{name:<longest$}  {line}"))
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// `text` in lines of at most 80 columns, the further ones indented by `indent` columns.
#[must_use]
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

fn scoring(summary: &Summary) -> Vec<(&'static str, String)> {
    if summary.position_error_m.is_none() {
        return Vec::new();
    }
    let against = match summary.error_source {
        "truth" => "the true motion of the simulator",
        _ => "the measured poses",
    };
    let scored_s = summary.scored_s;
    [
        ("error over", format!("the {scored_s:.1} s that are scored: the trajectory itself, without take-off, settling and landing; of a hover, from 10 s after it is reached; compared with {against}")),
        ("position", "distance from the reference position".to_owned()),
        ("velocity", "distance from the velocity that the position loops command".to_owned()),
        ("attitude", "angle between the attitude and the one that is commanded".to_owned()),
    ]
    .into()
}

fn latency(summary: &Summary) -> Vec<(&'static str, String)> {
    let mut terms = vec![
        ("capture to publish", "from the exposure of the cameras to the pose on the bus"),
        ("publish to daemon", "until the controller is woken"),
        ("compute", "until its command is on the bus"),
        ("command to vehicle", "until simulator or bridge reads it"),
        (
            "vehicle to applied",
            "until it takes effect; behind a bridge, until its last byte is handed to the wire",
        ),
        (
            "wire, air",
            "behind a bridge: time of the bytes on the wire; from there to the effect, configured by bridge.air-latency-ms, not measured",
        ),
        ("sensor to actuator", "sum of all hops of a command: from capture to effect"),
        ("p50, p99, p99.9", "half of all samples, 99 % and 99.9 % took at most this time"),
    ];
    if summary.wakeup_lateness.is_some() {
        terms.push(("wake-up lateness", "from the arrival of a pose, or from the deadline without one, to the start of the tick"));
        terms.push(("period jitter", "deviation of the time between two ticks from the period"));
    } else {
        terms.retain(|(term, _)| {
            !matches!(*term, "publish to daemon" | "compute" | "command to vehicle")
        });
    }
    if summary.wire.is_none() {
        terms.retain(|(term, _)| *term != "wire, air");
    }
    terms.into_iter().map(|(term, meaning)| (term, meaning.to_owned())).collect()
}

fn counts(config: &Config, summary: &Summary) -> Vec<(&'static str, String)> {
    let mut terms = vec![(
        "Riccati solves",
        "how often the law computed its gain; the first one included".to_owned(),
    )];
    if summary.wakeup_lateness.is_some() {
        let period_ms = 1e3 / config.control.rate_hz;
        terms.push((
            "deadlines missed",
            format!("commands that were published later than a period, {period_ms:.1} ms, after their pose"),
        ));
    }
    let coast_ms = config.safety.coast_ms;
    terms.extend([
        ("poses lost", "camera frames without a pose".to_owned()),
        ("refused", "poses that were late, repeated, not tracked, or not reachable with the commands sent".to_owned()),
        ("commands lost", "commands that never reached simulator or bridge".to_owned()),
        ("states", format!("safety states from arming on. Nominal: no fault. Degraded: a warning. Coast: no pose for three periods, flown on the predicted motion; after {coast_ms} ms the motors stop. Hold, Land, Stop: responses to limits, docs/faults.md")),
    ]);
    terms
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
