//! A flight that the check before the start accepts is not held by the fence.

use nalgebra::Vector3;
use oqtal_config::Config;
use oqtal_daemon::{require_flyable, trajectory};
use oqtal_lab::mission::Mission;
use oqtal_observe::flight::Outcome;

use crate::{config, flown};

/// A circle of this radius \[m\] and speed \[m/s\] in a fence that begins at x = -`width_m`.
fn circle(law: &str, [radius_m, speed_m_s]: [f64; 2], width_m: f64, seed: u64) -> Config {
    let period_s = std::f64::consts::TAU * radius_m / speed_m_s;
    config(&[
        format!("control.controller={law}"),
        "trajectory.kind=circle".to_owned(),
        format!("trajectory.circle.radius-m={radius_m}"),
        format!("trajectory.circle.period-s={period_s}"),
        format!("fence.x-m=[-{width_m}, 20.0]"),
        "fence.y-m=[-20.0, 20.0]".to_owned(),
        format!("clock.seed={seed}"),
    ])
}

/// Least accepted width, to a millimetre \[m\].
fn least_width(motion: [f64; 2]) -> f64 {
    let is_accepted = |width_m: f64| {
        let config = circle("oqtal-dt", motion, width_m, 1);
        require_flyable(&config, &trajectory(&config).unwrap(), Some(Vector3::zeros())).is_ok()
    };
    let (mut refused, mut accepted) = (0.1, 20.0);
    while accepted - refused > 1e-3 {
        let middle = 0.5 * (refused + accepted);
        *(if is_accepted(middle) { &mut accepted } else { &mut refused }) = middle;
    }
    accepted
}

#[test]
fn a_flight_in_the_narrowest_accepted_fence_is_not_held() {
    for motion in [[0.65, 0.51], [1.0, 1.0], [1.5, 1.6], [2.0, 2.5], [3.0, 3.2], [3.0, 3.8]] {
        let width_m = least_width(motion);
        for (law, seed) in ["oqtal-dt", "geometric"]
            .into_iter()
            .flat_map(|law| (1..=5).map(move |seed| (law, seed)))
        {
            let flight = flown(circle(law, motion, width_m, seed));
            let told = format!("{law}, {motion:?}, seed {seed}: {:?}", flight.shortfall());
            assert!(flight.held_s() == 0.0 && flight.outcome == Outcome::Landed, "{told}");
        }
    }
}

/// The remedies that a refusal names, as settings.
fn remedies(refusal: &str) -> Vec<String> {
    let values = refusal.split("trajectory.").skip(1).filter_map(|text| {
        let (key, rest) = text.split_once(" = ")?;
        let value = rest.split_whitespace().next()?;
        Some(format!("trajectory.{key}={value}"))
    });
    values.collect()
}

/// The vehicle is faster than its reference while it leaves the floor and while it lands.
#[test]
fn a_take_off_with_the_named_remedies_is_not_too_fast() {
    for limit in [0.1, 0.2, 0.3, 0.45, 0.6] {
        let limited = format!("safety.speed-limit-m-s={limit}");
        let mut settings = vec!["trajectory.kind=hover".to_owned(), limited];
        let refused = Mission::new(config(&settings)).unwrap_err();
        settings.extend(remedies(&refused.message));
        assert_eq!(settings.len(), if limit < 0.5 { 4 } else { 3 }, "{}", refused.message);
        assert_eq!(flown(config(&settings)).shortfall(), None, "{limit} m/s");
    }
}
