//! Warnings before a flight: settings that the flight cannot satisfy. The flight takes place nevertheless.

mod change;
mod disturbances;
mod guarded;
mod hover;
mod law;
mod model_flight;
mod path;
mod simulated;
mod steps;

pub(crate) use change::added_warnings;
pub(crate) use guarded::note_below_envelope;
use hover::oscillates;
use law::without_effect;

use std::ops::RangeInclusive;

use oqtal_config::Config;
use oqtal_control::trajectory::{
    FlightPlan, Phase, Reference, Trajectory, TrajectoryKind, WaypointCurve,
};

/// Shortest time between two points at which the reference is looked at \[s\].
const STEP_S: f64 = 0.01;
/// Most points at which the reference is looked at \[-\].
const MOST_POINTS: f64 = 20_000.0;
/// Thrust over weight above which a note is printed \[-\].
const MOST_THRUST: f64 = 20.0;
/// Rate at full stick above which a note is printed \[rad/s\].
const MOST_AUTHORITY: f64 = 20.0;
/// Lags and delays without a note \[ms\], apart from none.
const USUAL_MS: RangeInclusive<f64> = 0.2..=1000.0;
/// Position noise of the cameras without a note \[mm\], apart from none.
const USUAL_NOISE_MM: RangeInclusive<f64> = 0.005..=100.0;
/// Attitude noise of the cameras without a note \[deg\], apart from none.
const USUAL_NOISE_DEG: RangeInclusive<f64> = 0.005..=20.0;
/// Voltage of a battery without a note \[V\], apart from none.
const USUAL_BATTERY_V: RangeInclusive<f64> = 2.0..=100.0;
/// Plausible ratio of a moment of inertia to mass^(5/3), which is constant for bodies of equal shape and density
/// \[kg^(-2/3) m^2\].
const USUAL_INERTIA: RangeInclusive<f64> = 2e-5..=4.0;

/// Settings of `config` that a flight of `trajectory` cannot satisfy because of other settings, each with its remedy. Takes up to some
/// seconds: the law flies a model along the steps of the trajectory.
pub fn warnings(config: &Config, trajectory: &Trajectory) -> Vec<String> {
    let plan = FlightPlan::from_origin(&config.trajectory, trajectory);
    let samples = samples(&plan);
    let mut all = warnings_along(&plan, &samples, config, trajectory);
    if !config.safety.observe_only {
        // Remedies for a step are of no use to a law that oscillates.
        let flown = oscillates(config);
        all.extend(flown.or_else(|| steps::too_far(&plan, &samples, config)));
    }
    all
}

/// The warnings for which nothing is flown.
pub(crate) fn quick_warnings(config: &Config, trajectory: &Trajectory) -> Vec<String> {
    let plan = FlightPlan::from_origin(&config.trajectory, trajectory);
    warnings_along(&plan, &samples(&plan), config, trajectory)
}

/// The warnings for which nothing is flown, of the flight `plan` of `trajectory`.
fn warnings_along(
    plan: &FlightPlan,
    samples: &[(f64, Reference)],
    config: &Config,
    trajectory: &Trajectory,
) -> Vec<String> {
    let mut all = config.rename_warnings().to_vec();
    if config.safety.observe_only {
        return all;
    }
    all.extend(config.rate_warning());
    all.extend(config.pose_rate_warning());
    all.extend(implausible(config));
    all.extend(law::replaced(config));
    all.extend(law::feed_forward_off(config));
    all.extend(law::feed_forward_unused(config));
    all.extend(simulated::too_old(config));
    all.extend(simulated::markers_unused(config));
    all.extend(simulated::rotors(config));
    all.extend(waypoints_unused(config));
    all.extend(law::position_gains_unused(config));
    all.extend(law::outside_envelope(samples, config));
    let (path, limits) = (&config.trajectory, &config.position);
    let jerks =
        path.kind == TrajectoryKind::Waypoints && path.waypoints_curve == WaypointCurve::Monotone;
    if config.control.is_predictive() {
        // The predictive stack feeds the motion of the reference forward, beside the limits.
        all.extend(jerks.then(|| path::jerks(samples, config, trajectory)).flatten());
    } else {
        let too_hard = path::too_hard(samples, config);
        // With a higher limit of the velocity these laws, which follow the position alone, cut or leave a path even further.
        let horizontal = (
            "horizontal",
            limits.horizontal_velocity_limit_m_s,
            ", or fly oqtal-dt, which follows it",
        );
        all.extend(path::too_fast(samples, config, horizontal, |velocity| velocity.xy().norm()));
        let vertical = ("vertical", limits.vertical_velocity_limit_m_s, ", or raise the limit");
        all.extend(path::too_fast(samples, config, vertical, |velocity| velocity.z.abs()));
        all.extend(too_hard);
    }
    all.extend(path::jump(plan, config));
    all.extend(path::first_turn(config, trajectory));
    all.extend(path::turns_too_fast(config, trajectory));
    all.extend(disturbances::all(config, touchdown_s(plan, samples)));
    all
}

/// Notes on values of the vehicle, and of the simulated one where it differs, that are probably written in another unit.
fn implausible(config: &Config) -> Vec<String> {
    let (vehicle, plant) = (&config.vehicle, &config.plant);
    let modelled = unusual(
        (vehicle.mass_kg, vehicle.gravity_m_s2, vehicle.max_thrust_n),
        [vehicle.rate_lag_ms, vehicle.thrust_lag_ms, vehicle.command_delay_ms],
        (&vehicle.inertia_kg_m2, &vehicle.rate_authority_rad_s),
    );
    let mut simulated = unusual(
        (plant.mass_kg, plant.gravity_m_s2, plant.max_thrust_n),
        [plant.rate_lag_ms, plant.thrust_lag_ms, plant.command_delay_ms],
        (&plant.inertia_kg_m2, &plant.rate_authority_rad_s),
    );
    // A key of the plant that is not set follows the vehicle's.
    simulated.retain(|note| !modelled.contains(note));
    let of = |section: &'static str| move |note: String| format!("{section}.{note}");
    let (position_mm, attitude_deg) =
        (config.mocap.position_noise_mm, config.mocap.attitude_noise_deg);
    let cameras = [
        unusual_time("latency-ms", config.mocap.latency_ms),
        unusual_value("position-noise-mm", position_mm, USUAL_NOISE_MM, "mm"),
        unusual_value("attitude-noise-deg", attitude_deg, USUAL_NOISE_DEG, "deg"),
    ];
    let of_vehicles =
        modelled.into_iter().map(of("vehicle")).chain(simulated.into_iter().map(of("plant")));
    let cameras = cameras.into_iter().flatten().map(of("mocap"));
    of_vehicles.chain(cameras).chain(battery(config)).collect()
}

/// Notes on the voltages at which the daemon warns and lands.
fn battery(config: &Config) -> Vec<String> {
    let (low_v, empty_v) = (config.safety.battery_low_v, config.safety.battery_empty_v);
    let keys = [("safety.battery-low-v", low_v), ("safety.battery-empty-v", empty_v)];
    let unusual =
        keys.into_iter().filter_map(|(key, v)| unusual_value(key, v, USUAL_BATTERY_V, "V"));
    let late = (0.0 < low_v && low_v < empty_v).then(|| {
        format!("safety.battery-low-v is {low_v}, below safety.battery-empty-v, {empty_v}: the vehicle lands before the warning")
    });
    unusual.chain(late).collect()
}

/// Note on a lag or delay \[ms\] that is probably written in another unit.
fn unusual_time(key: &str, value_ms: f64) -> Option<String> {
    unusual_value(key, value_ms, USUAL_MS, "ms")
}

/// Note on a value of `key` that is neither 0 nor in the range `usual`, in the unit of the key.
fn unusual_value(
    key: &str,
    value: f64,
    usual: RangeInclusive<f64>,
    unit: &'static str,
) -> Option<String> {
    let is_usual = value == 0.0 || usual.contains(&value);
    (!is_usual).then(|| format!("{key} is {value}, unusual in {unit}"))
}

/// Notes on a vehicle of this mass \[kg\], gravity \[m/s^2\] and thrust \[N\], with these lags of rate and thrust and this delay of
/// commands \[ms\], this inertia \[kg m^2, body\] and these rates at full stick \[rad/s, body\]; each begins with the key.
fn unusual(
    (mass_kg, gravity_m_s2, thrust_n): (f64, f64, f64),
    [rate_ms, thrust_ms, delay_ms]: [f64; 3],
    (inertia, authority): (&[[f64; 3]; 3], &[f64; 3]),
) -> Vec<String> {
    let is_mass_usual = (0.01..=50.0).contains(&mass_kg);
    let mass = (!is_mass_usual).then(|| format!("mass-kg is {mass_kg}, unusual in kg"));
    let times =
        [("rate-lag-ms", rate_ms), ("thrust-lag-ms", thrust_ms), ("command-delay-ms", delay_ms)];
    let times = times.into_iter().filter_map(|(key, value_ms)| unusual_time(key, value_ms));
    let mut notes: Vec<_> = mass.into_iter().chain(times).collect();
    let per_mass = mass_kg.powf(5.0 / 3.0);
    let moments = (0..3).map(|axis| inertia[axis][axis]).filter(|_| is_mass_usual);
    if let Some(moment) = moments.into_iter().find(|it| !USUAL_INERTIA.contains(&(it / per_mass))) {
        notes.push(format!(
            "inertia-kg-m2 has {moment}, unusual in kg m^2: with {mass_kg} kg a radius of gyration of {:.4} m",
            (moment / mass_kg).sqrt()
        ));
    }
    if let Some(rate) = authority.iter().find(|rate| **rate > MOST_AUTHORITY) {
        notes.push(format!(
            "rate-authority-rad-s has {rate}, unusual in rad/s: {:.0} deg/s at full stick",
            rate.to_degrees()
        ));
    }
    let weight_n = mass_kg * gravity_m_s2;
    let ratio = thrust_n / weight_n;
    if ratio > MOST_THRUST && weight_n > 0.0 {
        notes.push(format!(
            "max-thrust-n is {thrust_n}, {ratio:.0} times the weight of {weight_n:.2} N: all rotors together, in newtons"
        ));
    }
    notes
}

/// Note that a file of waypoints is named and not flown.
fn waypoints_unused(config: &Config) -> Option<String> {
    let kind = config.trajectory.kind;
    let is_unused = config.trajectory.waypoints_file.is_some() && kind != TrajectoryKind::Waypoints;
    is_unused.then(|| {
        "trajectory.waypoints-file is given and another trajectory is flown: set trajectory.kind to \"waypoints\" to fly the file, or in flight request `fly waypoints`".to_owned()
    })
}

/// Planned time at which the vehicle is on the floor and the flight ends \[s\]; the reference continues into the floor.
fn touchdown_s(plan: &FlightPlan, samples: &[(f64, Reference)]) -> f64 {
    let is_down = |reference: &Reference| {
        reference.phase == Phase::Landing && reference.position.z <= plan.origin().z
    };
    let touchdown = samples.iter().find(|(_, reference)| is_down(reference));
    touchdown.map_or(plan.end_s(), |(t_s, _)| *t_s)
}

/// The reference over the whole flight, with its times from the start \[s\].
fn samples(plan: &FlightPlan) -> Vec<(f64, Reference)> {
    let step_s = STEP_S.max(plan.end_s() / MOST_POINTS);
    let points = (plan.end_s() / step_s) as u32;
    let times = (0..=points).map(|index| f64::from(index) * step_s);
    times.map(|t_s| (t_s, plan.sample(t_s))).collect()
}

#[cfg(test)]
mod tests;
