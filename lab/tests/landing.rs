//! Landings of a vehicle that does not hold its height.

use crate::{config, flown};

/// A vehicle whose thrust curve makes it hang 0.3 m below its reference: it meets the floor at speed, while its reference is still high.
const SAGGING: [&str; 14] = [
    "trajectory.kind=hover",
    "vehicle.mass-kg=1.35",
    "vehicle.max-thrust-n=31.0",
    "vehicle.rate-authority-rad-s=[3.4,3.1,1.7]",
    "vehicle.rate-lag-ms=60.0",
    "vehicle.thrust-lag-ms=75.0",
    "vehicle.command-delay-ms=42.0",
    "vehicle.drag-per-s=0.38",
    "plant.thrust-exponent=1.35",
    "plant.gust-sd-m-s2=0.05",
    "mocap.rate-hz=120.0",
    "mocap.latency-ms=23.0",
    "mocap.position-noise-mm=0.8",
    "mocap.attitude-noise-deg=0.3",
];

#[test]
fn a_vehicle_that_meets_the_floor_before_its_reference_lands() {
    for law in ["lqr", "oqtal"] {
        for seed in 201..206 {
            let own = [format!("control.controller={law}"), format!("clock.seed={seed}")];
            let settings = SAGGING.into_iter().chain(own.iter().map(String::as_str));
            let flight = flown(config(&settings.collect::<Vec<_>>()));
            assert_eq!(flight.shortfall(), None, "{law}, seed {seed}");
        }
    }
}
