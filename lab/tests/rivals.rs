//! Flights of the laws of `oqtal-rivals` beside `oqtal-dt` and `geometric`, on the same seeds.
//!
//! `OQTAL_TEST_RIVALS_SEEDS=4 cargo test -p oqtal-lab --test studies rivals:: -- --nocapture` prints the tables of docs/rivals.md;
//! `OQTAL_TEST_RIVALS_LAWS` has ends of the names of some laws, separated by semicolons.

use std::f64::consts::{SQRT_2, TAU};

use oqtal_bus::message::{ExternalV1, StateV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::statistics::{median, quantile};
use oqtal_daemon::{ExternalLaw, QuestionView};
use oqtal_lab::mission::Mission;
use oqtal_lab::rival::{Knowledge, RivalLaw, RivalName};
use oqtal_lab::simulation::fly_with_law;
use oqtal_lab::study::metric::of_hover;
use oqtal_lab::tune::optimiser::Optimiser;
use oqtal_observe::flight::{Flight, Outcome};

use crate::{config, flown};

/// First seed: none of these was used to choose a gain.
const FIRST_SEED: u64 = 71_000;

/// Settings of every flight: a room in which the fast circle can be braked.
const ROOM: [&str; 2] = ["fence.x-m=[-15,15]", "fence.y-m=[-15,15]"];

/// Settings of flights of laws with the limits of `position`, and of laws under a fallback that has them.
const RAISED: [&str; 5] = [
    "position.tilt-limit-deg=45",
    "position.horizontal-velocity-limit-m-s=6",
    "envelope.tilt-deg=75",
    "envelope.rate-rad-s=12",
    "envelope.speed-m-s=8",
];

/// Delays from a command to its effect, in addition to those of cameras and loop.
const DELAYS: [(&str, &[&str]); 5] = [
    ("0 ms", &["vehicle.command-delay-ms=0"]),
    ("50 ms, told", &["vehicle.command-delay-ms=50"]),
    ("25 ms, not told", &["vehicle.command-delay-ms=0", "plant.hidden-delay-ms=25"]),
    ("50 ms, not told", &["vehicle.command-delay-ms=0", "plant.hidden-delay-ms=50"]),
    (
        "20 ms, told; plants that differ by up to 20 %",
        &["plant.spread=0.2", "position.velocity-integral-limit-m-s2=4"],
    ),
];

/// Gains of `oqtal-dt` that the search finds: key, range and result.
const OURS: [(&str, [f64; 2], f64); 7] = [
    ("control.oqtal-dt.attitude-weight", [100.0, 1e5], 1246.853),
    ("control.oqtal-dt.rate-weight", [1e-3, 10.0], 0.046),
    ("control.predictive.position-gain-per-s", [0.3, 10.0], 3.637),
    ("control.predictive.vertical-position-gain-per-s", [0.3, 10.0], 1.742),
    ("control.predictive.velocity-gain-per-s", [2.0, 30.0], 11.262),
    ("control.predictive.vertical-velocity-gain-per-s", [2.0, 30.0], 8.193),
    ("control.predictive.command-bandwidth-rad-s", [4.0, 60.0], 39.096),
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

/// A flight of a law of the daemon.
fn built_in(law: &str, settings: &[String]) -> Flight {
    let raised: &[&str] = if law == "oqtal-dt" { &[] } else { &RAISED };
    let controller = format!("control.controller={law}");
    flown(with(settings, &[raised, &[&controller]].concat()))
}

/// The configuration with `settings` and `further` ones.
fn with(settings: &[String], further: &[&str]) -> Config {
    let further = further.iter().map(|text| (*text).to_owned());
    config(&[settings.to_vec(), further.collect()].concat())
}

/// A flight of a law of the literature with these gains, and the times that its commands took.
fn flight_of(
    (law, knowledge, gains): (RivalName, Knowledge, &[f64]),
    settings: &[String],
) -> (Flight, Vec<Span>) {
    let adapts = match knowledge {
        Knowledge::Disturbances => "control.predictive.adaptation.adapt=true",
        Knowledge::Now | Knowledge::Effect => "control.predictive.adaptation.adapt=false",
    };
    let further = [&RAISED[..], &["control.controller=external", adapts]].concat();
    let mission = Mission::new(with(settings, &further)).unwrap();
    let law = RivalLaw::new(law.with_gains(gains), knowledge, &mission.config);
    let mut timed = Timed { law, taken: Vec::new() };
    (fly_with_law(&mission, &mut timed).unwrap(), timed.taken)
}

/// RMS of the position error \[mm\]; `None` if the flight does not land as planned, or the fallback takes over.
fn error_mm(flight: &Flight) -> Option<f64> {
    let handovers = flight.samples.iter().map(|sample| sample.telemetry.handovers).max();
    let is_planned = flight.outcome == Outcome::Landed && flight.shortfall().is_none();
    (is_planned && handovers == Some(0)).then(|| of_hover(flight)[0])
}

/// A law of a table.
#[derive(Clone, Copy)]
enum Entry {
    BuiltIn(&'static str),
    /// `oqtal-dt` with the gains of the search.
    Found,
    Rival(RivalName, Knowledge),
}

impl Entry {
    /// The laws of a table.
    fn all() -> Vec<Self> {
        let of = |law| Knowledge::ALL.map(|knowledge| Self::Rival(law, knowledge));
        let [ours, other] = ["oqtal-dt", "geometric"].map(Self::BuiltIn);
        let built_in = [ours, Self::Found, other];
        built_in.into_iter().chain(RivalName::ALL.into_iter().flat_map(of)).collect()
    }

    fn name(self) -> String {
        match self {
            Self::BuiltIn(law) => format!("`{law}`"),
            Self::Found => "`oqtal-dt`, gains of the search".to_owned(),
            Self::Rival(law, knowledge) => format!("`{}`, {}", law.name(), knowledge.name()),
        }
    }

    /// Whether `OQTAL_TEST_RIVALS_LAWS` is not set, or has an end of the name.
    fn is_asked(&self) -> bool {
        let asked = std::env::var("OQTAL_TEST_RIVALS_LAWS").ok();
        asked.is_none_or(|all| all.split(';').any(|it| self.name().ends_with(it)))
    }

    /// Ranges of the gains in the search.
    fn ranges(self) -> Vec<[f64; 2]> {
        match self {
            Self::BuiltIn(_) => Vec::new(),
            Self::Found => OURS.map(|(_, range, _)| range).to_vec(),
            Self::Rival(law, _) => law.ranges().to_vec(),
        }
    }

    /// Sets of gains at which the search begins, its last results; the first is flown in the tables.
    fn gains(self) -> Vec<Vec<f64>> {
        match self {
            Self::BuiltIn(_) => vec![Vec::new()],
            Self::Found => vec![OURS.map(|(_, _, gain)| gain).to_vec()],
            Self::Rival(law, own) => {
                let others = Knowledge::ALL.into_iter().filter(|other| *other != own);
                [own].into_iter().chain(others).map(|it| law.gains(it).to_vec()).collect()
            }
        }
    }

    fn fly(self, gains: &[f64], settings: &[String]) -> (Flight, Vec<Span>) {
        match self {
            Self::BuiltIn(law) => (built_in(law, settings), Vec::new()),
            Self::Found => {
                let own = OURS.iter().zip(gains).map(|((key, ..), gain)| format!("{key}={gain}"));
                let settings: Vec<String> = settings.iter().cloned().chain(own).collect();
                (built_in("oqtal-dt", &settings), Vec::new())
            }
            Self::Rival(law, knowledge) => flight_of((law, knowledge, gains), settings),
        }
    }
}

/// Cell of a table: median of the errors, with the number of flights that ended early.
fn cell(errors: &[Option<f64>]) -> String {
    let early = errors.iter().filter(|error| error.is_none()).count();
    match (median(errors.iter().copied().flatten()), early) {
        (None, _) => format!("{early} ended early"),
        (Some(median), 0) => format!("{median:.1}"),
        (Some(median), _) => format!("{median:.1}, {early} ended early"),
    }
}

/// Flies every trajectory of one delay, and returns the cells of a row.
fn row(law: Entry, delay: &[&str], seeds: u64, taken: &mut Vec<Span>) -> Vec<String> {
    let mut cells = Vec::new();
    for (_, trajectory) in trajectories() {
        let errors = (0..seeds).map(|seed| {
            let seed = format!("clock.seed={}", FIRST_SEED + seed);
            let fixed = ROOM.iter().chain(delay).copied().chain([seed.as_str()]);
            let settings: Vec<String> =
                fixed.map(str::to_owned).chain(trajectory.iter().cloned()).collect();
            let (flight, times) = law.fly(&law.gains()[0], &settings);
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
    let names: Vec<String> = trajectories().into_iter().map(|(name, _)| name).collect();
    for (delay, settings) in DELAYS {
        println!("\n{delay}\n\n| law | {} |", names.join(" | "));
        println!("|---{}|", "|---".repeat(names.len()));
        for law in Entry::all().into_iter().filter(|law| law.is_asked()) {
            let mut taken = Vec::new();
            let cells = row(law, settings, seeds, &mut taken);
            println!("| {} | {} |", law.name(), cells.join(" | "));
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
    for law in RivalName::ALL {
        let settings = ["trajectory.kind=hover", "trajectory.hover.duration-s=8", "clock.seed=7"]
            .map(str::to_owned);
        let entry = Entry::Rival(law, Knowledge::Disturbances);
        let (flight, _) = entry.fly(&entry.gains()[0], &settings);
        let error_mm = error_mm(&flight);
        assert!(error_mm.is_some_and(|error| error < 8.0), "{law:?}: {error_mm:?}");
    }
}

/// Trajectories and delays of a search, with seeds of their own: indices of [`trajectories`] and of [`DELAYS`].
const TRAINING: [[usize; 2]; 8] = [[0, 0], [1, 0], [4, 0], [0, 1], [4, 1], [0, 3], [3, 3], [4, 4]];

/// Error counted for a flight that is lost \[mm\].
const LOST_MM: f64 = 1000.0;

/// `OQTAL_TEST_RIVALS_TUNE=100` searches the gains of docs/rivals.md with that many sets each, by the optimiser of `oqtal tune`. The objective is
/// the mean logarithm of the error.
#[test]
fn gains_of_the_rivals_are_found_by_the_optimiser_of_the_other_laws() {
    let budget = std::env::var("OQTAL_TEST_RIVALS_TUNE").ok().and_then(|text| text.parse().ok());
    let Some(budget): Option<usize> = budget else { return };
    for entry in Entry::all().into_iter().filter(|entry| entry.is_asked()) {
        let ln = |values: &[f64]| values.iter().map(|value| value.ln()).collect::<Vec<_>>();
        let ranges = entry.ranges();
        let bounds: Vec<_> = ranges.iter().map(|[low, high]| low.ln()..=high.ln()).collect();
        if bounds.is_empty() {
            continue;
        }
        let objective = |point: &Vec<f64>| {
            let gains: Vec<f64> = point.iter().map(|value| value.exp()).collect();
            let errors = TRAINING.iter().enumerate().map(|(index, [trajectory, delay])| {
                let seed = format!("clock.seed={}", 301 + index);
                let fixed = ROOM.iter().chain(DELAYS[*delay].1).copied().chain([seed.as_str()]);
                let own = trajectories()[*trajectory].1.clone();
                let settings: Vec<String> = fixed.map(str::to_owned).chain(own).collect();
                let (flight, _) = entry.fly(&gains, &settings);
                error_mm(&flight).unwrap_or(LOST_MM).min(LOST_MM).ln()
            });
            errors.sum::<f64>() / TRAINING.len() as f64
        };
        let starts: Vec<_> = entry.gains().iter().map(|gains| ln(gains)).collect();
        let found = Optimiser::CmaEs.minimise(&bounds, &starts, (budget, 1), |points| {
            points.iter().map(objective).collect()
        });
        let gains: Vec<String> =
            found.point.iter().map(|value| format!("{:.3}", value.exp())).collect();
        println!("{}: {:.2} mm, [{}]", entry.name(), found.value.exp(), gains.join(", "));
    }
}
