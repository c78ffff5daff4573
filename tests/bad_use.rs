//! Misuse of the program: each case gives a clear message and its exit code.

mod common;

use std::process::{Command, Stdio};

use common::{Testbed, stderr};

/// Runs `oqtal fly` with the given arguments; expects an exit code and parts of the error message.
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
    refused(&["--vehicle", "boat"], 64, &["sim[:hummingbird|:spacecraft", "link:LINK"]);
    refused(&["--mocap", "replay:"], 64, &["replay:FILE"]);
}

#[test]
fn a_missing_configuration_file_is_named() {
    refused(&["--config", "nowhere.toml"], 78, &["nowhere.toml", "No such file"]);
}

#[test]
fn an_instance_name_must_be_plain() {
    for words in [&["ctl", "status"][..], &["daemon", "run"], &["fly", "--clock", "in-process"]] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_oqtal"));
        let output = command.args(words).args(["--instance", "a/b"]).output().unwrap();
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(64), "{message}");
        assert!(message.contains("`a/b`") && message.contains("a-z, 0-9 and -"), "{message}");
    }
}

#[test]
fn help_is_no_error_and_a_wrong_word_is_one_in_every_process() {
    for process in ["daemon", "plant-sim", "mocap-emu", "bridge"] {
        let testbed = Testbed::new("words");
        let code = |word| testbed.oqtal(&[process, word]).output().unwrap().status.code();
        assert_eq!((code("--help"), code("fly")), (Some(0), Some(64)), "{process}");
    }
}

#[test]
fn a_root_that_cannot_be_made_is_a_fault_of_the_system() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_oqtal"));
    let output = command.args(["ctl", "status", "--root", "/dev/null/oqtal"]).output().unwrap();
    assert_eq!(output.status.code(), Some(71), "{}", stderr(&output));
}

#[test]
fn a_process_checks_what_it_would_run_with() {
    let testbed = Testbed::new("check");
    let check = |process: &str, setting: &str| {
        let output = testbed.oqtal(&[process, "check", "--set", setting]).output().unwrap();
        (output.status.code(), stderr(&output))
    };
    let (code, message) = check("daemon", "trajectory.kind=waypoints");
    assert_eq!(code, Some(78));
    assert!(message.contains("waypoints-file"), "{message}");
    let (code, message) = check("mocap-emu", "mocap.replay=nowhere.csv");
    assert_eq!(code, Some(65));
    assert!(message.contains("nowhere.csv"), "{message}");
}

#[test]
fn a_check_says_at_which_rate_the_loop_will_run() {
    let testbed = Testbed::new("rates");
    let file = testbed.write("fast.toml", "[mocap]\nrate-hz = 100.0\n");
    let output = testbed.oqtal(&["daemon", "check", "--config", file.to_str().unwrap()]).output();
    let said = String::from_utf8(output.unwrap().stdout).unwrap();
    assert!(said.starts_with("# cameras at 100 Hz"), "{said}");
    assert!(said.lines().next().unwrap().ends_with("one pose in 2, at 50.0000 Hz"), "{said}");
    assert!(said.parse::<toml::Table>().is_ok(), "{said}");
}

#[test]
fn what_a_flight_asks_for_and_will_not_get_is_told_before_it() {
    let testbed = Testbed::new("warned");
    let told = |words: &[&str]| {
        let brief = ["--clock", "in-process", "--duration", "1", "--json"];
        let output = testbed.fly(&[&brief[..], words].concat());
        (output.status.code(), stderr(&output))
    };
    let (_, message) = told(&["--set", "control.rate-hz=80"]);
    assert!(message.contains("warning: cameras at 60 Hz, control.rate-hz = 80"), "{message}");
    let waypoints = |text: &str| {
        let file = testbed.write("way.csv", text).display().to_string();
        told(&[
            "--trajectory",
            "waypoints",
            "--set",
            &format!("trajectory.waypoints-file={file:?}"),
        ])
    };
    let (_, message) = waypoints("t,x,y,z\n0,0,0,1\n1,6,0,1\n");
    for part in ["warning: at 0.50 s", "9.00 m/s", "position.horizontal-velocity-limit-m-s"] {
        assert!(message.contains(part), "{message}");
    }
    let (code, message) = waypoints("t,x,y,z,yaw\n0,0,0,1,0\n9,1,0,1,90\n");
    assert_eq!(code, Some(65), "{message}");
    assert!(message.contains("way.csv:1: ") && message.contains("yaw_deg"), "{message}");
    let (_, message) = told(&[]);
    assert!(!message.contains("warning"), "{message}");
}

#[test]
fn the_setting_that_makes_another_value_impossible_is_blamed() {
    let circle = ["--trajectory", "circle", "--set", "trajectory.circle.radius-m=9"];
    refused(&circle, 78, &["`trajectory.kind` = \"circle\"", "`fence.x-m` is [-8, 8]"]);
    let rate = ["--set", "control.rate-hz=200"];
    refused(&rate, 78, &["--set: with `control.rate-hz` = 200", "`safety.pose-rate-hz` is 60"]);
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let testbed = Testbed::new("pipe");
    let short = ["fly", "--clock", "in-process", "--trajectory", "hover", "--duration", "1"];
    for words in [&short[..], &[&short[..], &["--json"]].concat(), &["daemon", "check"]] {
        let mut command = testbed.oqtal(words);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{words:?}: {}", stderr(&output));
        assert!(!stderr(&output).contains("panicked"), "{words:?}: {}", stderr(&output));
    }
}

#[test]
fn a_child_whose_parent_is_gone_ends() {
    let testbed = Testbed::new("orphan");
    // The parent of the daemon is this test, not process 1.
    let output = testbed.oqtal(&["daemon", "run", "--child", "1"]).output().unwrap();
    assert_eq!(output.status.code(), Some(75));
    assert!(stderr(&output).contains("has ended"), "{}", stderr(&output));
}

/// Expects that a configuration file is refused with the number of the bad line and the given parts of the message.
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
    bad_config("[vehicle]\n\nmass-kg = -0.5\n", 3, &["vehicle.mass-kg", "above 0", "-0.5"]);
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
    bad_config("[plant]\n\nmass-kg = -0.5\n", 3, &["plant.mass-kg", "above 0", "-0.5"]);
    bad_config("[bridge]\nlink = \"/dev/ttyUSB0\"\n", 2, &["bridge.link", "asctec:PATH"]);
    bad_config("[fence]\nsoft-margin-m = 9.0\n", 2, &["fence.soft-margin-m", "x-m"]);
    bad_config("[vehicle]\nmass-kg = 1e400\n", 2, &[]);
    bad_config("[clock]\nseed = 999999999999999999999999999999999999999999\n", 2, &[]);
    bad_config("[trajectory.square]\nside-m = -1.0\n", 2, &["side-m"]);
}

#[test]
fn a_flight_that_does_not_complete_says_why() {
    let testbed = Testbed::new("incomplete");
    let base = ["--clock", "in-process", "--trajectory", "hover", "--duration", "2", "--json"];
    for (setting, outcome, says) in [
        ("safety.speed-limit-m-s=0.5", "landed", "before the end of the flight: too fast"),
        ("safety.arming-z-m=[1,2]", "timeout", "no take-off: the vehicle is not on the floor"),
        ("plant.battery.full-v=10", "timeout", "no take-off yet: the battery is low"),
    ] {
        let output = testbed.fly(&[&base[..], &["--set", setting]].concat());
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{setting}: {message}");
        let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(summary["outcome"], outcome, "{setting}: {message}");
        assert!(message.contains(says), "{setting}: {message}");
    }
    let output = testbed.fly(&base);
    assert_eq!((output.status.code(), stderr(&output).as_str()), (Some(0), ""));
}

#[test]
fn a_limit_of_file_sizes_fails_as_a_full_disk_does_and_the_flight_goes_on() {
    let testbed = Testbed::new("file-size");
    let words = ["fly", "--clock", "in-process", "--trajectory", "hover", "--duration", "40"];
    let fly = testbed.oqtal(&[&words[..], &["--json"]].concat());
    let mut shell = Command::new("sh");
    // In blocks of 512 bytes.
    shell.args(["-c", "ulimit -f 400; exec \"$0\" \"$@\""]).arg(fly.get_program());
    let output = shell.args(fly.get_args()).current_dir(testbed.path("")).output().unwrap();
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(71), "{message}");
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["outcome"], "landed", "{message}");
    assert!(message.contains("File too large"), "{message}");
}

#[test]
fn files_without_end_are_refused() {
    let words = ["--config", "/dev/zero"];
    refused(&words, 78, &["/dev/zero", "longer than 1 MiB"]);
    let waypoints = "trajectory.waypoints-file=\"/dev/zero\"";
    let words = ["--trajectory", "waypoints", "--set", waypoints];
    refused(&words, 65, &["/dev/zero", "longer than"]);
}

/// Links and scales are read by the processes that use them, and say the line all the same.
#[test]
fn a_check_names_the_line_of_a_value_that_only_a_process_reads() {
    for (text, says) in [
        ("[bridge]\nlink = \"/dev/ttyUSB0\"\n", "bridge.link"),
        ("[bridge]\nxbee-address = \"12\"\n", "hexadecimal"),
        ("[bridge.asctec]\nmotor-yaw-counts = 0\n", "motor-yaw-counts"),
        ("[plant.wire]\nlink = \"mavlink:/tmp/x\"\n", "plant.wire.link"),
        ("[instance]\nname = \"A B\"\n", "instance.name"),
    ] {
        let testbed = Testbed::new("process-values");
        let file = testbed.write("bad.toml", text);
        let mut command = Command::new(env!("CARGO_BIN_EXE_oqtal"));
        let output = command.arg("check").arg(&file).output().unwrap();
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(78), "{text}: {message}");
        assert!(message.contains("bad.toml:2: ") && message.contains(says), "{text}: {message}");
    }
}

#[test]
fn the_interfaces_that_a_vehicle_can_have_are_named() {
    let words = ["--set", "vehicle.interface=thrust"];
    refused(&words, 78, &["vehicle.interface", "thrust", "rate", "torque", "attitude"]);
}

#[test]
fn a_variable_is_named_when_it_is_wrong() {
    let testbed = Testbed::new("bad-variable");
    let output = testbed.oqtal(&["fly"]).env("OQTAL_VEHICLE__MASS_KG", "-1").output().unwrap();
    assert_eq!(output.status.code(), Some(78));
    assert!(stderr(&output).contains("OQTAL_VEHICLE__MASS_KG"), "{}", stderr(&output));
}

/// Expects that a recording is refused with exit code 65 and the number of the bad line.
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

#[test]
fn a_flag_wins_over_a_variable_in_every_process() {
    let testbed = Testbed::new("variable");
    let words =
        ["fly", "--clock", "lockstep", "--trajectory", "hover", "--duration", "1", "--json"];
    let mut command = testbed.oqtal(&words);
    command.args(["--controller", "pid"]).env("OQTAL_CONTROL__CONTROLLER", "lqr");
    let output = command.output().unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["controller"], "pid");
    assert_eq!(summary["riccati_solves"], 0, "the daemon flew with the variable's law");
}
