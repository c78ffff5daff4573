//! Gains found for a vehicle in flight, beside those of a search that knows the vehicle.
//! OQTAL_TEST_LIVE_TUNINGS sets the number of vehicles, OQTAL_TEST_LIVE_FIRST the first of them, OQTAL_TEST_LIVE_BUDGET the number
//! of points of each search.

use oqtal_config::{Config, Setting};
use oqtal_control::controller::ControllerName;
use oqtal_control::statistics::quantile;
use oqtal_lab::mission::Mission;
use oqtal_lab::progress::Progress;
use oqtal_lab::simulation;
use oqtal_lab::study::flights::{Run, Test};
use oqtal_lab::study::law::StudyLaw;
use oqtal_lab::study::metric::{HOVER, METRICS, POSITION};
use oqtal_lab::study::{Case, Study};
use oqtal_lab::tune::live;
use oqtal_lab::tune::search::{self, Budget, TrainingFlights};
use oqtal_observe::flight::{Flight, Outcome};

/// Seeds of the flights on which gains are compared, which no search used.
const COMPARED: std::ops::Range<u64> = 701..705;
/// Laws of the study, in turn.
const LAWS: [ControllerName; 3] =
    [ControllerName::Oqtal, ControllerName::OqtalDt, ControllerName::Pid];

/// A vehicle with 15 to 25 % more mass and 75 to 85 % of the rates, that its daemon does not know.
fn vehicle(seed: u64, law: ControllerName) -> Vec<Setting> {
    let share = |k: u64| ((seed * 7919 + k * 104_729) % 1000) as f64 / 1000.0;
    let shipped = Config::default().vehicle;
    let mass_kg = shipped.mass_kg * (1.15 + 0.1 * share(1));
    let rates = shipped.rate_authority_rad_s.map(|rate| rate * (0.75 + 0.1 * share(2)));
    vec![
        Setting::flag("test", "control.controller", law.name()),
        Setting::flag("test", "plant.mass-kg", mass_kg),
        Setting::flag("test", "plant.rate-authority-rad-s", rates.to_vec()),
        Setting::flag("test", "trajectory.kind", "circle"),
    ]
}

/// Hover error \[mm\] and error on the circle \[m\] of `law` on the vehicle, with each set of gains.
fn errors(
    law: ControllerName,
    vehicle: &[Setting],
    gains: [Vec<Setting>; 2],
    progress: &Progress,
) -> [[f64; 2]; 2] {
    let laws = gains.map(|gains| StudyLaw::new(law.name(), [vehicle, &gains].concat(), ""));
    let case = Case::of_seeds("", COMPARED).flown_as(&[Test::Path, Test::Hover]);
    let study = Study { name: "comparison", laws: &laws, cases: &[case] };
    let flown = study.fly_without_bar(progress).unwrap();
    assert!(flown.iter().all(|flown| flown.runs.iter().all(Run::all_as_planned)), "{flown:?}");
    [0, 1].map(|k| {
        let means = flown[k].mean();
        [means[HOVER], means[POSITION]]
    })
}

/// Excitation of the vehicle, which lands as planned.
fn excitation(seed: u64, vehicle: &[Setting]) -> Flight {
    let excitation = [
        Setting::flag("test", "trajectory.kind", "brief-excitation"),
        Setting::flag("test", "clock.seed", seed as i64),
    ];
    let config = Config::from_settings(&[vehicle, &excitation].concat()).unwrap();
    let flight = simulation::fly(&Mission::new(config).unwrap()).unwrap();
    assert_eq!(flight.outcome, Outcome::Landed, "{seed}: {:?}", flight.cause());
    assert!(flight.shortfall().is_none(), "{seed}: {:?}", flight.shortfall());
    flight
}

/// Limit of the integral for a vehicle that is known.
fn known_limit(vehicle: &[Setting]) -> Vec<(String, f64)> {
    let config = Config::from_settings(vehicle).unwrap();
    let thrust_m_s2 = config.plant.max_thrust_n / config.plant.mass_kg;
    live::integral_limit(&config, thrust_m_s2).into_iter().collect()
}

#[test]
fn gains_of_an_unknown_vehicle_found_in_flight_are_as_good_as_those_of_a_known_one() {
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse::<u64>().unwrap());
    let count = number("OQTAL_TEST_LIVE_TUNINGS").unwrap_or(1);
    let first = number("OQTAL_TEST_LIVE_FIRST").unwrap_or(1);
    let points = number("OQTAL_TEST_LIVE_BUDGET").unwrap_or(24) as usize;
    let budget = Budget { points, optimiser: live::OPTIMISER, ..Budget::default() };
    let progress = Progress::default();
    // Only the figures that are compared have a weight.
    let mut weights = [0.0; METRICS];
    (weights[HOVER], weights[POSITION]) = (1.0, 1.0);
    let mut ratios: [Vec<f64>; 2] = [Vec::new(), Vec::new()];
    for seed in first..first + count {
        let law = LAWS[(seed - 1) as usize % LAWS.len()];
        let vehicle = vehicle(seed, law);
        let flight = excitation(seed, &vehicle);
        // Settings of the daemon.
        let present = [vehicle[0].clone(), vehicle[3].clone()];
        let found = live::identified(&flight, &present).unwrap();
        let live = live::tune(found, &present, (&budget, weights, ""), &progress).unwrap().tuned;
        let known = TrainingFlights {
            computed: known_limit(&vehicle),
            weights,
            ..live::training_flights(vehicle.clone())
        };
        let known = search::law(law, &budget, &known, &progress).unwrap();
        assert!(live.objective.is_finite() && live.objective <= live.start, "{live}");
        let [live, known] = errors(law, &vehicle, [live.settings(), known.settings()], &progress);
        println!("{seed} {}: {live:?} live, {known:?} known", law.name());
        for (ratios, (live, known)) in ratios.iter_mut().zip(live.iter().zip(known)) {
            ratios.push(live / known);
        }
    }
    for (name, ratios) in ["hover", "circle"].into_iter().zip(ratios) {
        let [median, p95, worst] =
            [0.5, 0.95, 1.0].map(|share| quantile(ratios.clone(), share).unwrap());
        println!(
            "{name}: error in flight over error of the known vehicle: median {median:.3}, p95 {p95:.3}, worst {worst:.3}"
        );
        assert!(worst < 1.05, "{name}: {ratios:?}");
    }
}
