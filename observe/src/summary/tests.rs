use oqtal_bus::code::Mode;
use oqtal_bus::time::Time;

use super::*;
use crate::report::tests::fixture;

#[test]
fn a_flight_without_a_score_is_not_said_to_be_compared() {
    let held = |scored_s| Summary { held_s: 1.5, scored_s, ..Summary::of(&fixture::square()) };
    assert!(held(9.0).held().unwrap().ends_with("do not compare with other flights"));
    assert_eq!(held(0.0).held().as_deref(), Some("held by the fence for 1.50 s"));
}

#[test]
fn misses_at_the_end_of_each_flight_of_a_recording_count() {
    let mut flight = fixture::square();
    let one = flight.samples.len();
    flight.samples.extend_from_within(..);
    for (k, sample) in flight.samples.iter_mut().enumerate() {
        // Each flight ends with a late tick.
        let ended = (k + 1).div_euclid(one) as u64;
        let tick = &mut sample.telemetry;
        (tick.deadline_misses, tick.poses_superseded) = (ended, 100 * ended);
        let mode = if (k + 1) % one == 0 { Mode::Disarmed } else { Mode::Flying };
        tick.mode = mode.code();
        tick.time = Time::VIRTUAL_START + Span::from_millis(17 * k as i64);
    }
    let summary = Summary::of(&flight);
    assert_eq!((summary.deadline_misses, summary.poses_superseded), (2, 200));
}
