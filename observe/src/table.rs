//! The closing table of a flight in the terminal.

use crate::explain::wrapped;
use crate::latency::{DistributionSummary, NAMES};
use comfy_table::{CellAlignment, Table, presets};

use crate::attitude_steps::settling_text;
use crate::corners::CornerFigures;
use crate::kernel::ProcessUsage;
use crate::plot::unit::{significant, span, unit_of_length, words};
use crate::summary::{ErrorFigures, Summary};
use crate::wire::{CommandAge, WireFigures, place_of_losses};

/// Text shown instead of errors for a flight without a scored window.
const UNSCORED: &str = "no errors: nothing of this flight is scored\n";

/// The same for a hover.
const SHORT_HOVER: &str = "no errors: nothing of this flight is scored; a hover is from 10 s after it is\n\
                           reached, see --duration\n";

/// Note on a flight whose course an operator changed before anything was scored.
const REDIRECTED: &str = "no errors: what follows `ctl goto`, `fly` or `hover` is not scored\n";

/// Note on several flights without a scored window, of which an operator changed some.
const SOME_REDIRECTED: &str = "no errors: a flight changed by `ctl goto`, `fly` or `hover` is not scored after\n\
                               it, and nothing of the others is; a hover is from 10 s after it is reached\n";

/// The closing table of a flight: plain text of at most 80 columns.
pub fn closing(summary: &Summary) -> String {
    let mut text = format!("{}\n", headline(summary));
    let redirected = summary.changes.iter().find(|change| change.changes_course);
    match (errors(summary), redirected) {
        (Some(errors), _) => text += &format!("{errors}\n"),
        // The shortfall says why nothing of another flight is.
        (None, _) if summary.ticks == 0 => {}
        (None, Some(change)) if change.leaves_a_flight => text += SOME_REDIRECTED,
        (None, Some(_)) => text += REDIRECTED,
        (None, None) if summary.outcome.is_of_flight() => {
            text += if summary.trajectory == "hover" { SHORT_HOVER } else { UNSCORED };
        }
        (None, None) => {}
    }
    text.extend(summary.notes().map(|note| wrapped(note, 0) + "\n"));
    text += &summary.held().map_or_else(String::new, |held| format!("{held}\n"));
    text += &summary.corners.as_ref().map_or_else(String::new, corners);
    text += &summary.attitude_steps.map_or_else(String::new, |steps| {
        let count = if steps.count > 0 { format!("{}, ", steps.count) } else { String::new() };
        format!("steps of the attitude: {count}{}\n", settling_text(&steps))
    });
    if let Some(latencies) = latencies(summary) {
        text += &format!("{latencies}\n");
    }
    text += &summary.wire.as_ref().map_or_else(String::new, wire);
    text += &counts(summary);
    text += &summary.daemon.as_ref().map_or_else(String::new, process);
    let changed =
        summary.settings.changed().map(|it| format!("settings changed before the take-off: {it}"));
    let requests = changed.into_iter().chain(summary.requests());
    text + &requests.map(|line| format!("\n{}", wrapped(&line, 4))).collect::<String>()
}

fn headline(summary: &Summary) -> String {
    let Summary { controller, trajectory, clock, seed, outcome, .. } = summary;
    let is_flight = outcome.is_of_flight();
    let (course, flown) = match is_flight {
        true => (format!("{trajectory}, {}", summary.vehicle), "armed"),
        false => ("commands computed, not sent".to_owned(), "observed"),
    };
    format!(
        "{outcome}: {controller}, {course}\n\
         {clock} clock, seed {seed}, {:.1} s {flown}, {} x real time",
        summary.duration_s,
        significant(summary.speed_factor)
    )
}

/// The table of errors; `None` if the scored window is empty.
fn errors(summary: &Summary) -> Option<Table> {
    // A single tick has no duration.
    let position = summary.position_error_m.as_ref().filter(|_| summary.scored_s > 0.0);
    let (unit, per_metre) = unit_of_length(position.map_or(0.0, |error| error.max));
    let decimals = if unit == "mm" { 1 } else { 3 };
    let rows = [
        (format!("position [{unit}]"), position, per_metre, decimals),
        ("velocity [m/s]".to_owned(), summary.velocity_error_m_s.as_ref(), 1.0, 3),
        ("attitude [deg]".to_owned(), summary.attitude_error_deg.as_ref(), 1.0, 2),
    ];
    let scored = format!("error over {:.1} s", summary.scored_s);
    let mut table = table(&[&scored, "mean", "rms", "max", "rms x, roll", "y, pitch", "z, yaw"]);
    for (name, figures, factor, decimals) in rows {
        let ErrorFigures { mean, rms, max, rms_by_axis } = figures?;
        let numbers = [*mean, *rms, *max].into_iter().chain(*rms_by_axis);
        let cells = numbers.map(|number| format!("{:.decimals$}", number * factor));
        table.add_row(std::iter::once(name).chain(cells));
    }
    align(&mut table);
    Some(table)
}

/// The figures at the corners in two lines: the share of the position error that is due to the step of the reference, not to the law.
fn corners(corners: &CornerFigures) -> String {
    let CornerFigures { settling, step_m, overshoot_m, .. } = corners;
    let (count, settled) = (settling.count, corners.settling_text());
    if count == 0 {
        return wrapped(&format!("corners: {settled}"), 0) + "\n";
    }
    let overshoot_mm = 1e3 * overshoot_m;
    let evaluated =
        format!("corners: {count} of {step_m:.2} m, {settled}, overshoot {overshoot_mm:.0} mm;");
    let rest = match corners.settled_error_m {
        error if error.is_nan() => "never settled".to_owned(),
        error => format!("{:.1} mm once settled", 1e3 * error),
    };
    let share = 1e2 * corners.approach_share;
    let evaluated = wrapped(&evaluated, 0);
    format!("{evaluated}\nposition error: {share:.0} % is the way to the corner, {rest}\n")
}

/// Table of latencies; `None` if none were measured, as in a replay in virtual time.
fn latencies(summary: &Summary) -> Option<Table> {
    let mut table = table(&["latency [us]", "p50", "p99", "p99.9", "max"]);
    for name in NAMES {
        // In virtual time, computation and bus have no latency.
        if let Some(hop) = summary.hops.get(name).filter(|hop| hop.count > 0 && hop.max_ns > 0) {
            table.add_row(latency_row(&words(name), hop));
        }
    }
    for (name, spans) in
        [("wake-up lateness", &summary.wakeup_lateness), ("period jitter", &summary.period_jitter)]
    {
        let spans = spans.iter().filter(|spans| spans.count > 0);
        table.add_rows(spans.map(|spans| latency_row(name, spans)));
    }
    align(&mut table);
    (!table.is_empty()).then_some(table)
}

/// Row of a latency table: name, then median, 99th and 99.9th percentile and maximum \[us\].
pub fn latency_row(name: &str, hop: &DistributionSummary) -> Vec<String> {
    let spans = [hop.p50_ns, hop.p99_ns, hop.p999_ns, hop.max_ns];
    let micros = spans.map(|nanos| significant(nanos as f64 * 1e-3));
    std::iter::once(name.to_owned()).chain(micros).collect()
}

/// The figures of the wire in two or three lines.
fn wire(wire: &WireFigures) -> String {
    let age =
        |age: &DistributionSummary| format!("{} (p99 {})", span(age.p50_ns), span(age.p99_ns));
    let CommandAge { from_capture, from_publication } = &wire.command_age;
    format!(
        "age at the last byte on the wire: {} since capture,\n    {} since publication\n{}",
        age(from_capture),
        age(from_publication),
        wire.usage().map_or_else(String::new, |text| format!("wire: {text}\n"))
    )
}

fn counts(summary: &Summary) -> String {
    let Summary { riccati_solves, deadline_misses, lost, .. } = summary;
    let faults: Vec<String> = summary.faults.iter().map(|fault| fault.fault.clone()).collect();
    let loads = summary.disturbances.iter();
    let loads = loads.map(|load| match (load.is_scored, load.is_before_score) {
        (true, _) => load.disturbance.clone(),
        (false, false) => format!("{} (outside the scored time)", load.disturbance),
        (false, true) => {
            format!("{} (ends before scoring; its after-effect is scored)", load.disturbance)
        }
    });
    let loads: Vec<String> = loads.collect();
    let answers = summary.answers.map(|it| format!("\nanswers: {it}"));
    let handovers = summary.handovers.as_ref().map(|it| format!("\nhand-overs: {it}"));
    let faults = answers.unwrap_or_default()
        + &handovers.unwrap_or_default()
        + &listed("faults: ", &faults)
        + &listed("disturbances: ", &loads);
    // Neither is meaningful in virtual time, in which nothing is late.
    let deadlines = match summary.wakeup_lateness {
        Some(_) => format!(", deadlines missed {deadline_misses}"),
        None => String::new(),
    };
    format!(
        "Riccati solves {riccati_solves}{deadlines}\n\
         poses lost {}, superseded {}, refused {}, commands lost{} {}\nstates: {}{faults}",
        lost.pose,
        summary.poses_superseded,
        summary.poses_refused,
        place_of_losses(summary.wire.as_ref()),
        lost.command,
        summary.states()
    )
}

/// One line for each of `names`, below `title`; empty without names.
fn listed(title: &str, names: &[String]) -> String {
    let indent = format!("\n{}", " ".repeat(title.len()));
    if names.is_empty() { String::new() } else { format!("\n{title}{}", names.join(&indent)) }
}

/// Scheduling and resource use of the daemon.
fn process(daemon: &ProcessUsage) -> String {
    format!("\n{}", wrapped(&format!("daemon: {daemon}"), 8))
}

/// An empty table with a header.
pub fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header(header.iter().copied());
    table
}

/// Right-aligns all columns except the first.
pub fn align(table: &mut Table) {
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::fixture;
    use oqtal_bus::code::{Mode, OperatorCommand};
    use oqtal_bus::message::EventV1;
    use oqtal_bus::time::Span;

    fn closing_of(flight: &crate::flight::Flight) -> String {
        closing(&Summary::of(flight))
    }

    #[test]
    fn the_table_fits_a_terminal_and_has_the_figures() {
        let text = closing_of(&fixture::square());
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
        assert!(!text.contains('\u{1b}'));
        for word in [
            "landed",
            "position [m",
            "attitude [deg]",
            "sensor to actuator",
            "Nominal → Coast → Nominal",
        ] {
            assert!(text.contains(word), "{word} in\n{text}");
        }
    }

    #[test]
    fn a_request_of_one_flight_does_not_explain_why_another_has_no_errors() {
        let mut flight = fixture::square();
        flight.samples.iter_mut().for_each(|sample| sample.telemetry.scored = 0);
        flight.samples.last_mut().unwrap().telemetry.mode = Mode::Disarmed.code();
        let length = Span::from_millis(60_000);
        let later = flight.samples.clone().into_iter().map(|mut sample| {
            sample.telemetry.time = sample.telemetry.time + length;
            sample
        });
        let goto = EventV1 { command: OperatorCommand::Goto.code(), ..EventV1::default() };
        let at = flight.origin() + Span::from_millis(10_000);
        flight.changes.push((at, goto));
        assert!(closing_of(&flight).contains(REDIRECTED));
        flight.samples.extend(later.collect::<Vec<_>>());
        assert!(flight.flights().count() == 2 && closing_of(&flight).contains(SOME_REDIRECTED));
        flight.changes.push((at + length, goto));
        assert!(closing_of(&flight).contains(REDIRECTED));
    }

    #[test]
    fn a_replay_has_no_errors_and_an_empty_flight_no_figures() {
        assert!(!closing_of(&fixture::replay()).contains("error"));
        assert!(closing_of(&fixture::empty()).starts_with("timeout"));
    }
}
