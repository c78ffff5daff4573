//! The report of a flight: one self-contained HTML page.

mod events;
mod latency;
mod motion;
pub(crate) mod path;
mod replay;
mod settings;
pub(crate) mod timeline;

use crate::latency::WHOLE;
use maud::{Markup, html};

use crate::explain::terms;
use crate::flight::{Flight, Outcome};
use crate::page::{page, section};
use crate::plot::unit::{self, MISSING, significant, span};
use crate::summary::Summary;
use crate::wire::place_of_losses;

use replay::{ArrivalIntervals, milliseconds};
use timeline::Timeline;

/// Report of `flight` with the figures `summary`: a complete HTML document.
pub fn html(flight: &Flight, summary: &Summary) -> String {
    let timeline = Timeline::new(flight);
    let body = if flight.is_observation() {
        of_observation(&timeline, summary)
    } else {
        of_flight(&timeline, summary)
    };
    let title =
        format!("{} · {} · {}", summary.controller, subject(flight, summary), summary.outcome);
    let main = html! { (body) (settings::settings(flight, summary)) };
    page(&title, "", &html! { (heading(flight, summary)) main { (main) } })
}

fn of_flight(timeline: &Timeline<'_>, summary: &Summary) -> Markup {
    html! {
        (cards(&flight_figures(summary)))
        (path::flown(timeline))
        (motion::position(timeline))
        (motion::attitude(timeline))
        (motion::velocity(timeline))
        (motion::command(timeline))
        (motion::terms(timeline))
        (latency::latency(timeline.flight, summary))
        (events::events(timeline, summary))
        (words(timeline.flight, summary))
    }
}

/// Meaning of the terms of the page.
fn words(flight: &Flight, summary: &Summary) -> Markup {
    section(
        "Words",
        html! {
            table.wide.words {
                @for (term, meaning) in terms(flight, summary) {
                    tr { th scope="row" { (term) } td { (meaning) } }
                }
            }
        },
    )
}

fn of_observation(timeline: &Timeline<'_>, summary: &Summary) -> Markup {
    let arrivals = ArrivalIntervals::of(timeline.flight);
    html! {
        (cards(&replay_figures(&arrivals, summary)))
        (path::recorded(timeline))
        (replay::replay(timeline, &arrivals))
        (motion::estimate(timeline))
        (motion::command(timeline))
        (latency::latency(timeline.flight, summary))
        (events::events(timeline, summary))
        (words(timeline.flight, summary))
    }
}

/// Name of the trajectory, or `replay` or `observation`.
fn subject<'a>(flight: &Flight, summary: &'a Summary) -> &'a str {
    match (flight.is_replay(), flight.is_observation()) {
        (true, _) => "replay",
        (_, true) => "observation",
        _ => &summary.trajectory,
    }
}

/// Description of vehicle, clock, seed and duration.
fn circumstances(flight: &Flight, summary: &Summary) -> String {
    let Summary { clock, seed, duration_s, scored_s, .. } = summary;
    if flight.is_replay() {
        return format!("{} · {clock} clock · {duration_s:.1} s", flight.config.mocap.replay);
    } else if flight.is_observation() {
        return format!("commands not sent · {clock} clock · {duration_s:.1} s observed");
    }
    let source = if summary.error_source == "truth" { " by the true motion" } else { "" };
    let held = summary.held().map_or(String::new(), |held| format!(" · {held}"));
    format!(
        "{} · {clock} clock · seed {seed} · {duration_s:.1} s in flight, \
         {scored_s:.1} s of it (shaded) scored{source}{held}",
        summary.vehicle
    )
}

fn heading(flight: &Flight, summary: &Summary) -> Markup {
    let mood = match summary.outcome {
        Outcome::Landed | Outcome::Replayed | Outcome::Observed if summary.shortfall.is_none() => {
            "good"
        }
        Outcome::Landed
        | Outcome::Replayed
        | Outcome::Observed
        | Outcome::Stopped
        | Outcome::Timeout
        | Outcome::Unfinished => "warning",
        Outcome::Crashed => "bad",
    };
    html! {
        header {
            p.eyebrow { "oqtal flight report" }
            h1 {
                (summary.controller) span.dot { "·" } (subject(flight, summary))
                span.badge.(mood) { (summary.outcome) }
            }
            @if let Some(shortfall) = &summary.shortfall { p.note { (shortfall) } }
            @if let Some(requests) = summary.requests() { p.note { (requests) } }
            p.note { (circumstances(flight, summary)) }
            @for note in summary.notes() { p.note { (note) } }
        }
    }
}

/// A key figure: name, value and detail.
type KeyFigure = (&'static str, String, String);

fn cards(figures: &[KeyFigure]) -> Markup {
    html! {
        div.cards {
            @for (name, value, detail) in figures {
                div.card { p.name { (name) } p.value { (value) } p.detail { (detail) } }
            }
        }
    }
}

fn flight_figures(summary: &Summary) -> Vec<KeyFigure> {
    let mut figures = Vec::new();
    let missing = || (MISSING.to_owned(), "nothing was scored".to_owned());
    let (position, detail) = summary.position_error_m.as_ref().map_or_else(missing, |error| {
        let [rms, max] = [error.rms, error.max].map(unit::length);
        (unit::length(error.mean), format!("rms {rms}, max {max}"))
    });
    figures.push(("Mean position error", position, detail));
    let (attitude, detail) = summary.attitude_error_deg.as_ref().map_or_else(missing, |error| {
        let [mean, rms, max] = [error.mean, error.rms, error.max].map(significant);
        (format!("{mean}°"), format!("rms {rms}°, max {max}°"))
    });
    figures.extend(summary.corners.as_ref().map(|corners| {
        let settled = if corners.settling.count > 0 { "settled " } else { "" };
        let detail = format!(
            "{settled}{}; {:.0} % of the position error is the way there",
            corners.settling_text(),
            1e2 * corners.approach_share
        );
        let overshoot = match corners.overshoot_m {
            none if none.is_nan() => MISSING.to_owned(),
            overshoot_m => unit::length(overshoot_m),
        };
        ("Overshoot at corners", overshoot, detail)
    }));
    figures.push(("Mean attitude error", attitude, detail));
    let whole = summary.hops.get(WHOLE).copied().unwrap_or_default();
    let tail = format!("p99 {}, max {}", span(whole.p99_ns), span(whole.max_ns));
    figures.push(("Sensor to actuator, p50", span(whole.p50_ns), tail));
    figures.extend(loop_figures(summary));
    figures
}

fn replay_figures(arrivals: &ArrivalIntervals, summary: &Summary) -> Vec<KeyFigure> {
    let (median, longest) = (arrivals.median_ms(), arrivals.longest_ms());
    let mut figures = vec![
        ("Poses", arrivals.poses.to_string(), format!("{} frames lost", arrivals.frames_lost())),
        ("Median interval", milliseconds(median), format!("{} Hz", significant(1e3 / median))),
        (
            "Jitter, rms",
            milliseconds(arrivals.jitter_ms()),
            format!("longest gap {}", milliseconds(longest)),
        ),
    ];
    figures.extend(loop_figures(summary));
    figures
}

/// The key figures of every flight.
fn loop_figures(summary: &Summary) -> [KeyFigure; 3] {
    let ticks = format!("in {} ticks", summary.ticks);
    let (lost, place) = (&summary.lost, place_of_losses(summary.wire.as_ref()));
    let lost = format!("{} poses, {} commands lost{place}", lost.pose, lost.command);
    let speed = format!("{} ×", significant(summary.speed_factor));
    [
        ("Riccati solves", summary.riccati_solves.to_string(), ticks),
        ("Deadline misses", summary.deadline_misses.to_string(), lost),
        ("Speed", speed, "of real time".to_owned()),
    ]
}

#[cfg(test)]
pub mod tests;
