//! The section of events: phases, safety states, losses.

use maud::{Markup, html};
use oqtal_bus::code::SafetyState;
use oqtal_control::trajectory::Phase;

use crate::event::{changes, of_period};
use crate::flight::FlightSample;
use crate::summary::Summary;

use super::timeline::Timeline;
use crate::page::section;
use crate::plot::axis::Axis;
use crate::plot::chart::{Mark, Plot};
use crate::plot::figure::{FULL, figure};
use crate::plot::palette::Ink;

/// Maximum number of listed events; the others are counted.
const MOST_LISTED: usize = 100;

const STATES: [(SafetyState, &str, Ink); 7] = [
    (SafetyState::Nominal, "nominal", Ink::Good),
    (SafetyState::Degraded, "degraded", Ink::Warning),
    (SafetyState::Coast, "coast", Ink::Warning),
    (SafetyState::Hold, "hold", Ink::Warning),
    (SafetyState::Land, "land", Ink::Bad),
    (SafetyState::Descend, "descend", Ink::Bad),
    (SafetyState::Stop, "stop", Ink::Bad),
];

const PHASES: [(Phase, &str, Ink); 4] = [
    (Phase::TakeOff, "take-off", Ink::Fourth),
    (Phase::Settle, "settle", Ink::Reference),
    (Phase::Trajectory, "trajectory", Ink::Actual),
    (Phase::Landing, "landing", Ink::Second),
];

/// Section of the events.
pub fn events(timeline: &Timeline<'_>, summary: &Summary) -> Markup {
    // The wait on the ground before take-off is not part of the flight.
    let from = timeline.samples.iter().position(FlightSample::is_armed).unwrap_or(0);
    let pairs = timeline.samples[from..].windows(2);
    let events = pairs.flat_map(|pair| {
        let at = timeline.at(&pair[1]);
        changes(&pair[0].telemetry, &pair[1].telemetry).into_iter().map(move |what| (at, what))
    });
    let requests = summary.changes.iter().map(|change| (change.time_s, change.text.clone()));
    let mut events: Vec<(f64, String)> = events.chain(faults(summary)).chain(requests).collect();
    events.sort_by(|a, b| a.0.total_cmp(&b.0));
    section(
        "Events",
        html! {
            (strip(timeline))
            p.note.wide {
                "Poses lost in flight: " (summary.lost.pose) ", refused: " (summary.poses_refused)
                ". Commands lost: " (summary.lost.command)
                ". Deadlines missed: " (summary.deadline_misses)
                ". Times are in seconds after " (time_origin(timeline)) "."
                @if timeline.unmarked > 0 {
                    " The plots mark the first " (timeline.instants.len()) " changes of state, faults and disturbances; "
                    (timeline.unmarked) " later ones are not marked."
                }
            }
            (list(events.into_iter()))
        },
    )
}

/// The instant from which times are counted, as text.
fn time_origin(timeline: &Timeline<'_>) -> &'static str {
    let is_flown = timeline.flight.flights().next().is_some() && !timeline.flight.is_observation();
    if is_flown && !timeline.flight.begins_in_flight() { "arming" } else { "the first tick" }
}

/// Beginnings and ends of injected faults and of disturbances.
fn faults(summary: &Summary) -> impl Iterator<Item = (f64, String)> {
    let faults = summary.faults.iter().map(|it| ("fault", &it.fault, it.from_s, it.until_s));
    let loads = summary.disturbances.iter();
    let loads = loads.map(|it| ("disturbance", &it.disturbance, it.from_s, it.until_s));
    faults.chain(loads).flat_map(|(kind, name, from_s, until_s)| {
        of_period(&format!("{kind} {name}"), (from_s, until_s.unwrap_or(f64::INFINITY)))
    })
}

/// The list of events with their instants \[s\]; empty markup without events.
pub fn list(events: impl Iterator<Item = (f64, String)>) -> Markup {
    let events: Vec<_> = events.collect();
    html! {
        @if !events.is_empty() {
            ol.events.wide {
                @for (at, what) in events.iter().take(MOST_LISTED) {
                    li data-t=(at) { span.time { (format!("{at:.2} s")) } (what) }
                }
                @if events.len() > MOST_LISTED { li { "… and " (events.len() - MOST_LISTED) " more" } }
            }
        }
    }
}

/// Phases and safety states as bands over time.
fn strip(timeline: &Timeline<'_>) -> Markup {
    let phase = |sample: &FlightSample| {
        PHASES.iter().find(|p| p.0 as u8 == sample.telemetry.phase).map(|p| p.2)
    };
    let state = |sample: &FlightSample| {
        STATES.iter().find(|s| s.0.code() == sample.telemetry.state).map(|s| s.2)
    };
    let legend: Vec<_> =
        PHASES.map(|p| (p.1, p.2)).into_iter().chain(STATES.map(|s| (s.1, s.2))).collect();
    let phases = bands(timeline, |sample| phase(sample).filter(|_| sample.is_armed()), 1.0);
    let instants = timeline.instants.iter().copied().map(Mark::Instant);
    let plot = Plot {
        size: (FULL, 250),
        label_width: 120,
        x: Axis::linear(timeline.range(), 16.0, " s"),
        y: Axis::rows(["phase", "state"].into_iter()),
        shapes: phases.into_iter().chain(bands(timeline, state, 0.0)).chain(instants).collect(),
    };
    html! { div.wide { (figure("Phases and safety states", &legend, &plot)) } }
}

/// A block for every run of ticks of one colour, in the row above `floor`.
fn bands(
    timeline: &Timeline<'_>,
    ink: impl Fn(&FlightSample) -> Option<Ink>,
    floor: f64,
) -> Vec<Mark> {
    let mut bands = Vec::new();
    let stretches = timeline.samples.chunk_by(|a, b| ink(a) == ink(b));
    let ends = stretches.clone().skip(1).map(|next| &next[0]).chain(timeline.samples.last());
    for (stretch, end) in stretches.zip(ends) {
        if let Some(ink) = ink(&stretch[0]) {
            let from = (timeline.at(&stretch[0]), floor + 0.15);
            bands.push(Mark::Block(ink, from, (timeline.at(end), floor + 0.85)));
        }
    }
    bands
}
