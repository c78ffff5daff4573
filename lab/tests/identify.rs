//! Identification of vehicles that differ from the configured one, and parameters that flights do not determine.

use nalgebra::Vector3;
use oqtal_bus::time::Time;
use oqtal_config::{Config, Setting};
use oqtal_control::predictive::{
    Bias, CommandHistory, Integration, ModelInput, Motion, Rotation, VehicleModel,
};
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_lab::identify::command::check_distinct;
use oqtal_lab::identify::data::{CommandRecord, FlightData, PoseRecord};
use oqtal_lab::identify::excitation_flight;
use oqtal_lab::identify::finding::rules;
use oqtal_lab::identify::hidden_plants::{self, HiddenParameter, HiddenPlants};
use oqtal_lab::identify::identification::{Identification, Scale, identify};
use oqtal_lab::identify::noise::Innovations;
use oqtal_lab::identify::overview;
use oqtal_lab::identify::rotation::{self, RotationModel, RotationNoise};
use oqtal_lab::identify::translation::{self, TranslationModel, TranslationNoise};
use oqtal_lab::identify::vehicle_toml;
use oqtal_observe::flight::Flight;

use crate::{config, flown};

/// Longest flight \[s\].
const LONGEST_S: f64 = 60.0;

fn identified(flight: &Flight) -> Identification {
    let data = [FlightData::of(flight)];
    identify(&data, &flight.config.vehicle, Scale::Unknown).unwrap()
}

/// The excitation flight with these settings.
fn excited(settings: &[impl AsRef<str>]) -> Flight {
    excitation_flight::fly(&config(settings)).unwrap().flight
}

fn armed_s(flight: &Flight) -> f64 {
    let mut times = flight.armed().map(|sample| sample.telemetry.time);
    let first = times.next().unwrap();
    times.last().unwrap().since(first).seconds()
}

/// Greatest error of a parameter, in its unit.
fn bound(parameter: &HiddenParameter) -> f64 {
    if parameter.name == rules::DRAG.name { 20.0 } else { 3.0 }
}

/// One vehicle in two laboratories, or as many as `OQTAL_HIDDEN_PLANTS` in all of them; prints their tables.
#[test]
fn hidden_vehicles_are_identified_within_their_bounds() {
    let count = std::env::var("OQTAL_HIDDEN_PLANTS").ok().map(|text| text.parse().unwrap());
    let all = HiddenPlants::LABORATORIES;
    let laboratories = if count.is_some() { all.to_vec() } else { vec![all[0], all[3]] };
    let study = hidden_plants::study(&[], 1..count.unwrap_or(1) + 1, &laboratories).unwrap();
    println!("{}", study.to_markdown());
    for room in study.rooms {
        let flown: Vec<&Vec<HiddenParameter>> =
            room.plants.iter().map(|plant| &plant.parameters).filter(|p| !p.is_empty()).collect();
        assert!(10 * flown.len() >= 9 * room.plants.len(), "{:?}", room.laboratory);
        for (index, parameter) in flown[0].iter().enumerate() {
            let mut errors: Vec<f64> = flown.iter().map(|p| p[index].error.abs()).collect();
            errors.sort_by(f64::total_cmp);
            let median = errors[errors.len() / 2];
            assert!(median <= bound(parameter), "{:?}: {parameter:?}, {median}", room.laboratory);
            // Two half widths are four standard deviations.
            let is_lost = |found: &&&Vec<HiddenParameter>| {
                found[index].error.abs() > 2.0 * found[index].half_width
            };
            let lost = flown.iter().filter(is_lost).count();
            assert!(20 * lost <= flown.len(), "{:?}: {parameter:?}, {lost}", room.laboratory);
        }
    }
}

/// With noise-free cameras, residuals are rounding errors; a command without delay leaves no room for a second lag.
#[test]
fn cameras_without_noise_and_commands_without_delay_are_identified() {
    for (setting, delay_ms) in [("mocap.preset=ideal", 20.0), ("plant.command-delay-ms=0", 0.0)] {
        let found = identified(&excited(&[setting]));
        let of = |name| found.findings.iter().find(|finding| finding.name == name).unwrap();
        let (delay, thrust) = (of(rules::DELAY.name), of(rules::THRUST_PER_MASS.name));
        assert!(delay.is_shown() && (delay.value - delay_ms).abs() < 0.5, "{delay:?}");
        assert!(thrust.is_shown() && (thrust.value - 40.0).abs() < 0.4, "{thrust:?}");
    }
}

#[test]
fn neither_truth_nor_plant_nor_instants_of_effect_reach_the_estimator() {
    let config = hidden_plants::config(&[], HiddenPlants::LABORATORIES[0], 2).unwrap();
    let flight = excitation_flight::fly(&config).unwrap().flight;
    assert!(armed_s(&flight) <= LONGEST_S, "{}", armed_s(&flight));
    let mut blind = flight.clone();
    blind.samples.iter_mut().for_each(|sample| sample.truth = None);
    blind.applied.iter_mut().for_each(|applied| applied.stamps.applied_at = Time::UNSET);
    blind.config.plant = Config::default().plant;
    let [seeing, blind] = [identified(&flight), identified(&blind)];
    let values = |identification: &Identification| {
        let hidden = |name| name == rules::HIDDEN_DELAY.name;
        let own = identification.findings.iter().filter(|finding| !hidden(finding.name));
        own.map(|finding| (finding.name, finding.value, finding.half_width)).collect::<Vec<_>>()
    };
    assert_eq!(values(&seeing), values(&blind));
    assert_eq!(seeing.findings.len(), blind.findings.len() + 1);
}

#[test]
fn an_excitation_that_assumed_another_mass_says_so_and_is_compared_with_the_configured_one() {
    let config = config(&["plant.mass-kg=0.75"]);
    let flown = excitation_flight::fly(&config).unwrap();
    let text = flown.assumption.unwrap();
    for part in ["the configured mass of 0.5 kg the excitation failed", "assumes 0.650 kg"] {
        assert!(text.contains(part), "{text}");
    }
    assert_eq!(flown.flight.config.vehicle, config.vehicle);
    let found = identified(&flown.flight);
    let [thrust] = found.of_key("vehicle.max-thrust-n")[..] else { panic!("one thrust") };
    assert_eq!(thrust.before, Some(20.0));
    assert!((thrust.value / (20.0 * 0.5 / 0.75) - 1.0).abs() < 0.02, "{thrust:?}");
}

#[test]
fn a_parameter_that_a_hover_does_not_determine_is_not_written() {
    let flight = flown(config(&["trajectory.kind=hover", "trajectory.hover.duration-s=6"]));
    let identification = identified(&flight);
    assert!(check_distinct(&[&flight]).is_ok() && check_distinct(&[&flight, &flight]).is_err());
    let drag = identification.of_key("vehicle.drag-per-s")[0];
    assert_eq!(drag.missing, Some(rules::DRAG.motion), "{drag:?}");
    let text = vehicle_toml::toml(&identification, &flight.config);
    assert!(!text.contains("\ndrag-per-s"), "{text}");
    assert!(text.contains(rules::DRAG.motion), "{text}");
    assert_eq!(identification.vehicle(&flight.config.vehicle).drag_per_s, 0.25);
}

/// The law flies on one pose in four; all are used. With the poses of the law alone, the thrust of this hover is up to a tenth too small.
#[test]
fn a_hover_with_cameras_faster_than_the_controller_shows_the_thrust() {
    let flight = flown(config(&["trajectory.kind=hover", "mocap.rate-hz=240"]));
    let found = identified(&flight);
    assert!(3 * flight.samples.len() < found.poses * 2, "{}", found.poses);
    let thrust = found.of_key("vehicle.max-thrust-n")[0];
    assert!(thrust.is_shown() && (thrust.value - 20.0).abs() < 0.6, "{thrust:?}");
}

/// The stated thrust is that of the straight line through the hover: with it, laws outside the predictive stack lift the vehicle.
#[test]
fn a_vehicle_with_curved_thrust_flies_with_its_file() {
    let vehicle = ["vehicle.mass-kg=1.34", "vehicle.max-thrust-n=31", "plant.max-thrust-n=31"];
    for exponent in [1.2, 1.6, 2.0] {
        let own = [format!("plant.thrust-exponent={exponent}")];
        let words = vehicle.into_iter().chain(own.iter().map(String::as_str));
        let flight = excited(&words.collect::<Vec<_>>());
        let found = identified(&flight);
        let thrust = found.of_key("vehicle.max-thrust-n")[0];
        let weight_n = 1.34 * 9.81;
        let truth = weight_n / (weight_n / 31.0_f64).powf(1.0 / exponent);
        assert!((thrust.value - truth).abs() <= 2.0 * thrust.half_width, "{truth}: {thrust:?}");
        assert!(thrust.half_width < 0.01 * truth, "{thrust:?}");
        let text = vehicle_toml::toml(&found, &flight.config);
        for law in ["geometric", "oqtal-dt"] {
            let more = ["trajectory.kind=hover".to_owned(), format!("control.controller={law}")];
            let more = more.iter().chain(&own).map(String::as_str).chain([vehicle[2]]);
            let more: Vec<_> = more.map(|text| Setting::parse("test", text).unwrap()).collect();
            let config = Config::parse("vehicle.toml", &text, &more).unwrap();
            assert_eq!(flown(config).shortfall(), None, "{law}, {exponent}");
        }
    }
}

#[test]
fn a_flight_that_has_the_motion_and_does_not_fit_the_model_lacks_no_motion() {
    let found = identified(&excited(&["plant.rate-lag-ratio=[1.3,0.8,1.0]"]));
    let open: Vec<_> = found.findings.iter().filter(|finding| !finding.is_shown()).collect();
    assert!(!open.is_empty() && open.iter().all(|it| it.missing.is_none()), "{open:?}");
    let text = overview::text(&found);
    assert!(
        text.split_whitespace().collect::<Vec<_>>().join(" ").contains("one lag for all axes"),
        "{text}"
    );
}

/// The loop of rotors with a short lag: its delay is not determined, although the flight is the complete excitation.
#[test]
fn a_delay_that_is_not_determined_leaves_no_lag_of_its_own_and_no_lack_of_motion() {
    let rotors = ["vehicle.preset=crazyflie-2.1", "plant.fidelity=rotors", "plant.mass-kg=0.036"];
    let found = identified(&excited(&rotors));
    let lacking: Vec<_> = found.findings.iter().filter(|it| it.missing.is_some()).collect();
    assert!(lacking.is_empty(), "{lacking:?}");
    let written =
        ["vehicle.command-delay-ms", "vehicle.rate-lag-ms"].map(|key| found.values(key).is_some());
    assert_eq!(written[0], written[1], "{:?}", found.findings);
}

#[test]
fn findings_are_a_layer_of_the_configuration() {
    let flight = excited(&["plant.rate-lag-ms=60", "plant.hidden-delay-ms=9"]);
    let identification = identified(&flight);
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("vehicle.toml");
    std::fs::write(&file, vehicle_toml::toml(&identification, &flight.config)).unwrap();
    let layered = Config::load(std::slice::from_ref(&file), &[]).unwrap();
    let found = identification.vehicle(&flight.config.vehicle);
    assert!((found.rate_lag_ms - 60.0).abs() < 3.0, "{found:?}");
    let [a, b] = [&layered.vehicle, &found].map(|vehicle| {
        [vehicle.rate_lag_ms, vehicle.command_delay_ms, vehicle.max_thrust_n, vehicle.drag_per_s]
    });
    // Laws take the delay from the stamps, which lack the hidden one.
    let (stamped_ms, plant) = (flight.config.vehicle.command_delay_ms, &layered.plant);
    assert!((found.command_delay_ms - stamped_ms - 9.0).abs() < 1.5, "{found:?}");
    assert!((plant.command_delay_ms - stamped_ms).abs() < 0.5, "{plant:?}");
    assert!((plant.hidden_delay_ms - 9.0).abs() < 1.5, "{plant:?}");
    // The file has as many digits as the intervals support.
    assert!(a.iter().zip(&b).all(|(a, b)| (a / b - 1.0).abs() < 0.01), "{a:?} {b:?}");
}

#[test]
fn the_file_of_a_vehicle_has_its_mass_and_the_given_settings() {
    let settings = ["vehicle.mass-kg=0.9", "vehicle.max-thrust-n=22", "fence.x-m=[-3.0,3.0]"];
    let flight = excited(&settings);
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("vehicle.toml");
    std::fs::write(&file, vehicle_toml::toml(&identified(&flight), &flight.config)).unwrap();
    let layered = Config::load(std::slice::from_ref(&file), &[]).unwrap();
    assert_eq!(layered.vehicle.mass_kg, 0.9);
    assert!((layered.vehicle.max_thrust_n / 22.0 - 1.0).abs() < 0.01);
    assert_eq!(layered.fence, flight.config.fence);
    // The default square fits into this fence, not into that of a smaller room.
    assert_eq!(layered.trajectory.kind, TrajectoryKind::Square);
    let mut narrow = flight.config.clone();
    narrow.fence.y_m = [-1.5, 1.5];
    let text = vehicle_toml::toml(&identified(&flight), &narrow);
    let hovering = Config::parse("vehicle.toml", &text, &[]).unwrap();
    assert_eq!(hovering.trajectory.kind, TrajectoryKind::Hover, "{text}");

    std::fs::write(&file, "[vehicle]\nmax-thrust-n = 22.0\n").unwrap();
    let refused = Config::load(std::slice::from_ref(&file), &[]).unwrap_err().to_string();
    assert!(refused.contains(":2: ") && refused.contains("without `vehicle.mass-kg`"), "{refused}");
    // A file that lacks the mass is completed by another one.
    let mass = directory.path().join("mass.toml");
    std::fs::write(&mass, "[vehicle]\nmass-kg = 0.9\n").unwrap();
    assert_eq!(Config::load(&[file, mass], &[]).unwrap().vehicle.mass_kg, 0.9);
}

/// A vehicle of `model` under oscillating commands for five seconds, without noise.
fn ideal(model: &VehicleModel, (delay_s, authority): (f64, f64)) -> FlightData {
    let mut history = CommandHistory::new(delay_s);
    let mut data = FlightData::default();
    let mut motion = Motion::default();
    for k in 0..300_u32 {
        let t_s = f64::from(k) / 60.0;
        let (position, attitude) = (motion.position, motion.attitude);
        data.air.push(PoseRecord { captured_s: t_s, latency_s: 0.0, position, attitude });
        let swing = |per_s: f64| (per_s * t_s).sin();
        let sticks = Vector3::new(swing(9.0), swing(5.0), 0.5 * swing(3.0));
        let thrust = 0.25 + 0.05 * swing(4.0);
        data.commands.push(CommandRecord { sent_s: t_s, sticks, thrust });
        let thrust_n = thrust * 20.0;
        let input = ModelInput { demand: sticks * authority, thrust_n, ..ModelInput::default() };
        history.push(u64::from(k) + 1, t_s, input);
        let span = (t_s, f64::from(k + 1) / 60.0);
        motion = history.propagate(model, (&motion, &Bias::default()), span);
    }
    data
}

/// Comparison of the predictor with the prediction code of `oqtal-dt`.
#[test]
fn the_model_is_that_of_the_predictive_law() {
    let (delay_s, authority, lag_s) = (20e-3, 1.8, 50e-3);
    let model = VehicleModel {
        rotation: Rotation::RateLoop { lag_s },
        mass_kg: 0.5,
        gravity_m_s2: 9.81,
        drag_per_s: 0.25,
        thrust_lag_s: 40e-3,
        integration: Integration::Fine,
    };
    let data = ideal(&model, (delay_s, authority));
    let (authority, bias) = (Vector3::repeat(authority), Vector3::zeros());
    let turning = RotationModel { delay_s, lag_s, fast_s: 0.0, authority, bias };
    let noise = RotationNoise { measured_rad: 1e-3, walk_ratio: 0.1 };
    let turned = rotation::pass(&data, &turning, &noise);
    let lifting = TranslationModel {
        gravity_m_s2: 9.81,
        thrust_m_s2: 40.0,
        thrust_lag_s: 40e-3,
        drag_per_s: 0.25,
        bias,
        curvature_ratio: 0.0,
        hover_share: 0.25,
    };
    let noise = TranslationNoise { measured_m: 1e-3, gust_ratio: 1.0, gust_s: 1.0 };
    let lifted = translation::pass(&data, &turned, &lifting, &noise);
    let greatest = |innovations: &Innovations| {
        innovations.values.iter().map(Vector3::amax).fold(0.0, f64::max)
    };
    assert_eq!(turned.innovations.values.len(), 299);
    assert!(greatest(&turned.innovations) < 3e-5, "{} rad", greatest(&turned.innovations));
    assert!(greatest(&lifted.innovations) < 3e-5, "{} m", greatest(&lifted.innovations));
    let other = RotationModel { delay_s: 25e-3, ..turning };
    let missed =
        rotation::pass(&data, &other, &RotationNoise { measured_rad: 1e-3, walk_ratio: 0.1 });
    assert!(greatest(&missed.innovations) > 3e-4, "{} rad", greatest(&missed.innovations));
}
