//! The faults that were injected into a flight (`[fault]`).

use serde::Serialize;

use crate::flight::Flight;

/// A fault that began before the flight was over.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InjectedFault {
    /// The fault in the grammar of `oqtal fly --fault`.
    pub fault: String,
    /// Beginning, from arming \[s\].
    pub from_s: f64,
    /// End, from arming; `None` if the fault lasted longer than the flight \[s\].
    pub until_s: Option<f64>,
}

impl InjectedFault {
    /// The faults of `flight`, in the order of their beginnings.
    #[must_use]
    pub fn all(flight: &Flight) -> Vec<Self> {
        let flown_s = flight
            .armed()
            .next()
            .zip(flight.samples.last())
            .map(|(first, last)| last.telemetry.time.since(first.telemetry.time).seconds());
        let begun = |at_s: f64| flown_s.is_some_and(|flown_s| at_s <= flown_s);
        let faults = flight.config.fault.inject.iter().filter(|fault| begun(fault.at_s));
        let mut all: Vec<Self> = faults
            .map(|fault| Self {
                fault: fault.to_string(),
                from_s: fault.at_s,
                until_s: Some(fault.end_s()).filter(|end_s| begun(*end_s)),
            })
            .collect();
        all.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
        all
    }
}
