//! Part of a flight shown in the report, as traces over time.

use std::ops::Range;

use maud::Markup;

use oqtal_bus::time::{Span, Time};

use crate::fault::{AppliedDisturbance, InjectedFault};
use crate::flight::{Flight, FlightSample};
use crate::plot::axis::{extent, is_drawable};
use crate::plot::figure::{self, TimeSpan};
use crate::plot::palette::Ink;
use crate::plot::trace::{Point, Trace, thin, thin_paths};

/// Maximum number of instants marked in every plot.
const MOST_INSTANTS: usize = 40;
/// Time between two ticks above which a trace is interrupted.
const GAP: Span = Span::from_millis(500);

/// Part of a flight shown in the report, on an axis of seconds.
#[derive(Clone, Debug)]
pub struct Timeline<'a> {
    /// The flight.
    pub flight: &'a Flight,
    /// Ticks from the origin on.
    pub samples: &'a [FlightSample],
    origin: Time,
    /// Changes of the safety state, beginnings and ends of faults and disturbances \[s\], up to a maximum number.
    pub instants: Vec<f64>,
    /// Number of further instants, which are not marked \[-\].
    pub unmarked: usize,
}

impl<'a> Timeline<'a> {
    /// The timeline of `flight` from its origin on.
    pub fn new(flight: &'a Flight) -> Self {
        let origin = flight.origin();
        let start = flight.samples.partition_point(|sample| sample.telemetry.time < origin);
        let samples = &flight.samples[start..];
        let mut timeline = Self { flight, samples, origin, instants: Vec::new(), unmarked: 0 };
        timeline.instants = timeline.find_instants();
        timeline.unmarked = timeline.instants.len().saturating_sub(MOST_INSTANTS);
        timeline.instants.truncate(MOST_INSTANTS);
        timeline
    }

    fn find_instants(&self) -> Vec<f64> {
        let condition = |sample: &FlightSample| (sample.telemetry.state, sample.telemetry.cause);
        let pairs = self.samples.windows(2);
        let changed = pairs.filter(|pair| condition(&pair[0]) != condition(&pair[1]));
        let faults = InjectedFault::all(self.flight);
        let faults = faults.iter().flat_map(|fault| [Some(fault.from_s), fault.until_s]);
        let loads = AppliedDisturbance::all(self.flight);
        let loads = loads.iter().flat_map(|load| [Some(load.from_s), load.until_s]);
        let caused = faults.chain(loads).flatten();
        let mut instants: Vec<f64> = changed.map(|pair| self.at(&pair[1])).chain(caused).collect();
        instants.sort_by(f64::total_cmp);
        instants
    }

    /// `time` on the time axis \[s\].
    pub fn seconds(&self, time: Time) -> f64 {
        time.since(self.origin).seconds()
    }

    /// Time of `sample` on the time axis \[s\].
    pub fn at(&self, sample: &FlightSample) -> f64 {
        self.seconds(sample.telemetry.time)
    }

    /// Times of the first and last tick \[s\].
    pub fn range(&self) -> Range<f64> {
        extent(
            [self.samples.first(), self.samples.last()].into_iter().flatten().map(|s| self.at(s)),
        )
    }

    /// The scored parts \[s\].
    pub fn scored(&self) -> Vec<Range<f64>> {
        let parts = self.samples.chunk_by(|a, b| a.is_scored() == b.is_scored());
        let scored = parts.filter(|part| part[0].is_scored());
        scored.map(|part| self.at(&part[0])..self.at(&part[part.len() - 1])).collect()
    }

    /// The trace of `value` over time.
    pub fn trace(
        &self,
        name: &'static str,
        ink: Ink,
        value: impl Fn(&FlightSample) -> f64,
    ) -> Trace {
        Trace { name, ink, points: thin(self.points(value)) }
    }

    /// One point for each tick, and an undrawable one where ticks are missing.
    fn points(&self, value: impl Fn(&FlightSample) -> f64) -> Vec<Point> {
        let mut points = Vec::with_capacity(self.samples.len());
        let mut before = None;
        for sample in self.samples {
            let time = sample.telemetry.time;
            if before.replace(time).is_some_and(|before: Time| time.since(before) > GAP) {
                points.push((self.at(sample), f64::NAN));
            }
            points.push((self.at(sample), value(sample)));
        }
        points
    }

    /// The source of the vehicle's motion: `truth` or `estimate`.
    pub fn actual(&self) -> &'static str {
        let has_truth = self.samples.iter().any(|sample| sample.truth.is_some());
        if has_truth { "truth" } else { "estimate" }
    }

    /// The battery voltage over time, if it is known, with a gap where none was reported.
    pub fn battery(&self) -> Option<Trace> {
        let range = self.range();
        let known =
            self.flight.applied.iter().map(|c| (self.seconds(c.stamps.applied_at), c.battery_v));
        let shown =
            |(t, voltage): &Point| *t >= range.start && *t <= range.end && is_drawable(*voltage);
        let mut points: Vec<Point> = Vec::new();
        for (t, voltage) in known.filter(shown) {
            if points.last().is_some_and(|(last, _)| t - last > GAP.seconds()) {
                points.push((t, f64::NAN));
            }
            points.push((t, voltage));
        }
        (!points.is_empty()).then(|| Trace {
            name: "voltage",
            ink: Ink::Third,
            points: thin(points),
        })
    }

    /// Trace of an angle \[rad\] over time, in degrees, with a gap where it wraps around.
    pub fn angle(
        &self,
        name: &'static str,
        ink: Ink,
        angle: impl Fn(&FlightSample) -> f64,
    ) -> Trace {
        let mut points: Vec<Point> = Vec::with_capacity(self.samples.len());
        for (t_s, degrees) in self.points(|sample| angle(sample).to_degrees()) {
            if points.last().is_some_and(|(_, last)| (degrees - last).abs() > 180.0) {
                points.push((t_s, f64::NAN));
            }
            points.push((t_s, degrees));
        }
        Trace { name, ink, points: thin(points) }
    }

    /// Path of a point, with one position per tick; straight where ticks are missing, and interrupted between flights.
    pub fn path(
        &self,
        name: &'static str,
        ink: Ink,
        point: impl Fn(&FlightSample) -> Point,
    ) -> Trace {
        let flights = self.samples.chunk_by(|a, b| a.is_armed() || !b.is_armed());
        let paths = flights.map(|ticks| ticks.iter().map(&point).collect());
        Trace { name, ink, points: thin_paths(paths) }
    }
}

/// A figure of traces over the time of the flight, with the scored parts shaded and events marked.
pub fn over_time(timeline: &Timeline<'_>, title: &str, traces: Vec<Trace>) -> Markup {
    let span = TimeSpan {
        range: timeline.range(),
        shaded: timeline.scored(),
        instants: timeline.instants.clone(),
    };
    figure::over_time(title, traces, &span)
}
