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
pub type View = fn([f64; 3]) -> Point;

/// The projections of a path, with their titles.
pub const VIEWS: [(&str, View); 2] = [
    ("Top view: y over x [m]", |[x, y, _]| (x, y)),
    ("Side view: z over x [m]", |[x, _, z]| (x, z)),
];

/// Flown path and its reference.
pub fn flown(timeline: &Timeline<'_>) -> Markup {
    let seen = |(title, view): (&str, View)| {
        let reference = timeline.path("reference", Ink::Reference, |sample| {
            shown(sample.is_armed(), view(sample.telemetry.reference_position))
        });
        let corners = Trace { name: "corners", ink: Ink::Fourth, points: corners(timeline, view) };
        let marks = std::iter::once(corners).chain(ends(timeline, view)).collect();
        in_plane(title, vec![reference, actual(timeline, view)], marks)
    };
    section("Path", html! { @for view in VIEWS { (seen(view)) } })
}

/// Recorded poses and estimated path.
pub fn recorded(timeline: &Timeline<'_>) -> Markup {
    let seen = |(title, view): (&str, View)| {
        in_plane(
            title,
            vec![poses(timeline, view), actual(timeline, view)],
            ends(timeline, view).into(),
        )
    };
    section("Path", html! { @for view in VIEWS { (seen(view)) } })
}

/// Poses of the body, with a gap where the cameras did not see it.
fn poses(timeline: &Timeline<'_>, view: View) -> Trace {
    let arrivals = timeline.flight.arrivals.iter();
    let points = arrivals.map(|arrival| shown(arrival.is_tracked, view(arrival.position)));
    Trace { name: "poses", ink: Ink::Reference, points: thin_path(points.collect()) }
}

fn actual(timeline: &Timeline<'_>, view: View) -> Trace {
    timeline.path(timeline.actual(), Ink::Actual, |sample| {
        shown(sample.is_located(), view(sample.position().into()))
    })
}

/// `point`, or one that is not drawn.
pub fn shown(is_shown: bool, point: Point) -> Point {
    if is_shown { point } else { (f64::NAN, f64::NAN) }
}

/// First and last position.
fn ends(timeline: &Timeline<'_>, view: View) -> [Trace; 2] {
    let at = |sample: Option<&FlightSample>| sample.map(|sample| view(sample.position().into()));
    [("start", Ink::Good, timeline.samples.first()), ("end", Ink::Second, timeline.samples.last())]
        .map(|(name, ink, sample)| Trace { name, ink, points: at(sample).into_iter().collect() })
}

/// Start and end points of the steps of the reference to a scored tick, without those at the end of a hold by the fence.
fn corners(timeline: &Timeline<'_>, view: View) -> Vec<Point> {
    let pairs = timeline.samples.windows(2);
    let steps = pairs.filter(|pair| pair[1].is_scored() && !pair[0].is_held());
    let mut corners = Vec::new();
    for pair in steps {
        let [from, to] = [0, 1].map(|tick: usize| pair[tick].telemetry.reference_position);
        let distance = (0..3).map(|i| (to[i] - from[i]).powi(2)).sum::<f64>().sqrt();
        if distance > STEP_M {
            corners.extend([view(from), view(to)]);
        }
    }
    corners.dedup();
    corners
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::trace::is_drawable_point;
    use crate::report::replay::ArrivalIntervals;
    use crate::report::tests::fixture;
    use oqtal_bus::code::{Mode, SafetyState};

    #[test]
    fn the_path_is_interrupted_between_two_flights() {
        let mut flight = fixture::square();
        let path = |flight: &_| actual(&Timeline::new(flight), VIEWS[0].1).points;
        assert!(path(&flight).iter().all(is_drawable_point));
        let landed = flight.samples.iter_mut().filter(|s| s.telemetry.tick.abs_diff(1000) < 30);
        landed.for_each(|sample| sample.telemetry.mode = Mode::Disarmed.code());
        let gaps = path(&flight).into_iter().filter(|point| !is_drawable_point(point));
        assert_eq!(gaps.count(), 1);
    }

    #[test]
    fn a_frame_without_the_body_is_neither_a_pose_nor_drawn() {
        let mut flight = fixture::replay();
        for arrival in &mut flight.arrivals[400..430] {
            (arrival.is_tracked, arrival.position) = (false, [77.0; 3]);
        }
        let drawn = poses(&Timeline::new(&flight), VIEWS[0].1).points;
        let mut without = flight.clone();
        without.arrivals.retain(|arrival| arrival.is_tracked);
        let [of_all, of_tracked] = [&flight, &without].map(ArrivalIntervals::of);
        assert!(!drawn.contains(&(77.0, 77.0)));
        assert_eq!(drawn.iter().filter(|point| !is_drawable_point(point)).count(), 1);
        assert_eq!(of_all.poses, of_tracked.poses);
        assert_eq!(of_all.frames_lost(), of_tracked.frames_lost());
    }

    #[test]
    fn the_point_at_which_the_fence_held_the_vehicle_is_not_a_corner() {
        let mut flight = fixture::square();
        let marked = |flight: &_| corners(&Timeline::new(flight), VIEWS[0].1);
        let all = marked(&flight);
        let is_late = |sample: &&mut FlightSample| sample.telemetry.mission_s > 12.0;
        for FlightSample { telemetry, .. } in flight.samples.iter_mut().filter(is_late).take(30) {
            telemetry.reference_position[0] += 0.3;
            (telemetry.scored, telemetry.mode) = (0, Mode::Flying.code());
            telemetry.state = SafetyState::Hold.code();
        }
        assert!(all.len() > 3 && marked(&flight) == all, "{all:?}");
    }
}
