//! Replays of recordings with other settings.

use crate::common::{Testbed, assert_refused, number};
use serde_json::Value;

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

#[test]
fn another_setting_is_replayed_open_loop_with_the_difference_of_its_commands() {
    let testbed = Testbed::new("open");
    let hover = ["--trajectory", "hover", "--duration", "1", "--set", "trajectory.settle-s=0.5"];
    testbed.summary(&[&hover[..], &["--clock", "lockstep", "--out", "d"]].concat());
    let file = "d/flight.mcap";
    let text = testbed.succeeds(&["replay", file, "--controller", "geometric", "--out", "c.csv"]);
    assert!(text.contains("open loop"), "{text}");
    let result = json(&testbed.succeeds(&["replay", file, "--controller", "pid", "--json"]));
    assert!(number(&result, "/greatest_difference") > 0.0, "{result}");
    let rows = std::fs::read_to_string(testbed.path("c.csv")).unwrap();
    assert_eq!(rows.lines().count() as f64, number(&result, "/ticks") + 1.0);
    let magic = ["replay", file, "--set", "control.controller=magic"];
    assert_refused(&testbed.study(&magic).output().unwrap(), 78, &["magic"]);
}

#[test]
fn a_replayed_daemon_that_stops_before_the_end_is_told_with_the_ticks_without_a_counterpart() {
    let testbed = Testbed::new("open-stop");
    let fast = ["mocap.rate-hz=120", "vehicle.rate-authority-rad-s=[3.4,3.1,1.7]"];
    let mut words = vec!["--trajectory", "lemniscate", "--duration", "4", "--clock", "lockstep"];
    words.extend(["--controller", "oqtal-dt", "--out", "d"]);
    words.extend(fast.into_iter().flat_map(|setting| ["--set", setting]));
    testbed.summary(&words);
    let replay = ["replay", "d/flight.mcap", "--set", "trajectory.lemniscate.period-s=4"];
    let text = testbed.succeeds(&replay);
    assert!(text.contains("the replayed daemon stopped the motors at t = "), "{text}");
    let result = json(&testbed.succeeds(&[&replay[..], &["--json"]].concat()));
    let (ticks, without) = (number(&result, "/ticks"), number(&result, "/not_replayed"));
    let told = format!("{without} of {} recorded ticks have no counterpart", ticks + without);
    assert!(without > 0.0 && text.contains(&told), "{told} in\n{text}");
    assert_eq!(result["own_stop"]["cause"], "poses not as predicted", "{result}");
    let same = json(&testbed.succeeds(&["replay", "d/flight.mcap", "--json"]));
    assert_eq!((&same["own_stop"], &same["not_replayed"]), (&Value::Null, &Value::from(0)));
}
