//! Where the vehicle went.

use maud::{Markup, html};

use crate::flight::Sample;

use super::figure::in_plane;
use super::palette::Ink;
use super::section;
use super::series::{Point, Timeline, Trace};

/// A reference that moves further than this in one tick steps \[m\].
const STEP_M: f64 = 0.1;

/// A direction of view: horizontal and vertical component of a position.
type View = fn([f64; 3]) -> Point;

/// The section of the path, seen from above and from the side.
pub fn path(timeline: &Timeline<'_>) -> Markup {
    section(
        "Path",
        html! {
            (seen(timeline, "Top view: y over x [m]", |[x, y, _]| (x, y)))
            (seen(timeline, "Side view: z over x [m]", |[x, _, z]| (x, z)))
        },
    )
}

fn seen(timeline: &Timeline<'_>, title: &str, view: View) -> Markup {
    let reference = |sample: &Sample| view(sample.telemetry.reference_position);
    let position = |sample: &Sample| view(sample.position().into());
    let paths = vec![
        timeline.path("reference", Ink::Reference, reference),
        timeline.path(timeline.actual(), Ink::Actual, position),
    ];
    let end = |sample: Option<&Sample>| sample.map(position).into_iter().collect();
    let marks = vec![
        Trace { name: "corners", ink: Ink::Fourth, points: corners(timeline, view) },
        Trace { name: "start", ink: Ink::Good, points: end(timeline.samples.first()) },
        Trace { name: "end", ink: Ink::Second, points: end(timeline.samples.last()) },
    ];
    in_plane(title, paths, marks)
}

/// Where the reference stepped from and to.
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
