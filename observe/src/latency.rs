//! Latency from the capture of a pose to its effect on the vehicle, by hops.
//!
//! ```text
//!  captured ─▶ pose published ─▶ woken ─▶ command published ─▶ received ─▶ applied
//! ```
//! For every sample the sum of the hops is `sensor_to_actuator`, which ends when the command takes effect. Behind a bridge the
//! last stamp is taken when the last byte is handed to the wire; the time on the wire and the configured time in the air are
//! additional hops.

use hdrhistogram::Histogram;
use serde::Serialize;

use oqtal_bus::message::{Stamps, VehicleV1};
use oqtal_bus::time::Span;

/// Names of the hops, in order.
pub const HOPS: [&str; 5] = [
    "capture_to_publish",
    "publish_to_daemon",
    "compute",
    "command_to_vehicle",
    "vehicle_to_applied",
];

/// Parts of the first hop if a receiver publishes the poses of a real camera system.
pub const RECEIVER: [&str; 2] = ["capture_to_receive", "receive_to_publish"];

/// Name of the part of `compute` in which an external law answers; of the answers in time.
pub const ANSWER: &str = "question_to_answer";
/// Name of the hop over a wire, after the others.
pub const WIRE: &str = "wire";

/// Name of the hop from the last byte on the wire to the effect: not measured, set by `bridge.air-latency-ms`.
pub const AIR: &str = "air_configured";

/// Name of the sum of all hops.
pub const WHOLE: &str = "sensor_to_actuator";

/// Names of all distributions, in the order of the stages.
pub const NAMES: [&str; HOPS.len() + RECEIVER.len() + 4] = [
    HOPS[0],
    RECEIVER[0],
    RECEIVER[1],
    HOPS[1],
    HOPS[2],
    ANSWER,
    HOPS[3],
    HOPS[4],
    WIRE,
    AIR,
    WHOLE,
];

/// Time from the last stamp of a command to its effect; zero for a vehicle simulated on the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OnwardTime {
    /// Time of its bytes on the wire.
    pub wire: Span,
    /// Configured time from the last byte on the wire to the effect.
    pub air: Span,
}

impl OnwardTime {
    /// Time of the command in effect.
    pub fn of(vehicle: &VehicleV1) -> Self {
        let VehicleV1 { wire_ns, air_ns, .. } = *vehicle;
        Self { wire: Span::from_nanos(wire_ns), air: Span::from_nanos(air_ns) }
    }
}

/// Upper end of the histogram's range \[ns\].
const LONGEST_NS: u64 = 60_000_000_000;

/// Hops of one sample; `None` if a stamp is missing or earlier than the previous one.
pub fn hops(stamps: &Stamps) -> Option<[Span; HOPS.len()]> {
    let stations = [
        stamps.captured_at,
        stamps.pose_published_at,
        stamps.woken_at,
        stamps.command_published_at,
        stamps.received_at,
        stamps.applied_at,
    ];
    let ordered = stations.windows(2).all(|pair| pair[0] <= pair[1]);
    let complete = stations.iter().all(|station| station.is_set());
    (ordered && complete).then(|| std::array::from_fn(|i| stations[i + 1].since(stations[i])))
}

/// Parts of the first hop; `None` without a receiver.
pub fn receiver_hops(stamps: &Stamps) -> Option<[Span; RECEIVER.len()]> {
    let Stamps { captured_at, pose_received_at, pose_published_at, .. } = *stamps;
    let ordered = captured_at <= pose_received_at && pose_received_at <= pose_published_at;
    let parts = [pose_received_at.since(captured_at), pose_published_at.since(pose_received_at)];
    (ordered && captured_at.is_set()).then_some(parts)
}

/// Time from capture to effect.
pub fn sensor_to_actuator(stamps: &Stamps, onward: OnwardTime) -> Span {
    stamps.applied_at.since(stamps.captured_at) + onward.wire + onward.air
}

/// Distribution of spans in bounded memory: minimum and maximum are exact, quantiles have three digits.
#[derive(Clone, Debug)]
pub struct Distribution {
    spans: Histogram<u64>,
    /// Minimum and maximum \[ns\].
    ends: (u64, u64),
}

impl Default for Distribution {
    fn default() -> Self {
        // The histogram grows as needed: memory for a minute from the start would cost a tenth of the time of a flight in virtual
        // time.
        let spans = Histogram::new(3).expect("three digits are allowed");
        Self { spans, ends: (u64::MAX, 0) }
    }
}

impl Distribution {
    /// Adds a span. A negative span counts as zero; in quantiles a span above one minute counts as one minute.
    pub fn add(&mut self, span: Span) {
        let nanos = span.nanos().max(0).unsigned_abs();
        self.spans.record(nanos.min(LONGEST_NS)).expect("the histogram grows to a minute");
        self.ends = (self.ends.0.min(nanos), self.ends.1.max(nanos));
    }

    /// Quantile: the span not exceeded by the fraction `quantile` of all spans; zero for an empty distribution.
    pub fn quantile(&self, quantile: f64) -> Span {
        Span::from_nanos(self.quantile_ns(quantile).cast_signed())
    }

    fn quantile_ns(&self, quantile: f64) -> u64 {
        let (least, greatest) = self.ends;
        // The histogram returns the upper edge of a bucket, which may exceed all spans in it.
        if self.spans.is_empty() {
            0
        } else {
            self.spans.value_at_quantile(quantile).clamp(least, greatest)
        }
    }

    /// Number of spans \[-\].
    pub fn count(&self) -> u64 {
        self.spans.len()
    }

    /// The figures of the distribution.
    pub fn summary(&self) -> DistributionSummary {
        let (least, greatest) = self.ends;
        DistributionSummary {
            count: self.spans.len(),
            min_ns: if self.spans.is_empty() { 0 } else { least },
            p50_ns: self.quantile_ns(0.5),
            p99_ns: self.quantile_ns(0.99),
            p999_ns: self.quantile_ns(0.999),
            max_ns: greatest,
        }
    }
}

/// The figures of a [`Distribution`], in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[allow(missing_docs)]
pub struct DistributionSummary {
    pub count: u64,
    pub min_ns: u64,
    pub p50_ns: u64,
    pub p99_ns: u64,
    pub p999_ns: u64,
    pub max_ns: u64,
}

/// Distributions of all hops and of their sum, in the order of [`NAMES`].
#[derive(Clone, Debug, Default)]
pub struct HopDistributions([Distribution; NAMES.len()]);

impl HopDistributions {
    /// Adds a sample whose command took effect `onward` after its last stamp; a sample with a missing stamp is ignored.
    pub fn add(&mut self, stamps: &Stamps, onward: OnwardTime) {
        let Some([capture, publish, compute, command, vehicle]) = hops(stamps) else { return };
        let [received, published] = receiver_hops(stamps).map_or([None; 2], |hops| hops.map(Some));
        let [wire, air] =
            [onward.wire, onward.air].map(|span| Some(span).filter(|span| *span > Span::ZERO));
        let whole = sensor_to_actuator(stamps, onward);
        let [capture, publish, compute, command, vehicle, whole] =
            [capture, publish, compute, command, vehicle, whole].map(Some);
        let spans = [
            capture, received, published, publish, compute, None, command, vehicle, wire, air,
            whole,
        ];
        for (distribution, span) in self.0.iter_mut().zip(spans) {
            span.into_iter().for_each(|span| distribution.add(span));
        }
    }

    /// Adds the time in which an external law answered.
    pub fn add_answer(&mut self, span: Span) {
        let answers = NAMES.iter().zip(&mut self.0).find(|(name, _)| **name == ANSWER);
        answers.into_iter().for_each(|(_, distribution)| distribution.add(span));
    }

    /// Distributions by name: every hop and their sum; wire, air and the parts of hops only if they have samples.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, &Distribution)> {
        let always = |name: &str| HOPS.contains(&name) || name == WHOLE;
        NAMES.into_iter().zip(&self.0).filter(move |(name, hop)| always(name) || hop.count() > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::time::Time;

    fn stamps(nanos: [u64; 6]) -> Stamps {
        let [
            captured_at,
            pose_published_at,
            woken_at,
            command_published_at,
            received_at,
            applied_at,
        ] = nanos.map(Time::from_nanos);
        Stamps {
            captured_at,
            pose_published_at,
            woken_at,
            computed_at: woken_at,
            command_published_at,
            received_at,
            applied_at,
            ..Stamps::default()
        }
    }

    #[test]
    fn the_first_hop_has_two_parts_where_there_is_a_receiver() {
        let emulated = stamps([10, 25, 27, 40, 41, 99]);
        let received = Stamps { pose_received_at: Time::from_nanos(22), ..emulated };
        assert_eq!(receiver_hops(&emulated), None);
        assert_eq!(receiver_hops(&received).unwrap(), [12, 3].map(Span::from_nanos));
        let mut hops = HopDistributions::default();
        hops.add(&emulated, OnwardTime::default());
        assert_eq!(hops.iter().count(), HOPS.len() + 1);
        hops.add(&received, OnwardTime::default());
        assert_eq!(hops.iter().count(), HOPS.len() + RECEIVER.len() + 1);
    }

    #[test]
    fn the_hops_of_a_sample_add_up_to_the_whole() {
        let stamps = stamps([10, 25, 27, 40, 41, 99]);
        let spans = hops(&stamps).unwrap();
        let sum = spans.into_iter().fold(Span::ZERO, |sum, span| sum + span);
        assert_eq!(sum, sensor_to_actuator(&stamps, OnwardTime::default()));
        assert_eq!(spans[2], Span::from_nanos(13));
    }

    #[test]
    fn a_sample_that_missed_a_station_or_ran_back_is_left_out() {
        assert_eq!(hops(&stamps([10, 25, 0, 40, 41, 99])), None);
        assert_eq!(hops(&stamps([10, 25, 24, 40, 41, 99])), None);
    }

    #[test]
    fn wire_and_air_are_hops_of_their_own_and_part_of_the_whole() {
        let mut hops = HopDistributions::default();
        hops.add(&stamps([10, 25, 27, 40, 41, 99]), OnwardTime::default());
        assert!(hops.iter().all(|(name, _)| name != WIRE));
        let onward = OnwardTime { wire: Span::from_nanos(1000), air: Span::from_nanos(500) };
        hops.add(&stamps([10, 25, 27, 40, 41, 99]), onward);
        let found = |wanted| hops.iter().find(|(name, _)| *name == wanted).unwrap().1.summary();
        assert_eq!((found(WIRE).count, found(WIRE).max_ns), (1, 1000));
        assert_eq!((found(AIR).count, found(AIR).max_ns), (1, 500));
        assert_eq!((found(WHOLE).min_ns, found(WHOLE).max_ns), (89, 1589));
    }

    #[test]
    fn the_ends_are_exact_and_no_quantile_lies_beyond_them() {
        let mut distribution = Distribution::default();
        for nanos in [15_000_000, 15_000_000, 15_000_001, 90_000_000_123] {
            distribution.add(Span::from_nanos(nanos));
        }
        let summary = distribution.summary();
        assert_eq!((summary.min_ns, summary.max_ns), (15_000_000, 90_000_000_123));
        let mut alike = Distribution::default();
        alike.add(Span::from_millis(15));
        let DistributionSummary { min_ns, p50_ns, p99_ns, p999_ns, max_ns, .. } = alike.summary();
        assert_eq!([min_ns, p50_ns, p99_ns, p999_ns, max_ns], [15_000_000; 5]);
    }

    #[test]
    fn quantiles_of_a_distribution_have_three_digits() {
        let mut distribution = Distribution::default();
        for micros in 1..=1000 {
            distribution.add(Span::from_nanos(micros * 1000));
        }
        let summary = distribution.summary();
        assert_eq!(summary.count, 1000);
        assert!((summary.p50_ns as f64 / 500_000.0 - 1.0).abs() < 2e-3);
        assert!((summary.p99_ns as f64 / 990_000.0 - 1.0).abs() < 2e-3);
        assert_eq!(Distribution::default().summary(), DistributionSummary::default());
    }
}
