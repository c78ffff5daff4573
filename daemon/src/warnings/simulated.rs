//! Warnings on the simulated vehicle and the emulated cameras.

use oqtal_config::{Config, Fidelity, Interface, MocapModel};

/// Difference between the thrust of the simulated rotors and the configured one without a note \[-\].
const MOST_ROTOR_DIFFERENCE: f64 = 0.1;

/// Note on simulated rotors that a vehicle commanded by torque does not have, or whose thrust differs from its greatest one.
pub(super) fn rotors(config: &Config) -> Option<String> {
    let (plant, rotors) = (&config.plant, &config.plant.rotors);
    if plant.interface == Interface::Torque {
        return (plant.fidelity == Fidelity::Rotors).then(|| {
            "plant.fidelity=rotors has no effect on a vehicle commanded by torque (plant.interface): set plant.fidelity=eq61, or fly a vehicle commanded by rates".to_owned()
        });
    }
    let thrust_n = 4.0 * rotors.thrust_coefficient * rotors.max_speed_rad_s.powi(2);
    let greatest_n = plant.max_thrust_n;
    let differs = (thrust_n / greatest_n - 1.0).abs() > MOST_ROTOR_DIFFERENCE;
    (plant.fidelity == Fidelity::Rotors && differs).then(|| {
        let speed = (0.25 * greatest_n / rotors.thrust_coefficient).sqrt();
        let effect = match thrust_n < greatest_n {
            true => "the rotors saturate below full thrust",
            false => "the commands use less, and the torques have the rest",
        };
        format!(
            "with fidelity=rotors the four rotors can give up to {thrust_n:.1} N, and commands follow plant.max-thrust-n = {greatest_n} N: {effect}; rotors of that thrust have plant.rotors.max-speed-rad-s = {speed:.0}"
        )
    })
}

/// Note that the emulated cameras are slower than a pose may be old.
pub(super) fn too_old(config: &Config) -> Option<String> {
    if config.is_replay() {
        return None;
    }
    let (cameras, safety) = (&config.mocap, &config.safety);
    let age_ms = cameras.latency_ms + cameras.jitter_ms;
    let [limit, most] = [safety.pose_age_limit_ms, safety.max_pose_age_ms];
    let is_refused = age_ms >= most;
    let (older_ms, effect) = match is_refused {
        true => (most, "are refused"),
        false if cameras.latency_ms >= limit => (limit, "end a flight"),
        false => return None,
    };
    let keys = [
        (is_refused, "safety.max-pose-age-ms"),
        (cameras.latency_ms >= limit, "safety.pose-age-limit-ms"),
    ];
    let keys: Vec<&str> =
        keys.into_iter().filter_map(|(is_low, key)| is_low.then_some(key)).collect();
    Some(format!(
        "poses are up to {age_ms} ms old (mocap.latency-ms, mocap.jitter-ms), and those older than {older_ms} ms {effect}: raise {}",
        keys.join(" and ")
    ))
}

/// Note that cameras or markers are changed from which no pose is computed.
pub(super) fn markers_unused(config: &Config) -> Option<String> {
    let (own, shipped) = (&config.mocap, Config::default().mocap);
    let is_changed = own.cameras != shipped.cameras || own.markers != shipped.markers;
    let is_unused = is_changed && own.model == MocapModel::Pose;
    is_unused.then(|| "[mocap.cameras] and [mocap.markers] have no effect on poses with mocap.model = \"pose\": set mocap.model=markers".to_owned())
}
