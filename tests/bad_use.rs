//! Misuse of the program: each case produces a clear message and its exit code.

use std::process::{Command, Stdio};

use clap::CommandFactory;
use oqtal::cli::Cli;

use crate::common::{Testbed, assert_refused, json, stderr};

/// Runs `oqtal fly` with the given arguments; expects an exit code and parts of the error message.
#[track_caller]
fn refused(words: &[&str], code: i32, parts: &[&str]) {
    let testbed = Testbed::new("bad");
    let output = testbed.fly(words);
    assert_refused(&output, code, parts);
    assert!(output.stdout.is_empty(), "results on standard output");
    assert!(testbed.remains().is_empty());
}

#[test]
fn an_unknown_controller_is_refused_with_the_known_names() {
    refused(&["--controller", "magic"], 78, &["--controller", "magic", "pid", "lqr", "oqtal"]);
}

#[test]
fn an_unknown_flag_is_a_usage_error() {
    refused(&["--colour"], 64, &["--colour"]);
    refused(&["--vehicle", "boat"], 64, &["sim[:hummingbird|:spacecraft", "link:LINK"]);
    refused(&["--mocap", "replay:"], 64, &["replay:FILE"]);
}

/// Failures, with their exit codes, at least one of each command with `--json`.
const FAILURES: [(&[&str], i32); 21] = [
    (&["info", "nowhere"], 65),
    (&["replay", "nowhere"], 65),
    (&["report", "nowhere"], 65),
    (&["fly", "--controller", "magic"], 78),
    (&["--controller", "magic"], 78),
    (&["ctl", "bogus"], 64),
    (&["latency", "--config", "nowhere.toml"], 78),
    (&["doctor", "--config", "nowhere.toml"], 78),
    (&["sweep", "nothing=1:2:2"], 78),
    (&["identify", "nowhere"], 65),
    (&["campaign", "--laws", "magic"], 64),
    (&["reproduce", "--out", "/dev/null/results"], 71),
    (&["robustness", "--laws", "magic"], 64),
    (&["cameras", "statistics", "nowhere"], 65),
    (&["cameras", "noise", "--set", "nothing=1"], 78),
    (&["cameras", "estimation", "--set", "nothing=1"], 78),
    (&["receiver", "discover", "--seconds", "0"], 64),
    (&["receiver", "probe", "bogus:127.0.0.1"], 64),
    (&["receiver", "probe", "qtm:127.0.0.1", "--config", "nowhere.toml"], 78),
    (&["mocap-emu", "serve", "--replay", "nowhere.csv"], 65),
    (&["mocap-emu", "serve", "--listen", "nowhere"], 78),
];

/// Words of every command below `command`, itself at `words`, that has the flag `--json`.
fn with_json<'a>(command: &'a clap::Command, words: &[&'a str]) -> Vec<Vec<&'a str>> {
    let has_json = command.get_arguments().any(|it| it.get_long() == Some("json"));
    let below =
        command.get_subcommands().flat_map(|it| with_json(it, &[words, &[it.get_name()]].concat()));
    has_json.then(|| words.to_vec()).into_iter().chain(below).collect()
}

#[test]
fn with_json_a_failure_is_one_document() {
    let testbed = Testbed::new("failures");
    let program = Cli::command();
    let untested = with_json(&program, &[])
        .into_iter()
        .find(|command| FAILURES.iter().all(|(words, _)| !words.starts_with(command)));
    assert_eq!(untested, None, "a failure for each command with --json");
    for (words, code) in FAILURES {
        let output = testbed.study(&[words, &["--json"]].concat()).output().unwrap();
        let document = json(&output);
        let command = if words[0].starts_with('-') { "fly" } else { words[0] };
        assert_eq!((&document["command"], &document["answer"]), (&command.into(), &"none".into()));
        assert_eq!((output.status.code(), &document["exit_code"]), (Some(code), &code.into()));
        let error = document["error"].as_str().unwrap();
        assert!(!error.is_empty() && stderr(&output).contains(error), "{error}");
    }
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
        assert_refused(&output, 64, &["`a/b`", "a-z, 0-9 and -"]);
    }
}

#[test]
fn help_succeeds_and_a_wrong_word_fails_in_every_process() {
    for process in ["daemon", "plant-sim", "mocap-emu", "bridge"] {
        let testbed = Testbed::new("words");
        let code = |word| testbed.oqtal(&[process, word]).output().unwrap().status.code();
        assert_eq!((code("--help"), code("fly")), (Some(0), Some(64)), "{process}");
    }
}

#[test]
fn a_root_that_cannot_be_created_is_a_system_error() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_oqtal"));
    let output = command.args(["ctl", "status", "--root", "/dev/null/oqtal"]).output().unwrap();
    assert_refused(&output, 71, &[]);
}

#[test]
fn a_process_checks_the_configuration_that_it_would_use() {
    let testbed = Testbed::new("check");
    let waypoints = ["daemon", "check", "--set", "trajectory.kind=waypoints"];
    testbed.refuses(&waypoints, 78, &["waypoints-file"]);
    let replay = ["mocap-emu", "check", "--set", "mocap.replay=nowhere.csv"];
    testbed.refuses(&replay, 65, &["nowhere.csv"]);
}

#[test]
fn a_check_reports_the_rate_of_the_loop() {
    let testbed = Testbed::new("rates");
    let file = testbed.write("fast.toml", "[mocap]\nrate-hz = 100.0\n");
    let output = testbed.oqtal(&["daemon", "check", "--config", file.to_str().unwrap()]).output();
    let said = String::from_utf8(output.unwrap().stdout).unwrap();
    assert!(said.starts_with("# hash ") && said.contains("\n# poses expected at 100 Hz"), "{said}");
    assert!(said.lines().nth(1).unwrap().ends_with("one pose in 2, at 50.0000 Hz"), "{said}");
    assert!(said.parse::<toml::Table>().is_ok(), "{said}");
}

#[test]
fn a_flight_warns_of_requests_that_cannot_be_met() {
    let testbed = Testbed::new("warned");
    let told = |words: &[&str]| {
        let brief = ["--clock", "in-process", "--duration", "1", "--json"];
        let output = testbed.fly(&[&brief[..], words].concat());
        (output.status.code(), stderr(&output))
    };
    let (_, message) = told(&["--set", "control.rate-hz=80"]);
    assert!(
        message.contains("warning: poses expected at 60 Hz, control.rate-hz = 80"),
        "{message}"
    );
    let waypoints = |text: &str| {
        let file = testbed.write("way.csv", text).display().to_string();
        told(&[
            "--trajectory",
            "waypoints",
            "--set",
            &format!("trajectory.waypoints-file={file:?}"),
        ])
    };
    let (_, message) = waypoints("t,x,y,z\n0,0,0,1\n1,1,0,1\n");
    for part in ["warning: at 0.50 s", "1.50 m/s", "position.horizontal-velocity-limit-m-s"] {
        assert!(message.contains(part), "{message}");
    }
    let (code, message) = waypoints("t,x,y,z,yaw\n0,0,0,1,0\n9,1,0,1,90\n");
    assert_eq!(code, Some(65), "{message}");
    assert!(message.contains("way.csv:1: ") && message.contains("yaw_deg"), "{message}");
    let (_, message) = told(&[]);
    assert!(!message.contains("warning"), "{message}");
}

#[test]
fn of_two_settings_in_conflict_the_one_that_was_changed_is_named() {
    let circle = ["--trajectory", "circle", "--set", "trajectory.circle.radius-m=9"];
    refused(&circle, 78, &["`trajectory.kind` = \"circle\"", "`fence.y-m` is [-8, 8]"]);
    let rate = ["--set", "control.rate-hz=200"];
    refused(&rate, 78, &["--set: with `control.rate-hz` = 200", "`safety.pose-rate-hz` is 60"]);
}

#[test]
fn a_closed_output_pipe_is_not_an_error() {
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
    // The daemon's parent is this test, not process 1.
    testbed.refuses(&["daemon", "run", "--child", "1"], 75, &["has ended"]);
}

/// Expects that a configuration file is refused with the number of the bad line and the given parts of the message.
#[track_caller]
fn bad_config(text: &str, line: usize, parts: &[&str]) {
    let testbed = Testbed::new("bad-config");
    let file = testbed.write("bad.toml", text);
    let place = format!("bad.toml:{line}: ");
    let parts = [&[place.as_str()], parts].concat();
    testbed.refuses(&["fly", "--config", file.to_str().unwrap()], 78, &parts);
}

#[test]
fn f30_a_bad_configuration_is_refused_with_file_and_line() {
    bad_config("[vehicle]\n\nmass-kg = -0.5\n", 3, &["vehicle.mass-kg", "above 0", "-0.5"]);
    bad_config(
        "[vehicle]\nmas-kg = 0.5\n",
        2,
        &["mas-kg", "unknown key", "did you mean `vehicle.mass-kg`"],
    );
    bad_config(
        "[vehicle]\nmass-kg = \"heavy\"\n",
        2,
        &["vehicle.mass-kg", "found \"heavy\", expected a number"],
    );
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
fn an_incomplete_flight_reports_the_reason() {
    let testbed = Testbed::new("incomplete");
    let base = ["--clock", "in-process", "--trajectory", "hover", "--duration", "2", "--json"];
    for (setting, outcome, says) in [
        (
            "plant.disturb=[\"force@6+0.5=6,0,0N\"]",
            "landed",
            "before the end of the flight: too fast",
        ),
        ("safety.arming-z-m=[1,2]", "timeout", "no take-off: the vehicle is not on the floor"),
        ("plant.battery.full-v=10", "timeout", "no take-off yet: the battery is low"),
    ] {
        let output = testbed.fly(&[&base[..], &["--set", setting]].concat());
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{setting}: {message}");
        assert_eq!(json(&output)["outcome"], outcome, "{setting}: {message}");
        assert!(message.contains(says), "{setting}: {message}");
    }
    let output = testbed.fly(&base);
    assert_eq!((output.status.code(), stderr(&output).as_str()), (Some(0), ""));
}

#[test]
fn a_limit_of_file_sizes_fails_as_a_full_disk_does_and_the_flight_lands() {
    let testbed = Testbed::new("file-size");
    let words = ["fly", "--clock", "in-process", "--trajectory", "hover", "--duration", "40"];
    let fly = testbed.oqtal(&[&words[..], &["--json"]].concat());
    let mut shell = Command::new("sh");
    // The limit is in blocks of 512 bytes.
    shell.args(["-c", "ulimit -f 400; exec \"$0\" \"$@\""]).arg(fly.get_program());
    let output = shell.args(fly.get_args()).current_dir(testbed.path("")).output().unwrap();
    assert_refused(&output, 71, &["File too large"]);
    assert_eq!(json(&output)["outcome"], "landed");
}

#[test]
fn endless_files_are_refused() {
    let words = ["--config", "/dev/zero"];
    refused(&words, 78, &["/dev/zero", "longer than 1 MiB"]);
    let waypoints = "trajectory.waypoints-file=\"/dev/zero\"";
    let words = ["--trajectory", "waypoints", "--set", waypoints];
    refused(&words, 65, &["/dev/zero", "longer than"]);
}

/// Links and scales are parsed by the processes that use them; their errors also name the line.
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
        assert_refused(&output, 78, &["bad.toml:2: ", says]);
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
    assert_refused(&output, 78, &["OQTAL_VEHICLE__MASS_KG"]);
}

/// Expects that a recording is refused with exit code 65 and the number of the bad line.
#[track_caller]
fn bad_recording(text: &str, line: usize, part: &str) {
    let testbed = Testbed::new("bad-recording");
    let file = format!("replay:{}", testbed.write("flight.csv", text).display());
    let place = format!("flight.csv:{line}: ");
    testbed.refuses(&["fly", "--mocap", &file], 65, &[&place, part]);
}

#[test]
fn a_broken_recording_is_refused_with_file_and_line() {
    let head = "t,x,y,z,qx,qy,qz,qw\n0.0,0,0,1,0,0,0,1\n";
    bad_recording(&format!("{head}0.02,0,0\n"), 3, "fields");
    bad_recording(&format!("{head}0.02,nan,0,1,0,0,0,1\n"), 3, "finite");
    bad_recording(&format!("{head}-1.0,0,0,1,0,0,0,1\n"), 3, "back");
    bad_recording("t,x,y,qx,qy,qz,qw\n0,0,0,0,0,0,1\n", 1, "z");
    bad_recording("", 1, "empty");
    Testbed::new("bad-recording").refuses(&["fly", "--mocap", "replay:nowhere.csv"], 65, &[]);
}

#[test]
fn a_flag_wins_over_a_variable_in_every_process() {
    let testbed = Testbed::new("variable");
    let words =
        ["fly", "--clock", "lockstep", "--trajectory", "hover", "--duration", "1", "--json"];
    let mut command = testbed.oqtal(&words);
    command.args(["--controller", "pid"]).env("OQTAL_CONTROL__CONTROLLER", "lqr");
    let summary = json(&command.output().unwrap());
    assert_eq!(summary["controller"], "pid");
    assert_eq!(summary["riccati_solves"], 0, "the daemon flew with the variable's law");
}
