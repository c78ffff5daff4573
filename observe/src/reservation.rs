//! Reasons why the figures of a recording may not be those of one flight with the recorded configuration.

use oqtal_bus::time::Span;

use crate::flight::Flight;
use crate::flight_sample::FlightSample;

/// Time between two ticks above which the instant of what happened between them is not known.
pub(crate) const LONGEST_TICK: Span = Span::from_millis(250);

impl Flight {
    /// Reason why the figures may not be those of one flight with the recorded configuration.
    pub fn reservation(&self) -> Option<String> {
        let flights = if self.is_observation() { 0 } else { self.flights().count() };
        let several = (flights > 1).then(|| {
            format!(
                "{flights} flights in one recording: the figures are those of all, the outcome is that of the first to end; FILE#NUMBER names one of them"
            )
        });
        let reasons: Vec<String> = several.into_iter().chain(self.record_flaws()).collect();
        (!reasons.is_empty()).then(|| reasons.join("; "))
    }

    /// Gaps of the record, and another configuration than the recorded one.
    pub fn record_flaws(&self) -> Vec<String> {
        let other = self.has_other_config.then(|| {
            "the daemon ran with another configuration than was recorded: law, vehicle or settings are not those that flew".to_owned()
        });
        let missing_s = self.missing_s();
        let missing = (missing_s > LONGEST_TICK.seconds()).then(|| {
            format!(
                "{missing_s:.2} s of the flight are not in the record, or without truth: the figures are those of the rest"
            )
        });
        let requests = (self.lost_requests > 0).then(|| {
            format!(
                "{} records of requests are missing: settings changed in flight may be unknown, and a replay differs",
                self.lost_requests
            )
        });
        other.into_iter().chain(missing).chain(requests).collect()
    }

    /// Time within flights that the record lacks \[s\]: without ticks, or without truth in a flight with truth.
    fn missing_s(&self) -> f64 {
        let has_truth = self.has_truth();
        let gap_s = |pair: &[&FlightSample]| {
            let [before, after] = [pair[0], pair[1]].map(|sample| sample.telemetry);
            let is_gap = after.tick > before.tick + 1;
            if is_gap { after.time.since(before.time).seconds() } else { 0.0 }
        };
        let of_one = |ticks: &[FlightSample]| {
            let known: Vec<_> = ticks.iter().filter(|it| it.truth.is_some() == has_truth).collect();
            known.windows(2).map(gap_s).sum::<f64>()
        };
        self.flights().map(of_one).sum()
    }
}
