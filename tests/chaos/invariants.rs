//! Invariants of every flight under any fault.

use nalgebra::Vector3;
use oqtal_bus::code::SafetyState;
use oqtal_bus::time::Span;
use oqtal_daemon::Fence;
use oqtal_observe::flight::{Flight, FlightSample};

/// Maximum time for which motors may run after the vehicle has tipped.
const TIPPED_LIMIT: Span = Span::from_millis(500);

/// Violations of the invariants in `flight`, one line each.
pub fn violations(flight: &Flight) -> Vec<String> {
    [nonsense(flight), tipped(flight), outside(flight)].into_iter().flatten().collect()
}

/// Safety states worse than Nominal in the air.
pub fn states_of(flight: &Flight) -> Vec<String> {
    let mut states: Vec<u8> = flight.armed().map(|sample| sample.telemetry.state).collect();
    states.sort_unstable();
    states.dedup();
    let names = states.into_iter().filter_map(SafetyState::from_code);
    names.filter(|state| *state > SafetyState::Nominal).map(|state| state.to_string()).collect()
}

/// Number of faults that began in the air \[-\].
pub fn faults_in_the_air(flight: &Flight) -> u32 {
    let times = |sample: &FlightSample| sample.telemetry.time.since(flight.origin()).seconds();
    let (first, last) = (flight.armed().next().map(times), flight.armed().last().map(times));
    let (Some(first), Some(last)) = (first, last) else { return 0 };
    let faults = flight.config.fault.inject.iter();
    faults.filter(|fault| (first..=last).contains(&(first + fault.at_s))).count() as u32
}

/// Whether the daemon commands thrust.
fn is_powered(sample: &FlightSample) -> bool {
    sample.is_armed() && sample.telemetry.thrust > 0.0
}

fn at(flight: &Flight, sample: &FlightSample) -> f64 {
    sample.telemetry.time.since(flight.origin()).seconds()
}

/// Violation: a command that is not finite or out of range.
fn nonsense(flight: &Flight) -> Option<String> {
    let wrong = flight.samples.iter().find(|sample| {
        let telemetry = &sample.telemetry;
        let sticks = telemetry.sticks.iter().all(|stick| (-1.0..=1.0).contains(stick));
        let torque = telemetry.torque.iter().all(|torque| torque.is_finite());
        !(sticks && torque && (0.0..=1.0).contains(&telemetry.thrust))
    })?;
    Some(format!("a command out of range at {:.3} s", at(flight, wrong)))
}

/// Violation: motors that still run after the vehicle has tipped.
fn tipped(flight: &Flight) -> Option<String> {
    let is_tipped = |sample: &&FlightSample| {
        sample.truth.is_some() && sample.attitude().to_world(&Vector3::z()).z < 0.0
    };
    let tipped = flight.armed().find(is_tipped)?.telemetry.time;
    let on = |sample: &&FlightSample| {
        is_powered(sample) && sample.telemetry.time.since(tipped) > TIPPED_LIMIT
    };
    let sample = flight.samples.iter().find(on)?;
    Some(format!(
        "power at {:.3} s, tipped at {:.3} s",
        at(flight, sample),
        tipped.since(flight.origin()).seconds()
    ))
}

/// Violation: a powered vehicle beyond the hard border of the fence.
fn outside(flight: &Flight) -> Option<String> {
    let fence = Fence::new(&flight.config.fence);
    let away =
        |sample: &&FlightSample| is_powered(sample) && fence.inside_m(&sample.position()) <= 0.0;
    let sample = flight.samples.iter().find(away)?;
    let position = sample.position();
    Some(format!("under power at {:.1?} at {:.3} s", position.as_slice(), at(flight, sample)))
}
