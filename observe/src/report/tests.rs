//! Tests of the report, and flights used by these and other tests.

pub mod fixture;

use oqtal_bus::code::{Mode, SafetyState};
use oqtal_bus::message::{Stamps, TelemetryV1, TruthV1};
use oqtal_bus::time::Time;
use proptest::prelude::*;

use super::*;
use crate::flight::{AppliedCommand, FlightSample};
use crate::latency::OnwardTime;

fn page(flight: &Flight) -> String {
    html(flight, &Summary::of(flight))
}

#[test]
fn a_flight_has_every_section_and_needs_nothing_else() {
    let page = page(&fixture::square());
    for section in
        ["Path", "Position", "Attitude", "Velocity", "Command", "Latency", "Events", "Settings"]
    {
        assert!(page.contains(&format!("<h2>{section}</h2>")), "{section}");
    }
    let elsewhere = page.replace("http://www.w3.org/2000/svg", "");
    assert_eq!(page.matches("<script>").count(), 1, "the page's own, which it can do without");
    for reference in ["http:", "https:", "url(", "src=", "<script ", "<link", "fetch("] {
        assert!(!elsewhere.contains(reference), "{reference}");
    }
    assert!(page.contains("Coast: no pose"));
    // The figure of the card is one figure, its sentence is the detail below.
    let card = page.split("Overshoot at corners").nth(1).expect("the square has corners");
    assert!(card.chars().take(120).collect::<String>().contains(" mm"), "{}", &card[..120]);
}

#[test]
fn every_colour_of_a_plot_is_a_variable_of_the_style_sheet() {
    let page = page(&fixture::square());
    for property in ["stroke", "fill"] {
        assert!(!page.contains(&format!(" {property}=\"#")), "a colour without a dark counterpart");
        for rest in page.split(&format!("=\"{property}:")).skip(1) {
            let name = rest.strip_prefix("var(").and_then(|rest| rest.split(')').next()).unwrap();
            assert!(
                crate::plot::palette::css().contains(&format!("{name}:#")),
                "{property} {name}"
            );
        }
    }
}

#[test]
fn a_replay_shows_its_gaps_and_no_errors() {
    let page = page(&fixture::replay());
    assert!(page.contains("Arrival of poses") && page.contains("<th>Gaps over 50 ms</th><td>2, "));
    // The settings at the end of the page may contain keys with that word.
    let figures = page.split("Settings").next().unwrap();
    assert!(!figures.contains("error"));
}

#[test]
fn text_from_outside_is_escaped() {
    let mut flight = fixture::replay();
    flight.config.mocap.replay = "<script>alert(1)</script>".to_owned();
    assert!(!page(&flight).contains("<script>alert"));
}

#[test]
fn a_page_of_ten_minutes_stays_below_two_megabytes() {
    let mut flight = fixture::square();
    let short = flight.samples.clone();
    let length = short.last().unwrap().telemetry.time.since(short[0].telemetry.time);
    let rounds = 17;
    flight.samples = (0..rounds)
        .flat_map(|round| {
            short.iter().map(move |sample| {
                let mut sample = *sample;
                sample.telemetry.time = sample.telemetry.time + length.scaled(f64::from(round));
                sample
            })
        })
        .collect();
    let bytes = page(&flight).len();
    assert!(bytes < 2_000_000, "{bytes} bytes");
}

#[test]
fn a_default_flight_has_a_page_below_a_megabyte_with_its_events_in_every_plot() {
    let page = page(&fixture::square());
    assert!(page.len() < 1_000_000, "{} bytes", page.len());
    let plots =
        page.split("data-plot=").skip(1).filter(|plot| plot.contains("&quot;is_time&quot;:true"));
    for plot in plots {
        let svg = plot.split("</svg>").next().unwrap();
        assert_eq!(svg.matches("class=\"instant\"").count(), 2, "the loss of poses and its end");
    }
}

#[test]
fn instants_that_the_plots_do_not_mark_are_counted() {
    let mut flight = fixture::square();
    assert!(!page(&flight).contains("are not marked"));
    for sample in flight.samples.iter_mut().skip(100).step_by(20).take(40) {
        sample.telemetry.state = SafetyState::Degraded.code();
    }
    let changes = Timeline::new(&flight).unmarked + 40;
    assert_eq!(changes, 2 * 40 + 2, "each state begins and ends, and poses are lost once");
    assert!(page(&flight).contains("42 later ones are not marked"));
}

#[test]
fn a_command_of_a_tick_with_the_motors_off_is_not_shown() {
    let attitude = |command| {
        let mut flight = fixture::square();
        for sample in flight.samples.iter_mut().rev().take(60) {
            sample.telemetry.mode = Mode::Disarmed.code();
            sample.telemetry.attitude_command = command;
        }
        motion::attitude(&Timeline::new(&flight)).into_string()
    };
    let half = 0.5_f64.sqrt();
    assert!(attitude([0.0, 0.0, half, half]) == attitude([0.0, 0.0, 0.0, 1.0]));
}

#[test]
fn an_empty_flight_has_a_page() {
    let mut flight = fixture::empty();
    assert!(page(&flight).contains("nothing was scored"));
    flight.config.mocap.replay = "recording.csv".to_owned();
    flight.config.safety.observe_only = true;
    assert!(page(&flight).contains("Arrival of poses"));
}

fn any_sample() -> impl Strategy<Value = FlightSample> {
    let numbers = || prop_oneof![Just(f64::NAN), Just(f64::INFINITY), -2.0..2.0, any::<f64>()];
    let four = || prop::array::uniform4(numbers());
    let codes = prop::array::uniform5(0_u8..6);
    (any::<u32>(), four(), four(), codes, any::<u64>()).prop_map(|(nanos, a, b, codes, count)| {
        let [mode, state, cause, phase, scored] = codes;
        let [x, y, z] = [a[0], b[0], a[1]];
        let telemetry = TelemetryV1 {
            time: Time::from_nanos(u64::from(nanos)),
            position: [x, y, z],
            velocity: [y, z, x],
            attitude: a,
            attitude_command: b,
            reference_position: [b[1], b[2], b[3]],
            thrust: z,
            poses_lost: count,
            mode,
            state,
            cause,
            phase,
            scored,
            ..TelemetryV1::default()
        };
        let truth = TruthV1 { position: [z, x, y], attitude: a, ..TruthV1::default() };
        FlightSample { telemetry, truth: (scored > 2).then_some(truth) }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_flight_has_a_page(
        samples in prop::collection::vec(any_sample(), 0..6),
        battery in any::<f64>(),
        is_replay in any::<bool>(),
    ) {
        let mut flight = fixture::empty();
        let applied = |sample: &FlightSample| AppliedCommand {
            sequence: 1,
            stamps: Stamps { applied_at: sample.telemetry.time, ..Stamps::default() },
            onward: OnwardTime::default(),
            battery_v: battery,
        };
        flight.applied = samples.iter().map(applied).collect();
        flight.samples = samples;
        if is_replay {
            flight.config.mocap.replay = "recording.csv".to_owned();
            flight.config.safety.observe_only = true;
        }
        prop_assert!(page(&flight).ends_with("</html>"));
    }
}
