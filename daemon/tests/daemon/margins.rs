//! The limits as functions of the motion: uncertain near the fence, and where an attitude is prescribed.

use nalgebra::Vector3;
use oqtal_config::Config;
use oqtal_control::predictive::{MeasuredPose, Track, TrackNoise};
use oqtal_control::quaternion::Attitude;
use oqtal_control::tracking_error::AttitudeReference;
use oqtal_control::trajectory::{Phase, Reference};
use oqtal_daemon::{FlightLimits, FlightView, LimitConditions};

fn track(config: &Config, pose: &MeasuredPose) -> Track {
    let noise = TrackNoise { admission: config.safety.filter, estimation: None };
    Track::at_rest(&noise, 0.0, pose)
}

/// The limits, as shipped, of a vehicle at rest at `x` \[m, world\], at its reference or at another.
fn checked(x: f64, is_descent: bool, reference: Option<Reference>) -> LimitConditions {
    let config = Config::default();
    let position = Vector3::new(x, 0.0, 1.0);
    let pose = MeasuredPose { position, attitude: Attitude::LEVEL };
    let motion = &track(&config, &pose);
    let reference = &reference.unwrap_or(Reference::rest(position, Phase::Trajectory));
    let flight = FlightView { motion, floor_m: 0.0, reference, thrust_n: 5.0, is_descent };
    let mut conditions = LimitConditions::default();
    FlightLimits::new(&config).check(&flight, &mut conditions);
    conditions
}

#[test]
fn f37_an_uncertain_vehicle_stays_three_standard_deviations_from_the_border() {
    let pose = MeasuredPose { position: Vector3::zeros(), attitude: Attitude::LEVEL };
    let config = Config::default();
    let sd_m = track(&config, &pose).position_sd_m();
    let border_m = config.fence.x_m[1];
    for (deviations, leaves, descending_leaves) in
        [(3.2, false, false), (2.8, true, false), (0.7, true, false), (0.3, true, true)]
    {
        let x = border_m - deviations * sd_m;
        let conditions = checked(x, false, None);
        assert_eq!(conditions.leaves_fence, leaves, "{deviations}");
        let conditions = checked(x, true, None);
        assert_eq!(conditions.leaves_fence, descending_leaves, "{deviations}, descending");
    }
}

#[test]
fn f44_a_vehicle_may_be_anywhere_while_an_attitude_is_prescribed() {
    let far = Reference::rest(Vector3::new(5.0, 0.0, 1.0), Phase::Trajectory);
    let turned = Some(AttitudeReference::at_rest(Attitude::LEVEL));
    let prescribed = Reference { attitude: turned, ..far };
    assert!(checked(0.0, false, Some(far)).far_off);
    assert!(!checked(0.0, false, Some(prescribed)).far_off);
}
