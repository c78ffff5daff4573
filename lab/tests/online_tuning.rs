//! Loops tuned in flight.

use oqtal_config::Setting;
use oqtal_lab::progress::Progress;
use oqtal_lab::tune::online::{LOOPS, tune};
use oqtal_observe::flight::Outcome;

/// Climb loop with a quarter of its gains: the colony finds better ones in one flight.
#[test]
fn a_slack_loop_is_tuned_in_one_flight_that_lands() {
    let settings = [
        Setting::flag("test", "position.vertical-velocity.kp", 0.75),
        Setting::flag("test", "position.vertical-velocity.ki", 0.25),
    ];
    let tuned = tune(&settings, &LOOPS[..1], &Progress::default()).unwrap();
    assert_eq!(tuned.outcome, Outcome::Landed);
    assert!(tuned.flown_s < 200.0 && tuned.furthest_m < 1.0, "{tuned:?}");
    let climb = tuned.loops[0];
    assert!(climb.name == "V_Z" && climb.gains[0].kp == 0.75, "{climb:?}");
    assert!(climb.gains[1].kp > 1.5 * climb.gains[0].kp, "{climb:?}");
    assert!(climb.error[1] < 0.8 * climb.error[0], "{climb:?}");
    assert!((15..=27).contains(&climb.bees), "{climb:?}");
}
