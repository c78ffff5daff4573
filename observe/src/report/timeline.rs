//! The part of a flight that a report shows, as traces over time.

use std::ops::Range;

use maud::Markup;

use oqtal_bus::time::Time;

use crate::flight::{Flight, FlightSample};
use crate::plot::axis::{extent, is_drawable};
use crate::plot::figure;
use crate::plot::palette::Ink;
use crate::plot::trace::{Point, Trace, thin, thin_path};

/// The part of a flight that is shown, on an axis of seconds.
#[derive(Clone, Copy, Debug)]
pub struct Timeline<'a> {
    /// The flight.
    pub flight: &'a Flight,
    /// Its ticks from the origin on.
    pub samples: &'a [FlightSample],
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
    pub fn at(&self, sample: &FlightSample) -> f64 {
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
    pub fn trace(
        &self,
        name: &'static str,
        ink: Ink,
        value: impl Fn(&FlightSample) -> f64,
    ) -> Trace {
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
    pub fn angle(
        &self,
        name: &'static str,
        ink: Ink,
        angle: impl Fn(&FlightSample) -> f64,
    ) -> Trace {
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
    pub fn path(
        &self,
        name: &'static str,
        ink: Ink,
        point: impl Fn(&FlightSample) -> Point,
    ) -> Trace {
        Trace { name, ink, points: thin_path(self.samples.iter().map(point).collect()) }
    }
}

/// Traces over the time of the flight, the judged window shaded.
pub fn over_time(timeline: &Timeline<'_>, title: &str, traces: Vec<Trace>) -> Markup {
    figure::over_time(title, traces, timeline.range(), timeline.scored())
}
