//! Tests of the collector.

use super::*;
use oqtal_bus::code::{Cause, Mode};

fn tick(millis: i64, state: SafetyState, mode: Mode) -> TelemetryV1 {
    TelemetryV1 {
        time: Time::VIRTUAL_START + Span::from_millis(millis),
        position: [1.0, 2.0, 3.0],
        reference_position: [1.0, 2.0, 2.0],
        state: state.code(),
        mode: mode.code(),
        cause: if state == SafetyState::Nominal { Cause::None } else { Cause::NoPose }.code(),
        ..TelemetryV1::default()
    }
}

fn column(name: &str) -> usize {
    row::TICK_COLUMNS.iter().position(|column| *column == name).unwrap()
}

#[test]
fn a_tick_is_compared_with_the_truth_nearest_to_it() {
    let mut collector = Collector::new(&Config::default());
    let reception = Reception::default();
    collector.sample(&reception, Sample::Telemetry(&tick(20, SafetyState::Nominal, Mode::Flying)));
    for millis in [0, 18, 21, 40] {
        let time = Time::VIRTUAL_START + Span::from_millis(millis);
        let position = [millis as f64, 2.0, 2.0];
        let truth = TruthV1 { time, position, ..TruthV1::default() };
        collector.sample(&reception, Sample::Truth(&truth));
    }
    let Collected { ticks, .. } = collector.take();
    assert_eq!((ticks[0][column("x")], ticks[0][column("position")]), (21.0, 20.0));
    assert_eq!(ticks[0][column("truth")], 1.0);
}

#[test]
fn virtual_time_that_begins_again_is_another_flight() {
    let mut collector = Collector::new(&Config::default());
    for millis in [0, 500, 1000, 0, 20] {
        let tick = tick(millis, SafetyState::Nominal, Mode::Flying);
        collector.sample(&Reception::default(), Sample::Telemetry(&tick));
    }
    let times: Vec<f64> = collector.take().ticks.iter().map(|row| row[0]).collect();
    assert_eq!(times, [0.0, 0.02]);
}

#[test]
fn every_tick_of_a_long_recording_is_compared_with_its_truth() {
    let mut collector = Collector::new(&Config::default());
    let reception = Reception::default();
    for millis in 0..10_000 {
        let time = Time::VIRTUAL_START + Span::from_millis(millis);
        let truth = TruthV1 { time, position: [5.0; 3], ..TruthV1::default() };
        collector.sample(&reception, Sample::Truth(&truth));
        if millis % 20 == 0 {
            let tick = tick(millis, SafetyState::Nominal, Mode::Flying);
            collector.sample(&reception, Sample::Telemetry(&tick));
        }
    }
    let Collected { ticks, .. } = collector.take();
    assert!(ticks.len() == 500 && ticks.iter().all(|tick| tick[column("x")] == 5.0));
}

#[test]
fn a_tick_waits_for_its_truth_and_has_no_errors_without_one() {
    let mut collector = Collector::new(&Config::default());
    let truth = |collector: &mut Collector, millis| {
        let time = Time::VIRTUAL_START + Span::from_millis(millis);
        let truth = TruthV1 { time, position: [5.0; 3], ..TruthV1::default() };
        collector.sample(&Reception::default(), Sample::Truth(&truth));
    };
    truth(&mut collector, 0);
    for millis in [1, 8, 30] {
        let tick = tick(millis, SafetyState::Nominal, Mode::Flying);
        collector.sample(&Reception::default(), Sample::Telemetry(&tick));
    }
    assert!(collector.take().ticks.is_empty());
    // A sample out of order, as in old recordings, does not take the truth from ticks before it.
    [20, 10].into_iter().for_each(|millis| truth(&mut collector, millis));
    let ticks = collector.take().ticks;
    let errors = [0, 1].map(|tick: usize| ticks[tick][column("position")]);
    assert!(ticks.len() == 2 && errors[0] > 4.0 && errors[1].is_nan(), "{ticks:?}");
    assert_eq!(collector.finish().ticks.len(), 1);
}

#[test]
fn without_a_truth_the_estimate_is_shown() {
    let mut collector = Collector::new(&Config::default());
    collector.sample(
        &Reception::default(),
        Sample::Telemetry(&tick(0, SafetyState::Nominal, Mode::Flying)),
    );
    let ticks = collector.take().ticks;
    assert_eq!((ticks[0][column("x")], ticks[0][column("position")]), (1.0, 1.0));
    assert_eq!(ticks[0][column("truth")], 0.0);
}

#[test]
fn changes_faults_and_requests_are_events() {
    let mut config = Config::default();
    config.fault.inject = vec!["pose:off@1+1".parse().unwrap()];
    let mut collector = Collector::new(&config);
    let reception = Reception::default();
    collector.sample(&reception, Sample::Telemetry(&tick(0, SafetyState::Nominal, Mode::Disarmed)));
    collector.sample(&reception, Sample::Telemetry(&tick(100, SafetyState::Nominal, Mode::Flying)));
    collector.sample(&reception, Sample::Telemetry(&tick(1110, SafetyState::Coast, Mode::Flying)));
    collector.lost(ObservedTopic::Pose, 3);
    let events = collector.take().events;
    let texts: Vec<&str> = events.iter().map(|event| event.text.as_str()).collect();
    assert!(texts[0].starts_with("3 samples of `pose`"), "{texts:?}");
    assert_eq!(texts[1], "Nominal");
    assert!(texts[2].starts_with("fault pose:off") && texts[2].ends_with("begins"), "{texts:?}");
    assert_eq!((texts[3], events[3].mood), ("Coast: no pose", EventMood::Warning));
}

#[test]
fn time_counts_from_the_first_tick_of_a_file_that_begins_in_flight() {
    let armed_at_s = |modes: &[Mode]| {
        let mut collector = Collector::new(&Config::default());
        for (mode, millis) in modes.iter().zip((0..).step_by(1000)) {
            let tick = tick(millis, SafetyState::Nominal, *mode);
            collector.sample(&Reception::default(), Sample::Telemetry(&tick));
        }
        collector.finish();
        collector.armed_at_s()
    };
    use Mode::{Disarmed, Flying};
    assert_eq!(armed_at_s(&[Disarmed, Flying, Disarmed, Flying]), Some(1.0));
    assert_eq!(armed_at_s(&[Flying, Disarmed, Flying]), None);
}

#[test]
fn every_event_of_a_recording_is_collected_and_further_ones_of_an_instance_are_counted() {
    let config = Config::default();
    let collected = |mut collector: Collector| {
        (0..=MOST_EVENTS).for_each(|_| collector.lost(ObservedTopic::Pose, 1));
        collector.take().events
    };
    assert_eq!(collected(Collector::of_recording(&config)).len(), MOST_EVENTS + 1);
    let live = collected(Collector::new(&config));
    assert!(live.len() == MOST_EVENTS + 1 && live[MOST_EVENTS].text.contains("1 more"));
}
