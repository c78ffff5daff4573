//! Errors of identifications: vehicles with drawn parameters are flown and identified by a controller configured for the shipped
//! vehicle.

use std::ops::Range;

use oqtal_config::{Config, Fidelity, PlantOptions, Setting, VehicleOptions};
use oqtal_control::controller::ControllerName;
use oqtal_control::statistics::{median, quantile};
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_observe::plot::unit::rounded;
use oqtal_plant_sim::drawn;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;
use serde::Serialize;

use super::data::FlightData;
use super::excitation_flight;
use super::finding::{ParameterFinding, rules};
use super::identification::{Identification, Scale, identify};
use crate::mission::Mission;
use crate::progress::Progress;
use crate::simulation;
use crate::study::metric::{of_attitude, of_hover};
use crate::text_table::markdown;

/// Greatest relative deviation of every parameter \[-\].
const SPREAD: f64 = 0.3;

/// Simulated laboratory: fidelity of the plant, preset of the cameras.
pub type Laboratory = (&'static str, &'static str);

/// Identified parameter of one vehicle.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct HiddenParameter {
    /// Name of the parameter.
    pub name: &'static str,
    /// Unit of the error: "ms", or "%" of the truth.
    pub unit: &'static str,
    /// Identified value minus true value \[unit of the parameter's error\].
    pub error: f64,
    /// Half the width of its 95 % interval \[unit of the parameter's error\].
    pub half_width: f64,
}

/// One identified vehicle.
#[derive(Clone, Debug, Serialize)]
pub struct HiddenPlant {
    /// Seed of its parameters.
    pub seed: u64,
    /// Parameters of the vehicle; empty if its flight failed.
    pub parameters: Vec<HiddenParameter>,
    /// Errors of `oqtal-dt` with the identified vehicle over its errors with the true one, hover and chirp \[-\].
    pub flown_ratio: Option<[f64; 2]>,
}

/// The vehicles of one laboratory.
#[derive(Clone, Debug, Serialize)]
pub struct HiddenRoom {
    /// The laboratory.
    pub laboratory: Laboratory,
    /// The vehicles.
    pub plants: Vec<HiddenPlant>,
}

/// Vehicles identified in several laboratories.
#[derive(Clone, Debug, Serialize)]
pub struct HiddenPlants {
    /// The laboratories.
    pub rooms: Vec<HiddenRoom>,
}

impl HiddenPlants {
    /// Both fidelities of the plant, with exact and with measured timing of the cameras.
    pub const LABORATORIES: &[Laboratory] = &[
        ("eq61", "qualisys"),
        ("eq61", "measured"),
        ("rotors", "qualisys"),
        ("rotors", "measured"),
    ];
}

/// Flies and identifies one vehicle per seed of `seeds` in each of `laboratories`, with `settings`.
///
/// # Errors
/// A setting is invalid.
pub fn study(
    settings: &[Setting],
    seeds: Range<u64>,
    laboratories: &[Laboratory],
) -> Result<HiddenPlants, Failure> {
    let progress = Progress::default();
    let bar = progress.start("hidden plants", laboratories.len() * seeds.clone().count());
    let room = |laboratory: &Laboratory| {
        let plant = |seed| {
            let plant = hidden_plant(&config(settings, *laboratory, seed)?);
            bar.inc();
            plant
        };
        let plants: Result<Vec<HiddenPlant>, Failure> =
            seeds.clone().into_par_iter().map(plant).collect();
        Ok(HiddenRoom { laboratory: *laboratory, plants: plants? })
    };
    Ok(HiddenPlants { rooms: laboratories.iter().map(room).collect::<Result<_, Failure>>()? })
}

/// The configuration of the vehicle `seed` in a laboratory.
///
/// # Errors
/// A setting is invalid.
pub fn config(
    settings: &[Setting],
    (fidelity, preset): Laboratory,
    seed: u64,
) -> Result<Config, Failure> {
    let own = [
        Setting::flag("hidden plants", "plant.spread", SPREAD),
        Setting::flag("hidden plants", "plant.fidelity", fidelity),
        Setting::flag("hidden plants", "mocap.preset", preset),
        Setting::flag("hidden plants", "clock.seed", seed.cast_signed()),
    ];
    Ok(Config::from_settings(&[settings, &own[..]].concat())?)
}

/// The vehicle of `config`, flown and identified.
///
/// # Errors
/// A setting is invalid.
pub fn hidden_plant(config: &Config) -> Result<HiddenPlant, Failure> {
    let seed = config.clock.seed;
    let failed = HiddenPlant { seed, parameters: Vec::new(), flown_ratio: None };
    let Ok(identification) = identified(config) else { return Ok(failed) };
    let truth = truth(config);
    let parameters = parameters(&identification, &equivalent(config));
    let found = identification.vehicle(&config.vehicle);
    let [by_found, by_truth] = [found, truth].map(|vehicle| figures(config, &vehicle));
    let (by_found, by_truth) = (by_found?, by_truth?);
    let flown_ratio = by_found.zip(by_truth).map(|(a, b)| [a[0] / b[0], a[1] / b[1]]);
    Ok(HiddenPlant { seed, parameters, flown_ratio })
}

/// The identification of the vehicle of `config`, with its mass given.
///
/// # Errors
/// The flight failed, or its data are insufficient.
pub fn identified(config: &Config) -> Result<Identification, Failure> {
    let mass_kg = drawn(&config.plant, config.clock.seed).mass_kg;
    let data = FlightData::of(&excitation_flight::fly(config)?.flight);
    identify(&[data], &config.vehicle, Scale::Mass(mass_kg))
}

/// True parameters, as keys of `[vehicle]`. The lag of the thrust is the lag of the rotor speed.
pub fn truth(config: &Config) -> VehicleOptions {
    let plant: PlantOptions = drawn(&config.plant, config.clock.seed);
    let thrust_lag_ms = match plant.fidelity {
        Fidelity::Eq61 => plant.thrust_lag_ms,
        Fidelity::Rotors => plant.rotors.lag_ms,
    };
    VehicleOptions {
        mass_kg: plant.mass_kg,
        max_thrust_n: plant.max_thrust_n,
        rate_authority_rad_s: plant.rate_authority_rad_s,
        rate_lag_ms: plant.rate_lag_ms,
        thrust_lag_ms,
        command_delay_ms: plant.command_delay_ms,
        drag_per_s: plant.drag_per_s,
        ..config.vehicle.clone()
    }
}

/// First-order loop equivalent to the loop of `config`. A loop around rotors of lag `a` is of second order, `a T s^2 + T s + 1`:
/// its slow pole is the lag, and its fast pole acts as a delay. The lag of the thrust is the rest of the rotors' lag.
pub fn equivalent(config: &Config) -> VehicleOptions {
    let truth = truth(config);
    if config.plant.fidelity == Fidelity::Eq61 {
        return truth;
    }
    let (loop_ms, rotors_ms) = (truth.rate_lag_ms, truth.thrust_lag_ms);
    let discriminant = (1.0 - 4.0 * rotors_ms / loop_ms).max(0.0);
    let fast_ms = 0.5 * loop_ms * (1.0 - discriminant.sqrt());
    VehicleOptions {
        rate_lag_ms: loop_ms - fast_ms,
        command_delay_ms: truth.command_delay_ms + fast_ms,
        thrust_lag_ms: (rotors_ms - fast_ms).max(0.0),
        ..truth
    }
}

/// Errors of the findings.
pub fn parameters(identification: &Identification, truth: &VehicleOptions) -> Vec<HiddenParameter> {
    let one = |finding: &ParameterFinding| {
        let relative = |truth: f64| (truth, 100.0 / truth, "%");
        let in_ms = |truth: f64| (truth, 1.0, "ms");
        let axis = rules::AUTHORITY.iter().position(|rule| rule.name == finding.name);
        let (truth, scale, unit) = match (finding.name, axis) {
            (_, Some(axis)) => relative(truth.rate_authority_rad_s[axis]),
            (name, _) if name == rules::DELAY.name => in_ms(truth.command_delay_ms),
            (name, _) if name == rules::RATE_LAG.name => in_ms(truth.rate_lag_ms),
            (name, _) if name == rules::THRUST_LAG.name => in_ms(truth.thrust_lag_ms),
            (name, _) if name == rules::THRUST.name => relative(truth.max_thrust_n),
            (name, _) if name == rules::DRAG.name => relative(truth.drag_per_s),
            _ => return None,
        };
        Some(HiddenParameter {
            name: finding.name,
            unit,
            error: (finding.value - truth) * scale,
            half_width: finding.half_width * scale,
        })
    };
    identification.findings.iter().filter_map(one).collect()
}

/// Root mean square of the position error of a hover \[mm\] and of the attitude error of a chirp \[deg\], with `oqtal-dt`
/// configured for `vehicle`; `None` if it does not land.
///
/// # Errors
/// An option of the law is invalid.
pub fn figures(config: &Config, vehicle: &VehicleOptions) -> Result<Option<[f64; 2]>, Failure> {
    let fly = |kind| {
        let mut config = config.clone();
        config.vehicle = vehicle.clone();
        config.control.controller = ControllerName::OqtalDt;
        config.trajectory.kind = kind;
        let flight = simulation::fly(&Mission::new(config)?)?;
        Ok::<_, Failure>(Some(flight).filter(|flight| flight.shortfall().is_none()))
    };
    let hover = fly(TrajectoryKind::Hover)?.map(|flight| of_hover(&flight)[0]);
    let chirp = fly(TrajectoryKind::AttitudeChirp)?.map(|flight| of_attitude(&flight)[0]);
    Ok(hover.zip(chirp).map(|(hover, chirp)| [hover, chirp]))
}

impl HiddenRoom {
    /// Errors of a parameter over all vehicles, with the half widths of their intervals.
    fn errors(&self, name: &str) -> Vec<(f64, f64)> {
        let parameters = self.plants.iter().flat_map(|plant| &plant.parameters);
        let same = parameters.filter(|parameter| parameter.name == name);
        same.map(|parameter| (parameter.error, parameter.half_width)).collect()
    }

    fn names(&self) -> Vec<(&'static str, &'static str)> {
        let first = self.plants.iter().find(|plant| !plant.parameters.is_empty());
        first.map_or_else(Vec::new, |plant| {
            plant.parameters.iter().map(|p| (p.name, p.unit)).collect()
        })
    }

    fn to_markdown(&self) -> String {
        let (fidelity, preset) = self.laboratory;
        let flown = self.plants.iter().filter(|plant| !plant.parameters.is_empty()).count();
        let headings =
            ["parameter", "median error", "95 of 100 below", "intervals that hold the truth"];
        let rows = self.names().into_iter().map(|(name, unit)| {
            let errors = self.errors(name);
            let [middle, most] = quantiles(errors.iter().map(|(error, _)| error.abs()));
            let held = errors.iter().filter(|(error, half)| error.abs() <= *half).count();
            let share = 100.0 * held as f64 / errors.len().max(1) as f64;
            let sizes = [middle, most].map(|size| format!("{} {unit}", rounded(size, 2)));
            [&[name.to_owned()], &sizes[..], &[format!("{share:.0} %")]].concat()
        });
        format!(
            "### Plant `{fidelity}`, cameras `{preset}`: {flown} of {} identified\n\n{}\n\n",
            self.plants.len(),
            markdown(&headings, rows.chain(self.flown()))
        )
    }

    /// Errors of `oqtal-dt` with the identified vehicle, compared with the true one.
    fn flown(&self) -> [Vec<String>; 2] {
        [("hover", 0), ("chirp", 1)].map(|(name, index)| {
            let ratios = self.plants.iter().filter_map(|plant| plant.flown_ratio);
            let [middle, most] = quantiles(ratios.map(|ratio| 100.0 * (ratio[index] - 1.0)))
                .map(|percent| format!("{} %", rounded(percent, 2)));
            let name = format!("`oqtal-dt`, {name}, against the truth known");
            vec![name, middle, most, String::new()]
        })
    }
}

/// Median and 95th percentile \[unit of the values\]; NaN without values.
fn quantiles(values: impl Iterator<Item = f64> + Clone) -> [f64; 2] {
    [median(values.clone()), quantile(values, 0.95)].map(|value| value.unwrap_or(f64::NAN))
}

impl HiddenPlants {
    /// The tables of all laboratories.
    pub fn to_markdown(&self) -> String {
        self.rooms.iter().map(HiddenRoom::to_markdown).collect()
    }
}
