//! Random flights, determined by their seed.

use oqtal_config::{FaultKind, FaultTarget};
use oqtal_control::controller::ControllerName;

use crate::common::random::Random;

/// Settings of the flight with this seed.
pub fn flight(seed: u64) -> Vec<String> {
    // Separates neighbouring seeds, whose states would otherwise differ by one step of the generator.
    let random = &mut Random(seed << 32);
    let mut settings = vec![
        format!("clock.seed={seed}"),
        format!("control.controller={}", random.pick(&ControllerName::NAMES)),
        format!("plant.fidelity={}", random.pick(&["eq61", "rotors"])),
        format!("trajectory.kind={}", random.pick(&["square", "circle", "hover"])),
        "trajectory.duration-s=15.0".to_owned(),
        format!("mocap.preset={}", random.pick(&["ideal", "qualisys", "measured"])),
    ];
    if random.one_in(2) {
        settings.extend(wind(random));
    }
    if random.one_in(4) {
        settings.extend(weak_battery(random));
    }
    if random.one_in(3) {
        settings.push(format!("mocap.outlier-probability={:.3}", random.between(0.01, 0.2)));
        settings.push(format!("mocap.outlier-m={:.3}", random.between(0.05, 1.0)));
    }
    let faults: Vec<String> =
        (0..random.below(4)).map(|_| format!("\"{}\"", fault(random))).collect();
    settings.push(format!("fault.inject=[{}]", faults.join(", ")));
    if random.one_in(3) {
        settings.push(polygon(random));
    }
    settings
}

/// A fence with five to nine corners around the path of every flight, close enough to be reached in wind.
fn polygon(random: &mut Random) -> String {
    let corners = 5 + random.below(5);
    let corner = |k: u64| {
        let angle = std::f64::consts::TAU * k as f64 / corners as f64;
        format!("[{:.3}, {:.3}]", 5.0 * angle.cos(), 5.0 * angle.sin())
    };
    let corners: Vec<String> = (0..corners).map(corner).collect();
    format!("fence.polygon-m=[{}]", corners.join(", "))
}

/// A constant force of up to 3 N in any direction, mostly sideways.
fn wind(random: &mut Random) -> Vec<String> {
    let force_n = random.between(0.0, 3.0);
    let heading = random.between(0.0, std::f64::consts::TAU);
    let (x, y) = (force_n * heading.cos(), force_n * heading.sin());
    let z = force_n * random.between(-0.3, 0.3);
    vec![
        format!("plant.force-n=[{x:.3}, {y:.3}, {z:.3}]"),
        "plant.disturbance-spread=0.0".to_owned(),
    ]
}

/// A battery that becomes empty during the flight.
fn weak_battery(random: &mut Random) -> Vec<String> {
    vec![
        "plant.battery.sag=true".to_owned(),
        format!("plant.battery.capacity-ah={:.4}", random.between(0.01, 0.08)),
    ]
}

/// A random fault.
fn fault(random: &mut Random) -> String {
    let targets = [
        FaultTarget::Pose,
        FaultTarget::Pose,
        FaultTarget::Command,
        FaultTarget::Vehicle,
        FaultTarget::Radio,
        FaultTarget::Daemon,
        FaultTarget::PlantSim,
        FaultTarget::MocapEmu,
    ];
    let at_s = random.between(0.0, 24.0);
    let duration_s = random.pick(&[0.02, 0.05, 0.1, 0.2, 0.3, 0.6, 1.0, 2.0]);
    loop {
        let (target, kind) = (random.pick(&targets), random.pick(&FaultKind::ALL));
        let text =
            format!("{}:{}@{at_s:.3}+{duration_s}", target.name(), value(kind, target, random));
        if text.parse::<oqtal_config::Fault>().is_ok() {
            return text;
        }
    }
}

/// Value for this kind, with a valid magnitude.
fn value(kind: FaultKind, target: FaultTarget, random: &mut Random) -> String {
    let magnitude = match (kind, target) {
        (FaultKind::Wrong, FaultTarget::Pose) if random.one_in(2) => {
            format!("={:.1}deg", random.between(-180.0, 180.0))
        }
        (FaultKind::Wrong, FaultTarget::Pose) => format!("={:.3}m", random.between(0.02, 2.0)),
        (FaultKind::Wrong, FaultTarget::Command) => format!("={:.0}%", random.between(20.0, 150.0)),
        (FaultKind::Slow, target) if target.is_process() => {
            format!("={:.0}ms", random.between(1.0, 60.0))
        }
        (FaultKind::Slow, _) => format!("={:.1}Hz", random.between(1.0, 60.0)),
        (FaultKind::FrozenNoise | FaultKind::Noise, _) => {
            format!("={:.2}mm", random.between(0.05, 5.0))
        }
        (FaultKind::Drift, _) => format!("={:.2}m/s", random.between(0.02, 2.0)),
        (FaultKind::Rotate, _) => format!("={:.0}deg", random.between(-180.0, 180.0)),
        (FaultKind::Delayed, _) => format!("={:.0}ms", random.between(1.0, 250.0)),
        (FaultKind::Intermittent, _) => format!("={:.0}%", random.between(5.0, 95.0)),
        _ => String::new(),
    };
    format!("{}{magnitude}", kind.name())
}

/// Distances \[m\] and shares of outliers: all combinations in the study; otherwise one of them per seed, and two difficult ones:
/// at the border of the gate, and small and frequent.
pub fn outliers(seed: u64) -> Vec<(f64, f64)> {
    let all = [0.05, 0.14, 0.3, 1.0].into_iter().flat_map(|d| [0.01, 0.05, 0.2].map(|p| (d, p)));
    let all: Vec<(f64, f64)> = all.collect();
    if std::env::var_os("OQTAL_TEST_OUTLIER_SEEDS").is_some() {
        return all;
    }
    let mut random = Random(seed);
    vec![random.pick(&all), (0.14, 0.05), (0.05, 0.2)]
}
