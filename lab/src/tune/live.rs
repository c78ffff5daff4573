//! Gains for a vehicle in flight, which is identified from a brief excitation: they are searched for in simulated flights of it.

use oqtal_config::{Config, Setting};
use oqtal_control::controller::ControllerName;
use oqtal_control::position::PositionOptions;
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_observe::flight::Flight;
use oqtal_runtime::process::{Exit, Failure};

use super::optimiser::Optimiser;
use super::search::{self, Budget, TrainingFlights, Tuned};
use super::trade::MetricWeights;
use super::tuned::LIVE;
use crate::identify::command::check_interface;
use crate::identify::data::FlightData;
use crate::identify::finding::{ParameterFinding, rules};
use crate::identify::identification::{Identification, Scale, identify};
use crate::progress::Progress;
use crate::study::TRAINING_SEEDS;
use crate::study::flights::{AUTHORITY, Change, NOMINAL, PlantVariant, RATE_LAG, readable};
use crate::study::law;

/// Default optimiser: two searches on similar plants proceed similarly, so the gains depend little on errors of the identification, and the
/// objective falls faster than with the default of other searches.
pub const OPTIMISER: Optimiser = Optimiser::QuasiNewton;
/// Parts of the daemon's configuration that the search does not use: its flights are in virtual time and as long as those of every
/// study, its plant is the identified vehicle, and its cameras have the noise and the latency that were found.
const LEFT_OUT: [&str; 10] = [
    "clock.",
    "fault.",
    "instance.",
    "log.",
    "mocap.",
    "plant.",
    "realtime.",
    "record.",
    "trajectory.duration-s",
    "trajectory.hover.",
];

/// Plants of the training flights: the identified one, and those that limit how stiff the gains may be.
const PLANTS: [PlantVariant; 3] = [
    NOMINAL,
    PlantVariant {
        name: "rate gain +12 %, thrust +8 %",
        changes: &[Change::Times(AUTHORITY, 1.12), Change::Times("plant.max-thrust-n", 1.08)],
    },
    PlantVariant { name: "inner lag +30 %", changes: &[Change::Times(RATE_LAG, 1.3)] },
];

/// Duration of the hovers of the training flights \[s\], of which the first 6 s are not scored. If only a few seconds were
/// scored, the search would fit the gains to the gusts of these seconds.
const HOVER_S: f64 = 18.0;

/// Greatest limit of the integral of the velocity loops that a configuration may have \[m/s^2\].
const GREATEST_LIMIT_M_S2: f64 = 5.0;

/// Findings that are noise of the cameras, each with the key of the emulated ones.
const NOISE: [(&str, &str); 2] = [
    (rules::ATTITUDE_NOISE.name, "mocap.attitude-noise-deg"),
    (rules::POSITION_NOISE.name, "mocap.position-noise-mm"),
];

/// Names of the parameters that must be determined before gains are applied: margins depend on them.
const NEEDED: [&str; 5] = [
    rules::DELAY.name,
    rules::RATE_LAG.name,
    rules::AUTHORITY[0].name,
    rules::AUTHORITY[1].name,
    // As well determined as the thrust over the mass, of which it is a multiple.
    rules::THRUST.name,
];

/// Gains for a vehicle in flight, with the identification on which they are based.
#[derive(Debug)]
pub struct LiveTuning {
    /// The vehicle.
    pub identification: Identification,
    /// The gains of the law that flies; of the keys that may change in flight.
    pub tuned: Tuned,
    /// Names of the parameters on which margins depend and that the flight does not determine; the search used their values from
    /// `[vehicle]`.
    pub undetermined: Vec<&'static str>,
}

/// The law of `config`, whose gains can be searched for.
///
/// # Errors
/// The law is external, or the vehicle is not commanded by rates (exit code 64).
pub fn law_of(config: &Config) -> Result<ControllerName, Failure> {
    check_interface(config)?;
    let own = law::of_name(config.control.controller.name());
    own.filter(|_| !config.control.is_external()).ok_or_else(|| {
        let reason = "an external law has no gains here: restart the processes with another control.controller";
        Failure::new(Exit::Usage, reason)
    })
}

/// The vehicle of `flight`, flown by a daemon with the settings `present`.
///
/// # Errors
/// The vehicle is not commanded by rates (exit code 64), or the flight is too short (65).
pub fn identified(flight: &Flight, present: &[Setting]) -> Result<Identification, Failure> {
    let config = Config::from_settings(present)?;
    check_interface(&config)?;
    identify(&[FlightData::of(flight)], &config.vehicle, Scale::Unknown)
}

/// Names of the parameters on which margins depend and that the flight does not determine.
fn undetermined(findings: &[ParameterFinding]) -> Vec<&'static str> {
    let is_needed = |it: &&ParameterFinding| NEEDED.contains(&it.name) && !it.is_shown();
    findings.iter().filter(is_needed).map(|finding| finding.name).collect()
}

/// Gains for the vehicle of [`identified`], with the law and the settings `present` of its daemon, and these weights of the objective, which
/// `options` gives as text. Neither the truth of a simulated vehicle nor its `[plant]` is used.
///
/// # Errors
/// As of [`law_of`], the search was interrupted, or no gains land every flight (1).
pub fn tune(
    identification: Identification,
    present: &[Setting],
    (budget, weights, options): (&Budget, MetricWeights, &str),
    progress: &Progress,
) -> Result<LiveTuning, Failure> {
    let config = Config::from_settings(present)?;
    let law = law_of(&config)?;
    let settings = settings_of(present, &config, &identification);
    let found = identification.vehicle(&config.vehicle);
    let limit = integral_limit(&config, found.max_thrust_n / found.mass_kg);
    let flights = TrainingFlights {
        computed: limit.into_iter().collect(),
        weights,
        options: format!("{LIVE}{options}"),
        ..training_flights(settings)
    };
    let tuned = search::law(law, budget, &flights, progress)?;
    let undetermined = undetermined(&identification.findings);
    Ok(LiveTuning { identification, tuned, undetermined })
}

/// Flights in which gains that may change in flight are searched for, with these settings.
pub fn training_flights(mut settings: Vec<Setting>) -> TrainingFlights {
    // The vehicle hovers during the search.
    settings.extend([
        Setting::flag("tune --live", "trajectory.hover.duration-s", HOVER_S),
        Setting::flag("tune --live", "trajectory.circle.laps", 1),
        Setting::flag("tune --live", "trajectory.lemniscate.laps", 1),
    ]);
    let first = TRAINING_SEEDS.start;
    let seeds = first..first + PLANTS.len() as u64;
    TrainingFlights { live_keys_only: true, ..TrainingFlights::on(settings, seeds, &PLANTS) }
}

/// Key and value of the limit of the integral of the velocity loops \[m/s^2\] with which a vehicle whose greatest thrust over its mass
/// is `thrust_m_s2` \[m/s^2\] holds its height under laws that compute with `[vehicle]`; `None` if the present limit suffices. Without
/// it, a search would make all gains as stiff as the noise allows, since only they reduce the error that remains.
pub fn integral_limit(config: &Config, thrust_m_s2: f64) -> Option<(String, f64)> {
    let (vehicle, present) = (&config.vehicle, config.position.velocity_integral_limit_m_s2);
    let configured_m_s2 = vehicle.max_thrust_n / vehicle.mass_kg;
    let offset_m_s2 = vehicle.gravity_m_s2 * (configured_m_s2 / thrust_m_s2 - 1.0).abs();
    // The shipped limit remains for pushes.
    let needed = PositionOptions::default().velocity_integral_limit_m_s2 + offset_m_s2;
    let limit = readable(needed.min(GREATEST_LIMIT_M_S2));
    (limit > present).then(|| ("position.velocity-integral-limit-m-s2".to_owned(), limit))
}

/// Settings of the training flights: those of the daemon, with the identified vehicle as the plant.
fn settings_of(
    present: &[Setting],
    config: &Config,
    identification: &Identification,
) -> Vec<Setting> {
    let is_used = |setting: &&Setting| {
        setting.key == "mocap.rate-hz" || !LEFT_OUT.iter().any(|part| setting.key.starts_with(part))
    };
    let mut settings: Vec<Setting> = present.iter().filter(is_used).cloned().collect();
    let found = identification.settings().into_iter().filter_map(|setting| {
        let key = match setting.key.strip_prefix("vehicle.") {
            Some(name) => format!("plant.{name}"),
            None if setting.key.starts_with("plant.") => setting.key,
            None => return None,
        };
        Some(Setting { key, ..setting })
    });
    settings.extend(found);
    let findings = &identification.findings;
    settings.extend(NOISE.into_iter().filter_map(|(name, key)| {
        let noise = findings.iter().find(|finding| finding.name == name && finding.is_shown())?;
        Some(Setting::flag("identify", key, noise.value))
    }));
    let latency = identification.latency_in_flight.as_ref();
    settings.extend(latency.map(|it| Setting::flag("identify", "mocap.latency-ms", it.median_ms)));
    // These have no path whose error could be reduced.
    let kind = config.trajectory.kind;
    if matches!(
        kind,
        TrajectoryKind::Hover
            | TrajectoryKind::Waypoints
            | TrajectoryKind::Excitation
            | TrajectoryKind::BriefExcitation
    ) {
        settings.push(Setting::flag("tune --live", "trajectory.kind", "circle"));
    }
    settings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::finding::FindingRule;
    use crate::mission::Mission;
    use crate::simulation;

    const RULES: [FindingRule; 8] = {
        let [roll, pitch, yaw] = rules::AUTHORITY;
        [
            rules::DELAY,
            rules::RATE_LAG,
            roll,
            pitch,
            yaw,
            rules::THRUST,
            rules::THRUST_LAG,
            rules::DRAG,
        ]
    };

    #[test]
    fn a_training_hover_is_scored_for_at_least_ten_seconds() {
        let flights = training_flights(vec![Setting::flag("test", "trajectory.kind", "hover")]);
        let config = Config::from_settings(&flights.settings).unwrap();
        let rate_hz = config.loop_rate_hz();
        let flight = simulation::fly(&Mission::new(config).unwrap()).unwrap();
        let scored_s = flight.scored().count() as f64 / rate_hz;
        assert!(scored_s >= 10.0, "{scored_s} s");
    }

    #[test]
    fn vehicles_and_laws_that_cannot_be_tuned_are_known_from_the_configuration() {
        let exit = |texts: &[&str]| {
            let settings = texts.iter().map(|text| Setting::parse("test", text).unwrap());
            let config = Config::from_settings(&settings.collect::<Vec<_>>()).unwrap();
            law_of(&config).map_err(|failure| failure.exit)
        };
        assert_eq!(exit(&["control.controller=mpc"]), Ok(ControllerName::Mpc));
        assert_eq!(exit(&["vehicle.interface=attitude"]), Err(Exit::Usage));
        assert_eq!(exit(&["control.controller=external"]), Err(Exit::Usage));
    }

    #[test]
    fn parameters_on_which_no_margin_depends_may_be_undetermined() {
        let narrow = RULES.map(|rule| rule.found(10.0, 1e-3, Some(9.0)));
        assert_eq!(undetermined(&narrow), [""; 0]);
        let wide = RULES.map(|rule| rule.found(10.0, 1e3, Some(9.0)));
        assert_eq!(undetermined(&wide), NEEDED);
    }

    #[test]
    fn the_integral_holds_the_weight_and_keeps_its_reserve() {
        let config = Config::default();
        let configured_m_s2 = config.vehicle.max_thrust_n / config.vehicle.mass_kg;
        let limit = |factor: f64| {
            let limit = integral_limit(&config, configured_m_s2 / factor);
            limit.map_or(config.position.velocity_integral_limit_m_s2, |(_, limit)| limit)
        };
        // A fifth of the weight, 1.962 m/s^2, beside 0.9 m/s^2.
        assert_eq!([1.0, 1.2, 0.8, 2.0].map(limit), [0.9, 2.862, 2.862, 5.0]);
        let raised = [Setting::flag("test", "position.velocity-integral-limit-m-s2", 4.0)];
        let raised = Config::from_settings(&raised).unwrap();
        assert_eq!(integral_limit(&raised, configured_m_s2 / 1.2), None);
    }
}
