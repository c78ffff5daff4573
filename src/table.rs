//! What a person reads in the terminal after a flight.

use comfy_table::{CellAlignment, Table, presets};
use oqtal_bus::latency::{DistributionSummary, HOPS, WHOLE};

use crate::report::unit::{outcome, significant, unit_of_length, words};
use crate::summary::{ErrorFigures, Summary};

/// The closing table of a flight: plain text of at most 100 columns, ending in a line feed.
#[must_use]
pub fn closing(summary: &Summary) -> String {
    let mut text = format!("{}\n", headline(summary));
    if let Some(errors) = errors(summary) {
        text += &format!("{errors}\n");
    }
    text += &format!("{}\n{}\n", latencies(summary), counts(summary));
    text
}

fn headline(summary: &Summary) -> String {
    let Summary { controller, trajectory, vehicle, clock, seed, .. } = summary;
    let mut line = format!("{}: {controller}, {trajectory}, {vehicle}", outcome(summary.outcome));
    line += &format!(
        "\n{clock} clock, seed {seed}, {:.1} s armed, {} x real time",
        summary.duration_s,
        significant(summary.speed_factor)
    );
    line
}

/// The errors, if anything was judged.
fn errors(summary: &Summary) -> Option<Table> {
    let position = summary.position_error_m.as_ref();
    let (unit, per_metre) = unit_of_length(position.map_or(0.0, |error| error.max));
    let rows = [
        (format!("position [{unit}]"), position, per_metre),
        ("velocity [m/s]".to_owned(), summary.velocity_error_m_s.as_ref(), 1.0),
        ("attitude [deg]".to_owned(), summary.attitude_error_deg.as_ref(), 1.0),
    ];
    let judged = format!("error over {:.1} s", summary.scored_s);
    let mut table = table(&[&judged, "mean", "rms", "max", "rms x, roll", "y, pitch", "z, yaw"]);
    for (name, figures, factor) in rows {
        table.add_row(error_row(name, figures?, factor));
    }
    align(&mut table);
    Some(table)
}

fn error_row(name: String, figures: &ErrorFigures, factor: f64) -> Vec<String> {
    let ErrorFigures { mean, rms, max, rms_by_axis } = figures;
    let numbers = [*mean, *rms, *max].into_iter().chain(*rms_by_axis);
    std::iter::once(name).chain(numbers.map(|number| significant(number * factor))).collect()
}

fn latencies(summary: &Summary) -> Table {
    let mut table = table(&["latency [us]", "p50", "p99", "p99.9", "max"]);
    for name in HOPS.into_iter().chain([WHOLE]) {
        if let Some(hop) = summary.hops.get(name).filter(|hop| hop.count > 0) {
            table.add_row(latency_row(&words(name), hop));
        }
    }
    table.add_row(latency_row("wake-up lateness", &summary.wakeup_lateness));
    align(&mut table);
    table
}

fn latency_row(name: &str, hop: &DistributionSummary) -> Vec<String> {
    let spans = [hop.p50_ns, hop.p99_ns, hop.p999_ns, hop.max_ns];
    let micros = spans.map(|nanos| significant(nanos as f64 * 1e-3));
    std::iter::once(name.to_owned()).chain(micros).collect()
}

fn counts(summary: &Summary) -> String {
    format!(
        "Riccati solves {}, deadline misses {}, lost {} poses and {} commands, {}",
        summary.riccati_solves,
        summary.deadline_misses,
        summary.lost.pose,
        summary.lost.command,
        summary.state_sequence.join(" > ")
    )
}

fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header(header.iter().copied());
    table
}

/// Numbers to the right, below their headings.
fn align(table: &mut Table) {
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fixture;

    fn closing_of(flight: &crate::flight::Flight) -> String {
        closing(&Summary::of(flight))
    }

    #[test]
    fn it_fits_a_terminal_and_says_the_figures() {
        let text = closing_of(&fixture::square());
        assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
        assert!(!text.contains('\u{1b}'));
        for word in [
            "landed",
            "position [m",
            "attitude [deg]",
            "sensor to actuator",
            "Nominal > Coast > Nominal",
        ] {
            assert!(text.contains(word), "{word} in\n{text}");
        }
    }

    #[test]
    fn a_replay_has_no_errors_and_an_empty_flight_no_figures() {
        assert!(!closing_of(&fixture::replay()).contains("error"));
        assert!(closing_of(&fixture::empty()).starts_with("timeout"));
    }
}
