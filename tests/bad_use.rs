//! Bad use: each a clear message and its exit code.

mod common;

use common::{Testbed, stderr};

/// Flies with these words and expects this exit code and these words in the message.
fn refused(words: &[&str], code: i32, says: &[&str]) {
    let testbed = Testbed::new("bad");
    let output = testbed.fly(words);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{words:?}: {message}");
    for word in says {
        assert!(message.contains(word), "{words:?} says: {message}");
    }
    assert!(output.stdout.is_empty(), "results on standard output");
    assert!(testbed.remains().is_empty());
}

#[test]
fn an_unknown_controller_names_those_there_are() {
    refused(&["--controller", "magic"], 78, &["--controller", "magic", "pid", "lqr", "oqtal"]);
}

#[test]
fn an_unknown_flag_is_a_usage_error() {
    refused(&["--colour"], 64, &["--colour"]);
    refused(&["--vehicle", "boat"], 64, &["sim[:hummingbird|:spacecraft]"]);
    refused(&["--mocap", "replay:"], 64, &["replay:FILE"]);
}

#[test]
fn a_missing_configuration_file_is_named() {
    refused(&["--config", "nowhere.toml"], 78, &["nowhere.toml", "No such file"]);
}

#[test]
fn an_instance_name_must_be_plain() {
    let output =
        Testbed::new("bad").oqtal(&["ctl", "status"]).arg("--instance").arg("a/b").output();
    // Given twice, it is a usage error before its value matters; alone, the rule is named.
    assert_eq!(output.unwrap().status.code(), Some(64));
    let error = oqtal_bus::place::Place::new("a/b", None).unwrap_err();
    assert!(error.to_string().contains("a-z, 0-9 and -"), "{error}");
}

/// A configuration file with these lines is refused, naming the line and the rule.
fn bad_config(text: &str, line: usize, says: &[&str]) {
    let testbed = Testbed::new("bad-config");
    let file = testbed.write("bad.toml", text);
    let output = testbed.fly(&["--config", file.to_str().unwrap()]);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(78), "{message}");
    assert!(message.contains(&format!("bad.toml:{line}: ")), "{message}");
    for word in says {
        assert!(message.contains(word), "{message}");
    }
}

#[test]
fn f30_a_bad_configuration_is_refused_with_file_and_line() {
    bad_config("[vehicle]\n\nmass-kg = -0.5\n", 3, &["vehicle.mass-kg", "above zero", "-0.5"]);
    bad_config("[vehicle]\nmas-kg = 0.5\n", 2, &["mas-kg", "unknown field", "mass-kg"]);
    bad_config("[vehicle]\nmass-kg = \"heavy\"\n", 2, &["vehicle.mass-kg", "invalid type"]);
    bad_config("[flight]\nx = 1\n", 2, &["flight"]);
    bad_config("[vehicle]\nmass-kg = \n", 2, &[]);
    bad_config(
        "[vehicle]\ninertia-kg-m2 = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]\n",
        2,
        &["inertia", "positive definite"],
    );
    bad_config("[control.oqtal]\nattitude-weight = -1.0\n", 2, &["attitude-weight"]);
    bad_config("[position]\ntilt-limit-deg = 90.0\n", 2, &["tilt-limit-deg"]);
    bad_config("[trajectory.square]\nside-m = -1.0\n", 2, &["side-m"]);
}

#[test]
fn a_variable_is_named_when_it_is_wrong() {
    let testbed = Testbed::new("bad-variable");
    let output = testbed.oqtal(&["fly"]).env("OQTAL_VEHICLE__MASS_KG", "-1").output().unwrap();
    assert_eq!(output.status.code(), Some(78));
    assert!(stderr(&output).contains("OQTAL_VEHICLE__MASS_KG"), "{}", stderr(&output));
}

/// A recording with this text is refused with exit code 65, naming its line.
fn bad_recording(text: &str, line: usize, says: &str) {
    let testbed = Testbed::new("bad-recording");
    let file = testbed.write("flight.csv", text);
    let output = testbed.fly(&["--mocap", &format!("replay:{}", file.display())]);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(65), "{message}");
    assert!(message.contains(&format!("flight.csv:{line}: ")), "{message}");
    assert!(message.contains(says), "{message}");
}

#[test]
fn a_broken_recording_is_refused_with_file_and_line() {
    let head = "t,x,y,z,qx,qy,qz,qw\n0.0,0,0,1,0,0,0,1\n";
    bad_recording(&format!("{head}0.02,0,0\n"), 3, "fields");
    bad_recording(&format!("{head}0.02,nan,0,1,0,0,0,1\n"), 3, "finite");
    bad_recording(&format!("{head}-1.0,0,0,1,0,0,0,1\n"), 3, "back");
    bad_recording("t,x,y,qx,qy,qz,qw\n0,0,0,0,0,0,1\n", 1, "z");
    bad_recording("", 1, "empty");
    let missing = Testbed::new("bad-recording").fly(&["--mocap", "replay:nowhere.csv"]);
    assert_eq!(missing.status.code(), Some(65));
}
