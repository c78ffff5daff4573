//! Comparison of several flights: errors, hops, settings that differ, overlaid plots.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use comfy_table::ContentArrangement;
use maud::{Markup, html};
use oqtal_config::Interface;

use crate::event::ChangeInFlight;
use crate::flight::{Flight, FlightSample};
use crate::handovers::HandoverFigures;
use crate::latency::NAMES;
use crate::page::{page, section};
use crate::plot::axis::extent;
use crate::plot::figure::{self, TimeSpan};
use crate::plot::palette::Ink;
use crate::plot::trace::{Trace, is_drawable_point};
use crate::plot::unit::{MISSING, significant, span, words};
use crate::report::path::{VIEWS, View, shown};
use crate::report::timeline::Timeline;
use crate::summary::{ErrorFigures, Summary};
use crate::table::{align, table};
use crate::wire::place_of_losses;

/// Letters and colours of the flights in plots and tables.
const MARKS: [(&str, Ink); 6] = [
    ("A", Ink::Actual),
    ("B", Ink::Second),
    ("C", Ink::Third),
    ("D", Ink::Fourth),
    ("E", Ink::Fifth),
    ("F", Ink::Sixth),
];

/// Width of the tables in a terminal \[columns\]; longer cells are wrapped.
const WIDTH: u16 = 100;
/// Longest text of a cell in a terminal \[characters\]: a request may change dozens of settings.
const LONGEST_CELL: usize = 100;

/// Number of flights that can be compared.
pub const MOST_FLIGHTS: usize = MARKS.len();

/// A table: name, header, rows.
type NamedTable = (&'static str, Vec<String>, Vec<Vec<String>>);

/// Flights to be compared, with their names.
#[derive(Debug)]
pub struct Comparison {
    names: Vec<String>,
    flights: Vec<Flight>,
    summaries: Vec<Summary>,
}

impl Comparison {
    /// A comparison of `flights`, at most [`MOST_FLIGHTS`], with their names.
    pub fn new(flights: Vec<(String, Flight)>) -> Self {
        let (names, flights): (Vec<String>, Vec<Flight>) =
            flights.into_iter().take(MOST_FLIGHTS).unzip();
        let summaries = flights.iter().map(Summary::of).collect();
        Self { names, flights, summaries }
    }

    /// The tables as text for a terminal.
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        for (_, header, rows) in self.tables() {
            let header: Vec<&str> = header.iter().map(String::as_str).collect();
            let mut table = table(&header);
            table.set_content_arrangement(ContentArrangement::Dynamic).set_width(WIDTH);
            table.add_rows(rows.iter().map(|row| row.iter().map(|cell| shortened(cell))));
            align(&mut table);
            text += &format!("{table}\n");
        }
        text.extend(self.notes().into_iter().map(|note| format!("{note}\n")));
        text.trim_end().to_owned()
    }

    /// Notes on the figures, each once.
    fn notes(&self) -> BTreeSet<&'static str> {
        self.summaries.iter().flat_map(Summary::notes).collect()
    }

    /// The page: tables and overlaid plots.
    pub fn to_html(&self) -> String {
        let heading = html! {
            header { p.eyebrow { "oqtal comparison" } h1 { (self.names.len()) " flights" } }
        };
        let body = html! {
            (heading)
            main {
                (self.plots())
                @for (title, header, rows) in self.tables() { (as_html(title, &header, &rows)) }
                @for note in self.notes() { p.note { (note) } }
            }
        };
        page("oqtal comparison", "", &body)
    }

    fn tables(&self) -> [NamedTable; 4] {
        [self.flown(), self.errors(), self.latencies(), self.settings()]
    }

    /// Header of a table: the name of its rows, then the letters of the flights.
    fn header(&self, first: &str) -> Vec<String> {
        let letters = MARKS.iter().take(self.names.len());
        named(first, letters.map(|(letter, _)| (*letter).to_owned()))
    }

    /// Row of a table: its name, then one cell per flight.
    fn row(&self, name: &str, cell: impl Fn(&Summary) -> String) -> Vec<String> {
        named(name, self.summaries.iter().map(cell))
    }

    fn flown(&self) -> NamedTable {
        let outcome = |flight: &Flight| match (flight.outcome, flight.shortfall()) {
            (outcome, Some(cause)) if cause != outcome.to_string() => format!("{outcome}: {cause}"),
            (outcome, _) => outcome.to_string(),
        };
        let mut rows = vec![
            named("file", self.names.iter().cloned()),
            self.row("controller", |s| s.controller.clone()),
            self.row("trajectory", |s| s.trajectory.clone()),
            self.row("vehicle", |s| s.vehicle.to_string()),
            self.row("clock, seed", |s| format!("{}, {}", s.clock, s.seed)),
            named("outcome", self.flights.iter().map(outcome)),
            self.row("scored [s]", |s| significant(s.scored_s)),
        ];
        if self.summaries.windows(2).any(|pair| pair[0].error_source != pair[1].error_source) {
            rows.push(self.row("errors by", |s| s.error_source.to_owned()));
        }
        rows.extend(self.fallbacks());
        let changes = self.summaries.iter().map(|summary| summary.changes.len()).max();
        for number in 0..changes.unwrap_or(0) {
            rows.push(self.row("requests in flight", |s| {
                s.changes.get(number).map_or_else(String::new, ChangeInFlight::to_string)
            }));
        }
        ("Flights", self.header("flight"), rows)
    }

    /// Rows about the law that flew, those that a flight has.
    fn fallbacks(&self) -> impl Iterator<Item = Vec<String>> {
        type Cell = fn(&Summary) -> Option<String>;
        let rows: [(&str, Cell); 3] = [
            ("hand-overs", |s| s.handovers.as_ref().map(HandoverFigures::counts)),
            ("by the fallback law", |s| s.handovers.as_ref().map(HandoverFigures::share)),
            ("without an answer", |s| s.answers.map(|it| it.share())),
        ];
        let told =
            rows.into_iter().filter(|(_, cell)| self.summaries.iter().any(|s| cell(s).is_some()));
        told.map(|(name, cell)| self.row(name, |s| cell(s).unwrap_or_else(|| MISSING.to_owned())))
    }

    fn errors(&self) -> NamedTable {
        type Figures = fn(&Summary) -> Option<&ErrorFigures>;
        let kinds: [(&str, Figures); 3] = [
            ("position [m]", |s| s.position_error_m.as_ref()),
            ("velocity [m/s]", |s| s.velocity_error_m_s.as_ref()),
            ("attitude [deg]", |s| s.attitude_error_deg.as_ref()),
        ];
        let number = |value: Option<f64>| value.map_or_else(|| MISSING.to_owned(), significant);
        let mut rows = Vec::new();
        for (name, figures) in kinds {
            rows.push(self.row(&format!("{name}, mean"), |s| number(figures(s).map(|e| e.mean))));
            rows.push(self.row(&format!("{name}, rms"), |s| number(figures(s).map(|e| e.rms))));
            rows.push(self.row(&format!("{name}, max"), |s| number(figures(s).map(|e| e.max))));
        }
        let is_torque = |flight: &&Flight| flight.config.vehicle.interface == Interface::Torque;
        let unit = match self.flights.iter().filter(is_torque).count() {
            0 => "s",
            all if all == self.flights.len() => "N m s",
            _ => "s, of torque N m s",
        };
        rows.push(self.row(&format!("effort [{unit}]"), |s| number(s.effort)));
        ("Errors", self.header("error"), rows)
    }

    fn latencies(&self) -> NamedTable {
        let mut rows = Vec::new();
        for name in NAMES {
            let hop = |s: &Summary| s.hops.get(name).copied().filter(|hop| hop.count > 0);
            if self.summaries.iter().any(|summary| hop(summary).is_some()) {
                rows.push(self.row(&words(name), |s| {
                    let text =
                        hop(s).map(|hop| format!("{}, p99 {}", span(hop.p50_ns), span(hop.p99_ns)));
                    text.unwrap_or_else(|| MISSING.to_owned())
                }));
            }
        }
        rows.push(self.row("deadlines missed", |s| s.deadline_misses.to_string()));
        rows.push(self.row("poses lost", |s| s.lost.pose.to_string()));
        rows.push(self.row("commands lost", |s| {
            format!("{}{}", s.lost.command, place_of_losses(s.wire.as_ref()))
        }));
        ("Latency", self.header("hop, p50"), rows)
    }

    /// Settings that differ between the flights.
    fn settings(&self) -> NamedTable {
        let values = |flight: &Flight| flight.config_at_arming().comparable_values();
        let all: Vec<BTreeMap<String, String>> = self.flights.iter().map(values).collect();
        let keys: BTreeSet<&String> = all.iter().flat_map(BTreeMap::keys).collect();
        let mut rows = Vec::new();
        for key in keys {
            let values: Vec<Option<&String>> = all.iter().map(|one| one.get(key)).collect();
            if values.windows(2).any(|pair| pair[0] != pair[1]) {
                let cell = |value: &Option<&String>| {
                    value.map_or_else(|| MISSING.to_owned(), Clone::clone)
                };
                rows.push(named(key, values.iter().map(cell)));
            }
        }
        ("Settings that differ", self.header("setting"), rows)
    }

    fn plots(&self) -> Markup {
        section(
            "Flights, overlaid",
            html! {
                @for (title, view) in VIEWS { (figure::in_plane(title, self.paths(view), Vec::new())) }
                (over_time("Position error, magnitude [m]", self.error_traces(|s| s.position_error().norm())))
                (over_time("Attitude error, angle [deg]", self.error_traces(|s| s.attitude_error().norm().to_degrees())))
                (over_time("Velocity error, magnitude [m/s]", self.error_traces(|s| s.velocity_error().norm())))
                (over_time("Collective thrust [0..1]", self.traces(|s| s.telemetry.thrust)))
            },
        )
    }

    /// Flown paths, one per flight, with a gap where the position is not known.
    fn paths(&self, view: View) -> Vec<Trace> {
        let point = |sample: &FlightSample| {
            shown(sample.is_armed() && sample.is_located(), view(sample.position().into()))
        };
        let marked = self.flights.iter().zip(MARKS);
        marked.map(|(flight, (name, ink))| Timeline::new(flight).path(name, ink, point)).collect()
    }

    /// Traces of an error over time, with a gap where the motion is not known.
    fn error_traces(&self, error: fn(&FlightSample) -> f64) -> Vec<Trace> {
        self.traces(|sample| if sample.is_located() { error(sample) } else { f64::NAN })
    }

    /// Traces of a value over the time since arming, for the armed ticks, one per flight.
    fn traces(&self, value: impl Fn(&FlightSample) -> f64) -> Vec<Trace> {
        let armed =
            |sample: &FlightSample| if sample.is_armed() { value(sample) } else { f64::NAN };
        let marked = self.flights.iter().zip(MARKS);
        marked.map(|(flight, (name, ink))| Timeline::new(flight).trace(name, ink, armed)).collect()
    }
}

/// A row of a table: its name, then its cells.
fn named(name: &str, cells: impl Iterator<Item = String>) -> Vec<String> {
    std::iter::once(name.to_owned()).chain(cells).collect()
}

/// Plot of traces over time; the axis spans the points that are drawn.
fn over_time(title: &str, traces: Vec<Trace>) -> Markup {
    let points = traces.iter().flat_map(|trace| &trace.points);
    let drawn = points.filter(|point| is_drawable_point(point));
    let range: Range<f64> = extent(drawn.map(|point| point.0));
    figure::over_time(title, traces, &TimeSpan { range, ..TimeSpan::default() })
}

/// `text`, cut to [`LONGEST_CELL`]; the page has it in full.
fn shortened(text: &str) -> String {
    match text.char_indices().nth(LONGEST_CELL) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

fn as_html(title: &str, header: &[String], rows: &[Vec<String>]) -> Markup {
    let content = html! {
        div.wide.scroll {
            table {
                thead { tr { @for cell in header { th { (cell) } } } }
                tbody {
                    @for row in rows {
                        tr {
                            @for (number, cell) in row.iter().enumerate() {
                                @if number == 0 { th { (cell) } } @else { td { (cell) } }
                            }
                        }
                    }
                }
            }
        }
    };
    section(title, content)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::fixture;
    use oqtal_bus::message::EventV1;
    use oqtal_bus::text::LongText;
    use oqtal_bus::time::Span;
    use oqtal_config::{Config, Setting};

    #[test]
    fn settings_that_differ_are_listed_and_others_are_not() {
        let mut other = fixture::square();
        other.config.clock.seed += 1;
        let settings = LongText::new(&"position.tilt-limit-deg=15\n".repeat(30));
        let request = EventV1 { text: settings, ..EventV1::default() };
        other.changes.push((other.origin() + Span::from_millis(9000), request));
        let comparison = Comparison::new(vec![
            ("a.mcap".to_owned(), fixture::square()),
            ("b.mcap".to_owned(), other),
        ]);
        let (_, _, rows) = comparison.settings();
        assert_eq!(rows.len(), 1, "{rows:?}");
        assert_eq!(rows[0][0], "clock.seed");
        let text = comparison.to_text();
        for word in ["a.mcap", "b.mcap", "position [m], mean", "sensor to actuator, p50"] {
            assert!(text.contains(word) || word.starts_with("sensor"), "{word} in\n{text}");
        }
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH.into()), "{text}");
        let html = comparison.to_html();
        assert!(html.contains("Settings that differ") && html.contains("Position error"));
    }

    #[test]
    fn a_time_without_poses_is_a_gap_and_has_no_error() {
        let mut flight = fixture::square();
        flight.samples.iter_mut().for_each(|sample| sample.truth = None);
        let lost = &mut flight.samples[1000..1100];
        lost.iter_mut().for_each(|sample| sample.telemetry.pose_age_s = 0.8);
        let comparison = Comparison::new(vec![("a".to_owned(), flight)]);
        let gaps = |traces: Vec<Trace>| {
            traces[0].points.iter().filter(|point| !is_drawable_point(point)).count()
        };
        assert_eq!(gaps(comparison.paths(VIEWS[0].1)), 1);
        assert!(gaps(comparison.error_traces(|s| s.position_error().norm())) > 0);
        assert_eq!(gaps(comparison.traces(|s| s.telemetry.thrust)), 0);
    }

    #[test]
    fn a_fallback_that_flew_most_of_a_flight_is_told_wherever_its_figures_are() {
        let external = Setting::parse("test", "control.controller=external").unwrap();
        let mut flight = fixture::square();
        flight.config = Config::from_settings(&[external]).unwrap();
        flight.samples.iter_mut().for_each(|sample| sample.telemetry.fallback = 1);
        let summary = Summary::of(&flight);
        let note = summary.notes().next().unwrap();
        assert!(note.contains("flew most of the trajectory"), "{note}");
        assert!(crate::report::html(&flight, &summary).contains(note));
        assert!(crate::table::closing(&summary).replace('\n', " ").contains(note));
        let flights = [("external", flight), ("built-in", fixture::square())];
        let flights = flights.map(|(name, flight)| (name.to_owned(), flight)).into();
        let compared = Comparison::new(flights).to_text();
        for told in ["hand-overs", "by the fallback law", "without an answer", note] {
            assert!(compared.contains(told), "{told}: {compared}");
        }
    }
}
