//! Flights of the laws of `oqtal-rivals` beside `oqtal-dt` and `geometric`, on the same seeds.
//!
//! `OQTAL_TEST_RIVALS_SEEDS=4 cargo test -p oqtal-lab --test studies rivals:: -- --nocapture` prints the tables of docs/rivals.md;
//! `OQTAL_TEST_RIVALS_LAWS` names some of the laws, separated by commas.

use std::f64::consts::{SQRT_2, TAU};

use oqtal_bus::message::{ExternalV1, StateV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::statistics::{median, quantile};
use oqtal_daemon::{ExternalLaw, QuestionView};
use oqtal_lab::mission::Mission;
use oqtal_lab::rival::{Knowledge, RIVALS, RivalLaw, named};
use oqtal_lab::simulation::fly_with_law;
use oqtal_lab::study::metric::of_hover;
use oqtal_observe::flight::{Flight, Outcome};

use crate::{config, flown};

/// First seed: none of these was used to choose a gain.
const FIRST_SEED: u64 = 71_000;

/// Settings of every flight: a room in which the fast circle can be braked.
const ROOM: [&str; 2] = ["fence.x-m=[-9,9]", "fence.y-m=[-9,9]"];

/// Settings of flights of laws with the limits of `position`, and of laws under a fallback that has them.
const RAISED: [&str; 5] = [
    "position.tilt-limit-deg=45",
    "position.horizontal-velocity-limit-m-s=6",
    "envelope.tilt-deg=75",
    "envelope.rate-rad-s=12",
    "envelope.speed-m-s=8",
];

/// Delays from a command to its effect, in addition to those of cameras and loop.
const DELAYS: [(&str, &[&str]); 4] = [
    ("0 ms", &["vehicle.command-delay-ms=0"]),
    ("50 ms, told", &["vehicle.command-delay-ms=50"]),
    ("25 ms, not told", &["vehicle.command-delay-ms=0", "plant.hidden-delay-ms=25"]),
    ("50 ms, not told", &["vehicle.command-delay-ms=0", "plant.hidden-delay-ms=50"]),
];

/// Settings of the trajectories: a hover, a circle, and lemniscates of this half length \[m\] and greatest speed \[m/s\].
fn trajectories() -> Vec<(String, Vec<String>)> {
    let hover = ["trajectory.kind=hover", "trajectory.hover.duration-s=14"];
    let period_s = TAU * 3.0 / 3.8;
    let circle = format!("trajectory.circle.period-s={period_s}");
    let circle = ["trajectory.kind=circle", "trajectory.circle.radius-m=3", &circle];
    let mut all = vec![
        ("hover".to_owned(), hover.map(str::to_owned).to_vec()),
        ("circle 3.8 m/s".to_owned(), circle.map(str::to_owned).to_vec()),
    ];
    for [half_m, speed_m_s] in [[1.5, 1.6], [2.0, 2.5], [2.5, 3.5]] {
        let period_s = TAU * SQRT_2 * half_m / speed_m_s;
        let settings = [
            "trajectory.kind=lemniscate".to_owned(),
            format!("trajectory.lemniscate.half-length-m={half_m}"),
            format!("trajectory.lemniscate.period-s={period_s}"),
        ];
        all.push((format!("lemniscate {speed_m_s} m/s"), settings.to_vec()));
    }
    all
}

/// A law with the times that its commands took.
struct Timed {
    law: RivalLaw,
    taken: Vec<Span>,
}

impl ExternalLaw for Timed {
    fn reset(&mut self) {
        self.law.reset();
    }

    fn look(&mut self, view: &QuestionView) {
        let before = Time::now();
        self.law.look(view);
        self.taken.push(Time::now().since(before));
    }

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        self.law.answer(state)
    }
}

/// A flight of a law, and the times that its commands took.
fn flight_of(law: &str, knowledge: Option<Knowledge>, settings: &[String]) -> (Flight, Vec<Span>) {
    let with = |further: &[&str]| {
        let further = further.iter().map(|text| (*text).to_owned());
        config(&[settings.to_vec(), further.collect()].concat())
    };
    let Some(knowledge) = knowledge else {
        let raised: &[&str] = if law == "oqtal-dt" { &[] } else { &RAISED };
        let controller = format!("control.controller={law}");
        return (flown(with(&[raised, &[&controller]].concat())), Vec::new());
    };
    let adapts = match knowledge {
        Knowledge::Disturbances => "control.predictive.adaptation.adapt=true",
        Knowledge::Now | Knowledge::Effect => "control.predictive.adaptation.adapt=false",
    };
    let config: Config = with(&[&RAISED[..], &["control.controller=external", adapts]].concat());
    let mission = Mission::new(config).unwrap();
    let law = RivalLaw::new(named(law).unwrap(), knowledge, &mission.config);
    let mut timed = Timed { law, taken: Vec::new() };
    (fly_with_law(&mission, &mut timed).unwrap(), timed.taken)
}

/// RMS of the position error \[mm\]; `None` if the flight does not land as planned, or the fallback takes over.
fn error_mm(flight: &Flight) -> Option<f64> {
    let handovers = flight.samples.iter().map(|sample| sample.telemetry.handovers).max();
    let is_planned = flight.outcome == Outcome::Landed && flight.shortfall().is_none();
    (is_planned && handovers == Some(0)).then(|| of_hover(flight)[0])
}

/// The laws of a table: name, and knowledge of a rival.
fn laws() -> Vec<(&'static str, Option<Knowledge>)> {
    let rivals = RIVALS.iter().flat_map(|law| Knowledge::ALL.map(|it| (*law, Some(it))));
    [("oqtal-dt", None), ("geometric", None)].into_iter().chain(rivals).collect()
}

/// Cell of a table: median of the errors, with the number of flights that were lost.
fn cell(errors: &[Option<f64>]) -> String {
    let lost = errors.iter().filter(|error| error.is_none()).count();
    match (median(errors.iter().copied().flatten()), lost) {
        (None, _) => format!("{lost} lost"),
        (Some(median), 0) => format!("{median:.1}"),
        (Some(median), _) => format!("{median:.1}, {lost} lost"),
    }
}

/// Flies every trajectory of one delay, and returns the cells of a row.
fn row(
    (law, knowledge): (&str, Option<Knowledge>),
    delay: &[&str],
    seeds: u64,
    taken: &mut Vec<Span>,
) -> Vec<String> {
    let mut cells = Vec::new();
    for (_, trajectory) in trajectories() {
        let errors = (0..seeds).map(|seed| {
            let seed = format!("clock.seed={}", FIRST_SEED + seed);
            let fixed = ROOM.iter().chain(delay).copied().chain([seed.as_str()]);
            let settings: Vec<String> =
                fixed.map(str::to_owned).chain(trajectory.iter().cloned()).collect();
            let (flight, times) = flight_of(law, knowledge, &settings);
            taken.extend(times);
            error_mm(&flight)
        });
        cells.push(cell(&errors.collect::<Vec<_>>()));
    }
    cells
}

#[test]
fn rivals_of_the_literature_beside_the_laws_of_the_daemon() {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let Some(seeds): Option<u64> = number("OQTAL_TEST_RIVALS_SEEDS") else { return };
    let asked = std::env::var("OQTAL_TEST_RIVALS_LAWS").ok();
    let is_asked = |law: &str| asked.as_ref().is_none_or(|all| all.split(',').any(|it| it == law));
    let names: Vec<String> = trajectories().into_iter().map(|(name, _)| name).collect();
    for (delay, settings) in DELAYS {
        println!("\n{delay}\n\n| law | {} |", names.join(" | "));
        println!("|---{}|", "|---".repeat(names.len()));
        for (law, knowledge) in laws().into_iter().filter(|(law, _)| is_asked(law)) {
            let mut taken = Vec::new();
            let cells = row((law, knowledge), settings, seeds, &mut taken);
            let what = knowledge.map_or(String::new(), |it| format!(", {}", it.name()));
            println!("| `{law}`{what} | {} |", cells.join(" | "));
            let taken_us = || taken.iter().map(|span| 1e6 * span.seconds());
            let [p50, p99, worst] = [0.5, 0.99, 1.0].map(|share| quantile(taken_us(), share));
            if let (Some(p50), Some(p99), Some(worst)) = (p50, p99, worst) {
                eprintln!("    step: p50 {p50:.0} us, p99 {p99:.0} us, worst {worst:.0} us");
            }
        }
    }
}

#[test]
fn each_law_of_the_literature_hovers_without_its_fallback() {
    for law in RIVALS {
        let settings =
            ["trajectory.kind=hover", "trajectory.hover.duration-s=8", "clock.seed=7"].map(str::to_owned);
        let (flight, _) = flight_of(law, Some(Knowledge::Disturbances), &settings);
        let error_mm = error_mm(&flight);
        assert!(error_mm.is_some_and(|error| error < 8.0), "{law}: {error_mm:?}");
    }
}
