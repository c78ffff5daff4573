//! A heading that turns at a constant rate.

use oqtal_control::euler::{EulerAngles, shorter_turn};

use crate::{config, flown};

#[test]
fn a_turning_heading_is_followed_without_a_steady_error() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("turn.csv");
    std::fs::write(&file, "t,x,y,z,yaw_deg\n0,0,0,1,0\n1,0,0,1,30\n13,0,0,1,390\n14,0,0,1,420\n")
        .unwrap();
    let file = format!("trajectory.waypoints-file={}", file.display());
    let config = config(&["control.controller=oqtal-dt", "trajectory.kind=waypoints", &file]);
    let start_s = config.trajectory.start_s();
    let flight = flown(config);
    let is_steady = |mission_s: f64| (4.0..12.0).contains(&(mission_s - start_s));
    let steady = flight.scored().filter(|sample| is_steady(sample.telemetry.mission_s));
    let errors: Vec<f64> = steady
        .map(|sample| {
            let yaw = EulerAngles::from_attitude(&sample.attitude()).yaw;
            shorter_turn(yaw - sample.telemetry.reference_yaw).to_degrees()
        })
        .collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(errors.len() > 400 && mean.abs() < 0.1, "{mean} deg");
}
