//! Injected faults (`[fault]`) and disturbances (`plant.disturb`) of a flight.

use oqtal_bus::time::Time;
use serde::Serialize;

use crate::flight::Flight;

/// Fault that began before the end of the flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InjectedFault {
    /// The fault in the grammar of `oqtal fly --fault`.
    pub fault: String,
    /// Beginning, from arming \[s\].
    pub from_s: f64,
    /// End, from arming; `None` if the fault lasted longer than the flight \[s\].
    pub until_s: Option<f64>,
}

/// Disturbance that began before the end of the flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AppliedDisturbance {
    /// The disturbance in the grammar of `oqtal fly --disturb`.
    pub disturbance: String,
    /// Beginning, from arming \[s\].
    pub from_s: f64,
    /// End, from arming; `None` if the disturbance lasted longer than the flight \[s\].
    pub until_s: Option<f64>,
    /// Whether it acted in a scored tick.
    pub is_scored: bool,
    /// Whether it ended before a scored tick and acted in none: the errors contain its after-effect.
    #[serde(skip)]
    pub is_before_score: bool,
}

impl InjectedFault {
    /// The faults of `flight`, in the order of their beginnings.
    pub fn all(flight: &Flight) -> Vec<Self> {
        let faults = flight.config.fault.inject.iter();
        let periods = faults.map(|fault| (fault.to_string(), fault.at_s, fault.end_s()));
        let all = begun(flight, periods).into_iter();
        all.map(|(fault, from_s, until_s)| Self { fault, from_s, until_s }).collect()
    }
}

impl AppliedDisturbance {
    /// The disturbances of `flight`, in the order of their beginnings.
    pub fn all(flight: &Flight) -> Vec<Self> {
        let loads = flight.config.plant.disturb.iter();
        let periods = loads.map(|load| (load.to_string(), load.at_s, load.end_s()));
        let start = flight.armed().next().map(|first| first.telemetry.time);
        let time_s = |at: Time| start.map_or(0.0, |start| at.since(start).seconds());
        let times_s: Vec<f64> = flight.scored().map(|tick| time_s(tick.telemetry.time)).collect();
        let acts = |t_s: f64, from_s: f64, until_s: Option<f64>| {
            t_s >= from_s && until_s.is_none_or(|until_s| t_s <= until_s)
        };
        let all = begun(flight, periods).into_iter();
        all.map(|(disturbance, from_s, until_s)| {
            let is_scored = times_s.iter().any(|t_s| acts(*t_s, from_s, until_s));
            let is_before_score = !is_scored && times_s.last().is_some_and(|last| from_s < *last);
            Self { disturbance, from_s, until_s, is_scored, is_before_score }
        })
        .collect()
    }
}

/// Periods (name, beginning and end after arming \[s\]) that began before the end of `flight`, in order; an end after
/// the flight is omitted.
fn begun(
    flight: &Flight,
    periods: impl Iterator<Item = (String, f64, f64)>,
) -> Vec<(String, f64, Option<f64>)> {
    let flown_s = flight
        .armed()
        .next()
        .zip(flight.samples.last())
        .map(|(first, last)| last.telemetry.time.since(first.telemetry.time).seconds());
    let came = |at_s: f64| flown_s.is_some_and(|flown_s| at_s <= flown_s);
    // A fault that ends the daemon comes up to a period after the last tick.
    let period_s = 1.0 / flight.config.loop_rate_hz();
    let begun = periods.filter(|(_, from_s, _)| came(*from_s - period_s));
    let mut all: Vec<_> = begun
        .map(|(name, from_s, end_s)| (name, from_s, Some(end_s).filter(|it| came(*it))))
        .collect();
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::fixture;

    #[test]
    fn the_after_effect_of_a_disturbance_before_the_scored_time_is_told() {
        let mut flight = fixture::square();
        let last_s = flight.scored().last().unwrap().telemetry.time.since(flight.origin());
        let first_s = flight.scored().next().unwrap().telemetry.time.since(flight.origin());
        let (first_s, last_s) = (first_s.seconds(), last_s.seconds());
        let load = |at_s: f64| format!("mass@{at_s:.3}+0.02=0.1kg").parse().unwrap();
        flight.config.plant.disturb =
            vec![load(first_s - 0.1), load(0.5 * (first_s + last_s)), load(last_s + 0.1)];
        let all = AppliedDisturbance::all(&flight);
        let told = all.iter().map(|load| (load.is_scored, load.is_before_score));
        assert_eq!(told.collect::<Vec<_>>(), [(false, true), (true, false), (false, false)]);
    }

    #[test]
    fn a_fault_that_ended_the_daemon_is_listed_and_a_later_one_is_not() {
        let mut flight = fixture::square();
        let last = flight.samples.last().unwrap().telemetry.time;
        let flown_s = last.since(flight.origin()).seconds();
        let fault = |at_s: f64| format!("daemon:kill@{at_s:.3}").parse().unwrap();
        flight.config.fault.inject = vec![fault(flown_s + 0.01), fault(flown_s + 0.05)];
        let listed = InjectedFault::all(&flight);
        assert_eq!(listed.len(), 1, "{listed:?}");
        assert_eq!(listed[0].until_s, None);
    }
}
