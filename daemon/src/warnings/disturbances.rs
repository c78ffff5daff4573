//! Warnings on disturbances and faults.

use oqtal_config::{Config, DisturbanceKind, PlantOptions};

/// All notes on the disturbances of a flight whose planned end is `end_s` from arming \[s\].
pub(super) fn all(config: &Config, end_s: f64) -> Vec<String> {
    let too_heavy = too_heavy(config);
    let carried = if too_heavy.is_empty() { beyond_integral(config) } else { Vec::new() };
    [after_the_end(config, end_s), too_heavy, carried, without_effect(config)].concat()
}

/// Notes on disturbances and faults that begin after the planned end of the flight, at `end_s` from arming \[s\].
fn after_the_end(config: &Config, end_s: f64) -> Vec<String> {
    let disturbances =
        config.plant.disturb.iter().map(|it| ("disturbance", it.to_string(), it.at_s));
    let faults = config.fault.inject.iter().map(|it| ("fault", it.to_string(), it.at_s));
    let late = disturbances.chain(faults).filter(|(.., at_s)| *at_s >= end_s);
    late.map(|(kind, text, at_s)| {
        format!(
            "the {kind} `{text}` begins {at_s} s after arming and will not occur: the flight is planned to end after {end_s:.1} s; give an earlier time, or a longer flight with --duration"
        )
    })
    .collect()
}

/// Notes on gusts that push a vehicle without drag, and so have no effect.
fn without_effect(config: &Config) -> Vec<String> {
    let PlantOptions { drag_per_s, rotors, .. } = &config.plant;
    let drag = [*drag_per_s, rotors.drag_coefficient, rotors.inflow_coefficient];
    let has_drag = drag != [0.0; 3];
    let gusts =
        config.plant.disturb.iter().filter(|it| matches!(it.kind, DisturbanceKind::Gust(_)));
    gusts
        .filter(|_| !has_drag)
        .map(|it| {
            format!(
                "the disturbance `{it}` has no effect: wind acts through drag, and the simulated vehicle has none; set plant.drag-per-s, or use force@ instead of gust@"
            )
        })
        .collect()
}

/// Notes on payloads that the vehicle cannot lift.
fn too_heavy(config: &Config) -> Vec<String> {
    let plant = &config.plant;
    let most_kg = plant.max_thrust_n / plant.gravity_m_s2 - plant.mass_kg;
    let payloads = plant.disturb.iter().filter_map(|it| match it.kind {
        DisturbanceKind::Mass(mass_kg) if mass_kg > most_kg => Some((it, mass_kg)),
        _ => None,
    });
    payloads
        .map(|(it, mass_kg)| {
            format!(
                "the disturbance `{it}` adds {mass_kg} kg, and the vehicle lifts {most_kg:.2} kg more than itself: masses are in kg; 100 g is 0.1kg"
            )
        })
        .collect()
}

/// Shortage of vertical acceleration from which a note is printed \[m/s^2\]: with the shipped gains the vehicle stays some 2 cm lower.
const TOLD_SHORTAGE_M_S2: f64 = 0.12;

/// Notes on payloads whose weight the integral of the velocity loops cannot compensate: the vehicle stays below its reference.
fn beyond_integral(config: &Config) -> Vec<String> {
    let (plant, vehicle) = (&config.plant, &config.vehicle);
    let limit = config.position.velocity_integral_limit_m_s2;
    let notes = plant.disturb.iter().filter_map(|it| {
        let DisturbanceKind::Mass(mass_kg) = it.kind else { return None };
        let needed = vehicle.gravity_m_s2 * ((plant.mass_kg + mass_kg) / vehicle.mass_kg - 1.0);
        (mass_kg > 0.0 && needed > limit + TOLD_SHORTAGE_M_S2).then(|| {
            format!(
                "with the disturbance `{it}` a hover takes {needed:.2} m/s^2 more than the model, and the integral of the velocity loops has at most position.velocity-integral-limit-m-s2 = {limit}: the vehicle stays below its reference; raise the limit to {:.1}, or fly oqtal-dt",
                (10.0 * needed).ceil() / 10.0 + 0.2
            )
        })
    });
    if config.control.is_predictive() { Vec::new() } else { notes.collect() }
}
