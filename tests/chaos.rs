//! Chaos in virtual time: seeded flights with random laws, vehicles, wind, batteries, cameras and faults must satisfy the
//! invariants. OQTAL_TEST_CHAOS_FLIGHTS sets the number of flights, OQTAL_TEST_CHAOS_SEED the first seed.

mod draw;
mod invariants;

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::common::random::length;
use oqtal_bus::time::Span;
use oqtal_config::{Config, Setting};
use oqtal_control::controller::ControllerName;
use oqtal_lab::mission::Mission;
use oqtal_lab::simulation::{fly, fly_past_the_end};
use oqtal_observe::flight::{Flight, Outcome};

/// Time for which a flight is observed after its end.
const AFTERMATH: Span = Span::from_millis(1500);

pub fn mission(settings: &[String]) -> Mission {
    let settings: Vec<Setting> =
        settings.iter().map(|text| Setting::parse("--set", text).unwrap()).collect();
    Mission::new(Config::from_settings(&settings).unwrap()).unwrap()
}

/// Command line that repeats the flight with these settings.
fn command(settings: &[String]) -> String {
    let flags: Vec<String> = settings.iter().map(|text| format!("--set '{text}'")).collect();
    format!("oqtal fly --clock in-process {}", flags.join(" "))
}

/// Calls `work` with 0 to `count`, on all processors.
pub fn on_all_processors(count: u64, work: impl Fn(u64) + Sync) {
    let next = AtomicU64::new(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count {
                        return;
                    }
                    work(index);
                }
            });
        }
    });
}

/// Outcomes, safety states and faults of the flights of each law.
#[derive(Default)]
struct Tally(BTreeMap<&'static str, BTreeMap<String, u32>>);

/// Least share of the flights of each kind, so that a study whose flights never begin, or never fail, does not pass.
const LEAST: [(&str, f64); 7] = [
    ("landed", 0.15),
    ("stopped", 0.15),
    ("Coast", 0.15),
    ("Degraded", 0.1),
    ("Land", 0.05),
    ("faults", 0.5),
    ("polygon", 0.15),
];
/// Number of flights above which the shares are checked.
const LEAST_FLIGHTS: u64 = 40;

impl Tally {
    fn add(&mut self, law: &str, flight: &Flight) {
        let law = ControllerName::NAMES.into_iter().find(|name| *name == law).unwrap();
        let counts = self.0.entry(law).or_default();
        *counts.entry(flight.outcome.to_string()).or_default() += 1;
        for state in invariants::states_of(flight) {
            *counts.entry(state).or_default() += 1;
        }
        *counts.entry("faults".to_owned()).or_default() += invariants::faults_in_the_air(flight);
        let is_polygon = !flight.config.fence.polygon_m.is_empty();
        *counts.entry("polygon".to_owned()).or_default() += u32::from(is_polygon);
    }

    /// Fails if a share in `flights` flights is less than in [`LEAST`].
    fn assert_enough(&self, flights: u64) {
        for (name, share) in LEAST {
            let count: u32 = self.0.values().filter_map(|counts| counts.get(name)).sum();
            let least = share * flights as f64;
            assert!(f64::from(count) >= least, "{name}: {count} in {flights} flights");
        }
    }

    fn print(&self) {
        let columns: Vec<&String> = self.0.values().flat_map(BTreeMap::keys).collect();
        let columns = columns.into_iter().collect::<std::collections::BTreeSet<_>>();
        println!(
            "{:<10} {}",
            "law",
            columns.iter().map(|c| format!("{c:>10}")).collect::<String>()
        );
        for (law, counts) in &self.0 {
            let cell = |column: &&String| format!("{:>10}", counts.get(*column).unwrap_or(&0));
            println!("{law:<10} {}", columns.iter().map(cell).collect::<String>());
        }
    }
}

#[test]
fn no_failure_makes_a_flight_leave_the_fence_stay_powered_when_tipped_or_command_nonsense() {
    let (count, first) =
        (length("OQTAL_TEST_CHAOS_FLIGHTS", 40), length("OQTAL_TEST_CHAOS_SEED", 1));
    let (tally, violations) = (Mutex::new(Tally::default()), Mutex::new(Vec::new()));
    on_all_processors(count, |index| {
        let settings = draw::flight(first + index);
        let mission = mission(&settings);
        let flight = fly_past_the_end(&mission, AFTERMATH).unwrap();
        let law = mission.config.control.controller.name();
        tally.lock().unwrap().add(law, &flight);
        for violation in invariants::violations(&flight) {
            let text = format!("{violation} ({})\n    {}", flight.outcome, command(&settings));
            violations.lock().unwrap().push(text);
        }
    });
    let tally = tally.into_inner().unwrap();
    tally.print();
    let violations = violations.into_inner().unwrap();
    assert!(violations.is_empty(), "{}:\n  {}", violations.len(), violations.join("\n  "));
    if count >= LEAST_FLIGHTS {
        tally.assert_enough(count);
    }
}

/// Cameras in the study of outliers: a preset, or quantisation to 1 mm and 0.5 deg without noise.
const CAMERAS: [&[&str]; 3] = [
    &["mocap.preset=ideal"],
    &["mocap.preset=measured"],
    &["mocap.preset=ideal", "mocap.position-quantum-mm=1.0", "mocap.attitude-quantum-deg=0.5"],
];

#[test]
fn every_law_lands_the_square_through_outliers() {
    let seeds = length("OQTAL_TEST_OUTLIER_SEEDS", 1);
    let mut flights = Vec::new();
    for seed in 1..=seeds {
        for law in ControllerName::NAMES {
            for cameras in CAMERAS {
                for (distance, share) in draw::outliers(seed) {
                    let mut settings: Vec<String> =
                        cameras.iter().map(|&text| text.to_owned()).collect();
                    settings.push(format!("control.controller={law}"));
                    settings.push(format!("clock.seed={seed}"));
                    settings.push(format!("mocap.outlier-m={distance}"));
                    settings.push(format!("mocap.outlier-probability={share}"));
                    flights.push(settings);
                }
            }
        }
    }
    let lost = Mutex::new(Vec::new());
    on_all_processors(flights.len() as u64, |index| {
        let settings = &flights[index as usize];
        let outcome = fly(&mission(settings)).unwrap().outcome;
        if outcome != Outcome::Landed {
            lost.lock().unwrap().push(format!("{outcome}: {}", command(settings)));
        }
    });
    let lost = lost.into_inner().unwrap();
    println!("{} flights through outliers, {} lost", flights.len(), lost.len());
    assert!(lost.is_empty(), "{} of {}:\n  {}", lost.len(), flights.len(), lost.join("\n  "));
}
