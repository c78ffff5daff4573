//! The section of the path of the vehicle.

use maud::{Markup, html};

use crate::flight::FlightSample;

use super::timeline::Timeline;
use crate::page::section;
use crate::plot::figure::in_plane;
use crate::plot::palette::Ink;
use crate::plot::trace::{Point, Trace, thin_path};

/// Distance between two ticks above which the reference counts as stepped \[m\].
const STEP_M: f64 = 0.1;

/// A projection: horizontal and vertical component of a position.
type View = fn([f64; 3]) -> Point;

const VIEWS: [(&str, View); 2] = [
    ("Top view: y over x [m]", |[x, y, _]| (x, y)),
    ("Side view: z over x [m]", |[x, _, z]| (x, z)),
];

/// Flown path and its reference.
pub fn flown(timeline: &Timeline<'_>) -> Markup {
    let seen = |(title, view): (&str, View)| {
        let reference = timeline
            .path("reference", Ink::Reference, |sample| view(sample.telemetry.reference_position));
        let corners = Trace { name: "corners", ink: Ink::Fourth, points: corners(timeline, view) };
        let marks = std::iter::once(corners).chain(ends(timeline, view)).collect();
        in_plane(title, vec![reference, actual(timeline, view)], marks)
    };
    section("Path", html! { @for view in VIEWS { (seen(view)) } })
}

/// Recorded poses and estimated path.
pub fn recorded(timeline: &Timeline<'_>) -> Markup {
    let seen = |(title, view): (&str, View)| {
        let poses = timeline.flight.arrivals.iter().map(|arrival| view(arrival.position));
        let points = thin_path(poses.collect());
        let poses = Trace { name: "poses", ink: Ink::Reference, points };
        in_plane(title, vec![poses, actual(timeline, view)], ends(timeline, view).into())
    };
    section("Path", html! { @for view in VIEWS { (seen(view)) } })
}

fn actual(timeline: &Timeline<'_>, view: View) -> Trace {
    timeline.path(timeline.actual(), Ink::Actual, |sample| view(sample.position().into()))
}

/// First and last position.
fn ends(timeline: &Timeline<'_>, view: View) -> [Trace; 2] {
    let at = |sample: Option<&FlightSample>| sample.map(|sample| view(sample.position().into()));
    [("start", Ink::Good, timeline.samples.first()), ("end", Ink::Second, timeline.samples.last())]
        .map(|(name, ink, sample)| Trace { name, ink, points: at(sample).into_iter().collect() })
}

/// Start and end points of the steps of the reference.
fn corners(timeline: &Timeline<'_>, view: View) -> Vec<Point> {
    let references = timeline.samples.iter().map(|sample| sample.telemetry.reference_position);
    let mut corners = Vec::new();
    for (from, to) in references.clone().zip(references.skip(1)) {
        let distance = (0..3).map(|i| (to[i] - from[i]).powi(2)).sum::<f64>().sqrt();
        if distance > STEP_M {
            corners.extend([view(from), view(to)]);
        }
    }
    corners.dedup();
    corners
}
