//! Series of points from a flight, thinned to what a plot can show.

use std::ops::Range;

use oqtal_bus::time::Time;

use crate::flight::{Flight, Sample};

use super::axis::extent;
use super::palette::Ink;

/// What a plot draws: two coordinates.
pub type Point = (f64, f64);

/// A trace is thinned to this many points.
const MOST_POINTS: usize = 2000;

/// Numbers beyond this are faults, not measurements: a plot leaves a gap.
const GREATEST: f64 = 1e9;

/// Whether a plot can show `value`.
pub fn is_drawable(value: f64) -> bool {
    value.abs() <= GREATEST
}

/// Whether a plot can show `point`.
pub fn is_drawable_point(point: &Point) -> bool {
    is_drawable(point.0) && is_drawable(point.1)
}

/// A line with its name.
#[derive(Clone, Debug)]
pub struct Trace {
    /// What the legend says.
    pub name: &'static str,
    /// Its colour.
    pub ink: Ink,
    /// In order; a point that no plot can show is a gap.
    pub points: Vec<Point>,
}

/// The part of a flight that is shown, on an axis of seconds.
#[derive(Clone, Copy, Debug)]
pub struct Timeline<'a> {
    /// The flight.
    pub flight: &'a Flight,
    /// Its ticks from the origin on.
    pub samples: &'a [Sample],
    origin: Time,
}

impl<'a> Timeline<'a> {
    /// The timeline of `flight` from its origin on.
    pub fn new(flight: &'a Flight) -> Self {
        let origin = flight.origin();
        let start = flight.samples.partition_point(|sample| sample.telemetry.time < origin);
        Self { flight, samples: &flight.samples[start..], origin }
    }

    /// `time` on the axis \[s\].
    pub fn seconds(&self, time: Time) -> f64 {
        time.since(self.origin).seconds()
    }

    /// When `sample` was \[s\].
    pub fn at(&self, sample: &Sample) -> f64 {
        self.seconds(sample.telemetry.time)
    }

    /// From the first to the last tick \[s\].
    pub fn range(&self) -> Range<f64> {
        extent(
            [self.samples.first(), self.samples.last()].into_iter().flatten().map(|s| self.at(s)),
        )
    }

    /// The judged window \[s\].
    pub fn scored(&self) -> Option<Range<f64>> {
        let mut scored = self.flight.scored().map(|sample| self.at(sample));
        let first = scored.next()?;
        Some(first..scored.last().unwrap_or(first))
    }

    /// `value` of every tick over time.
    pub fn trace(&self, name: &'static str, ink: Ink, value: impl Fn(&Sample) -> f64) -> Trace {
        let points = self.samples.iter().map(|sample| (self.at(sample), value(sample)));
        Trace { name, ink, points: thin(points.collect()) }
    }

    /// What the vehicle's motion is known from.
    pub fn actual(&self) -> &'static str {
        let has_truth = self.samples.iter().any(|sample| sample.truth.is_some());
        if has_truth { "truth" } else { "estimate" }
    }

    /// The battery voltage over time, if it is known.
    pub fn battery(&self) -> Option<Trace> {
        let range = self.range();
        let points =
            self.flight.battery.iter().map(|(time, voltage)| (self.seconds(*time), *voltage));
        let shown =
            |(t, voltage): &Point| *t >= range.start && *t <= range.end && is_drawable(*voltage);
        let points: Vec<Point> = points.filter(shown).collect();
        (!points.is_empty()).then(|| Trace {
            name: "voltage",
            ink: Ink::Third,
            points: thin(points),
        })
    }

    /// An angle \[rad\] of every tick over time \[deg\], with a gap where it jumps from one end of its range to the other.
    pub fn angle(&self, name: &'static str, ink: Ink, angle: impl Fn(&Sample) -> f64) -> Trace {
        let mut points: Vec<Point> = Vec::with_capacity(self.samples.len());
        for sample in self.samples {
            let degrees = angle(sample).to_degrees();
            if points.last().is_some_and(|(_, last)| (degrees - last).abs() > 180.0) {
                points.push((self.at(sample), f64::NAN));
            }
            points.push((self.at(sample), degrees));
        }
        Trace { name, ink, points: thin(points) }
    }

    /// Two values of every tick against each other.
    pub fn path(&self, name: &'static str, ink: Ink, point: impl Fn(&Sample) -> Point) -> Trace {
        Trace { name, ink, points: thin_path(self.samples.iter().map(point).collect()) }
    }
}

/// At most [`MOST_POINTS`] of `points`, the least and the greatest of every stretch among them.
pub fn thin(points: Vec<Point>) -> Vec<Point> {
    if points.len() <= MOST_POINTS {
        return points;
    }
    points.chunks(points.len().div_ceil(MOST_POINTS / 2)).flat_map(extremes).collect()
}

/// The least and the greatest of a stretch, in their order; a gap if it has none.
fn extremes(stretch: &[Point]) -> impl Iterator<Item = Point> {
    let drawable = || stretch.iter().copied().enumerate().filter(|(_, (_, y))| is_drawable(*y));
    let least = drawable().min_by(|(_, a), (_, b)| a.1.total_cmp(&b.1));
    let greatest = drawable().max_by(|(_, a), (_, b)| a.1.total_cmp(&b.1));
    let (first, second) = match (least, greatest) {
        (Some(a), Some(b)) if a.0 < b.0 => (a.1, Some(b.1)),
        (Some(a), Some(b)) if a.0 > b.0 => (b.1, Some(a.1)),
        (Some(only), _) => (only.1, None),
        (None, _) => ((stretch[0].0, f64::NAN), None),
    };
    std::iter::once(first).chain(second)
}

/// At most [`MOST_POINTS`] of `points`: those that lie away from the last one kept. Excursions survive.
pub fn thin_path(points: Vec<Point>) -> Vec<Point> {
    let mut kept: Vec<Point> = points.into_iter().filter(is_drawable_point).collect();
    let (x, y) = (extent(kept.iter().map(|p| p.0)), extent(kept.iter().map(|p| p.1)));
    let mut spacing = 1e-3 * (x.end - x.start).max(y.end - y.start);
    kept = spaced(&kept, spacing);
    while kept.len() > MOST_POINTS {
        spacing *= 1.5;
        kept = spaced(&kept, spacing);
    }
    kept
}

fn spaced(points: &[Point], spacing: f64) -> Vec<Point> {
    let mut kept: Vec<Point> = Vec::new();
    for &(x, y) in points {
        if kept.last().is_none_or(|last| (x - last.0).hypot(y - last.1) > spacing) {
            kept.push((x, y));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn thinning_keeps_a_single_spike_and_the_order() {
        let mut points: Vec<Point> = (0..36_000).map(|i| (f64::from(i), 0.0)).collect();
        points[12_345].1 = 7.0;
        points[23_456].1 = -7.0;
        let thinned = thin(points);
        assert!(thinned.len() <= MOST_POINTS);
        assert!(thinned.contains(&(12_345.0, 7.0)) && thinned.contains(&(23_456.0, -7.0)));
        assert!(thinned.is_sorted_by(|a, b| a.0 < b.0));
    }

    #[test]
    fn thinning_keeps_a_gap() {
        let points =
            (0..36_000).map(|i| (f64::from(i), if i / 1000 == 7 { f64::NAN } else { 1.0 }));
        assert!(thin(points.collect()).iter().any(|(_, y)| y.is_nan()));
    }

    #[test]
    fn a_thinned_path_keeps_an_outlier() {
        let circle = (0..36_000).map(|i| (f64::from(i) * 0.01).sin_cos());
        let mut points: Vec<Point> = circle.collect();
        points[20_000] = (5.0, 5.0);
        let thinned = thin_path(points);
        assert!(thinned.len() <= MOST_POINTS && thinned.contains(&(5.0, 5.0)));
    }

    proptest! {
        #[test]
        fn any_points_can_be_thinned(
            points in prop::collection::vec((any::<f64>(), any::<f64>()), 0..3),
            copies in 1_usize..3000,
        ) {
            let many: Vec<Point> = points.iter().copied().cycle().take(points.len() * copies).collect();
            prop_assert!(thin(many.clone()).len() <= MOST_POINTS);
            prop_assert!(thin_path(many).len() <= MOST_POINTS);
        }
    }
}
