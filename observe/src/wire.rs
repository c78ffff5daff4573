//! Figures of the wire between bridge and vehicle in a flight.

use crate::latency::{Distribution, DistributionSummary};
use oqtal_bus::message::{Header, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_control::metrics::Statistics;
use serde::Serialize;

use crate::plot::unit::significant;

/// Time between two commands above which the wire was not in use.
const GAP: Span = Span::from_millis(500);

/// Record of the vehicle messages of a bridge in flight.
#[derive(Clone, Debug, Default)]
pub struct WireRecord {
    /// Instant of the last command in flight; `None` after a gap.
    last: Option<Time>,
    /// Time from command to command in flight, without gaps, and the part of it for which commands occupied the wire.
    time: Span,
    busy: Span,
    pending: Span,
    from_capture: Distribution,
    from_publication: Distribution,
    quality: Statistics,
    least_quality: Option<f64>,
    latest: Option<VehicleV1>,
    answered: bool,
}

/// Figures of the wire.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct WireFigures {
    /// Fraction of the time in which commands occupy the line \[0..1\]; `None` over a network, whose bytes leave at once.
    pub command_occupancy: Option<f64>,
    /// Age of a command when its last byte is on the wire.
    pub command_age: CommandAge,
    /// Fraction of the requests to the vehicle that were answered \[0..1\]; `None` if there was no request.
    pub link_quality: Option<LinkQuality>,
}

/// Age of a command at its last byte.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct CommandAge {
    /// Since the capture of the pose it was computed from.
    pub from_capture: DistributionSummary,
    /// Since the publication of the command.
    pub from_publication: DistributionSummary,
}

/// Fraction of answered requests.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LinkQuality {
    /// Mean \[0..1\].
    pub mean: f64,
    /// Minimum over the bridge's averaging window \[0..1\].
    pub min: f64,
}

impl WireFigures {
    /// Occupancy and answered requests as text; `None` if neither is known.
    pub fn usage(&self) -> Option<String> {
        let percent = |share: f64| significant(100.0 * share);
        let occupied = self
            .command_occupancy
            .map(|share| format!("occupied by commands {} % of the time", percent(share)));
        let answered = self.link_quality.as_ref().map(|quality| {
            let [mean, min] = [quality.mean, quality.min].map(percent);
            format!("{mean} % of the requests answered (minimum {min} %)")
        });
        let all: Vec<String> = occupied.into_iter().chain(answered).collect();
        (!all.is_empty()).then(|| all.join(", "))
    }
}

impl WireRecord {
    /// Adds a vehicle message; of those that come while the vehicle is not armed, only the newest message is kept.
    pub fn vehicle(&mut self, header: &Header, vehicle: &VehicleV1, is_armed: bool) {
        self.latest = Some(*vehicle);
        self.answered |= vehicle.answers();
        let (stamps, wire) = (&header.stamps, Span::from_nanos(vehicle.wire_ns));
        // A simulated vehicle takes its commands from the bus. A datagram does not occupy a wire, but has an age.
        if vehicle.simulated == 1 || !is_armed {
            self.last = None;
            return;
        }
        // Before its first answer the vehicle may be switched off.
        if self.answered && vehicle.link_quality.is_finite() {
            self.quality.add(vehicle.link_quality);
            let least = self.least_quality.unwrap_or(1.0);
            self.least_quality = Some(least.min(vehicle.link_quality));
        }
        if stamps.applied_at.is_set() {
            let since =
                self.last.replace(stamps.applied_at).map(|last| stamps.applied_at.since(last));
            if let Some(since) = since.filter(|since| (Span::ZERO..=GAP).contains(since)) {
                self.time = self.time + since;
                self.busy = self.busy + self.pending;
            }
            self.pending = Span::ZERO;
        }
        self.pending = self.pending + wire;
        if stamps.applied_at.is_set() && stamps.captured_at.is_set() {
            self.from_capture.add(stamps.applied_at.since(stamps.captured_at) + wire);
            let published = stamps.command_published_at;
            self.from_publication.add(stamps.applied_at.since(published) + wire);
        }
    }

    /// The newest vehicle message.
    pub fn latest(&self) -> Option<&VehicleV1> {
        self.latest.as_ref()
    }

    /// Whether the vehicle ever answered.
    pub fn answered(&self) -> bool {
        self.answered
    }

    /// Figures of the wire, a line or a network; `None` if no command was sent over a wire.
    pub fn figures(&self, is_line: bool) -> Option<WireFigures> {
        let mean = self.quality.mean();
        let occupancy = self.busy.seconds() / self.time.seconds().max(1e-9);
        (self.from_publication.count() > 0).then(|| WireFigures {
            command_occupancy: is_line.then_some(occupancy),
            command_age: CommandAge {
                from_capture: self.from_capture.summary(),
                from_publication: self.from_publication.summary(),
            },
            link_quality: self.least_quality.map(|min| LinkQuality { mean, min }),
        })
    }
}

/// Qualifier of the number of lost commands: with a bridge, only losses before it are counted.
pub(crate) fn place_of_losses(wire: Option<&WireFigures>) -> &'static str {
    if wire.is_some() { " before the bridge" } else { "" }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::message::Stamps;

    /// A command of 3 ms every 10 ms, each with this age when it is handed over.
    fn record(commands: u64, age: Span) -> WireRecord {
        let mut record = WireRecord::default();
        for command in 0..commands {
            let applied_at = Time::VIRTUAL_START + Span::from_millis(10 * command as i64);
            let stamps = Stamps {
                captured_at: applied_at - age,
                command_published_at: applied_at - Span::from_millis(1),
                applied_at,
                ..Stamps::default()
            };
            let header = Header { stamps, ..Header::default() };
            let quality = if command % 2 == 0 { 1.0 } else { 0.5 };
            let vehicle = VehicleV1 {
                wire_ns: 3_000_000,
                link_quality: quality,
                link: 1,
                ..Default::default()
            };
            record.vehicle(&header, &vehicle, true);
        }
        record
    }

    #[test]
    fn occupancy_age_and_quality_are_those_of_the_commands() {
        let figures = record(101, Span::from_millis(20)).figures(true).unwrap();
        assert!((figures.command_occupancy.unwrap() - 0.3).abs() < 1e-9);
        let age = figures.command_age;
        assert_eq!(place_of_losses(Some(&figures)), " before the bridge");
        assert_eq!((age.from_capture.count, age.from_capture.max_ns), (101, 23_000_000));
        assert_eq!(age.from_publication.min_ns, 4_000_000);
        let quality = figures.link_quality.unwrap();
        assert!((quality.mean - 0.75).abs() < 0.01 && quality.min == 0.5);
    }

    #[test]
    fn a_gap_and_commands_on_the_ground_do_not_count_as_use() {
        let mut used = record(101, Span::from_millis(20));
        let mut at = |millis, is_armed| {
            let applied_at = Time::VIRTUAL_START + Span::from_millis(millis);
            let header =
                Header { stamps: Stamps { applied_at, ..Stamps::default() }, ..Header::default() };
            let vehicle = VehicleV1 { wire_ns: 9_000_000, link: 1, ..VehicleV1::default() };
            used.vehicle(&header, &vehicle, is_armed);
        };
        for (millis, is_armed) in [(60_000, true), (60_010, false), (61_000, true)] {
            at(millis, is_armed);
        }
        let occupancy = used.figures(true).unwrap().command_occupancy.unwrap();
        assert!((occupancy - 0.3).abs() < 1e-9, "{occupancy}");
    }

    #[test]
    fn without_a_wire_there_are_no_figures() {
        let mut record = WireRecord::default();
        record.vehicle(&Header::default(), &VehicleV1 { link: 1, ..Default::default() }, true);
        assert!(record.figures(true).is_none() && record.answered());
    }
}
