//! Injected faults, `oqtal fly --fault`, through processes: the command lines of docs/faults.md and their results.

use crate::common::{Testbed, number, stderr};
use serde_json::Value;

/// A short flight in virtual time: 3 s of hover, 13 s in total. The faults begin in the hover.
const HOVER: [&str; 6] = ["fly", "--trajectory", "hover", "--duration", "3", "--json"];
/// A longer one, for faults that take their time.
const LONG_HOVER: [&str; 6] = ["fly", "--trajectory", "hover", "--duration", "20", "--json"];
/// A shorter flight in real time, for faults that end it.
const BRIEF: [&str; 6] = ["fly", "--trajectory", "hover", "--duration", "1", "--json"];

/// Results of a flight with a fault.
struct Flown {
    code: Option<i32>,
    summary: Value,
    /// Content of `telemetry.csv`, one row per tick.
    table: Vec<Vec<String>>,
    message: String,
}

impl Flown {
    fn passed(&self, state: &str) -> bool {
        self.summary["state_sequence"].as_array().unwrap().iter().any(|passed| passed == state)
    }

    #[track_caller]
    fn lands(&self) -> &Self {
        assert_eq!(self.summary["outcome"], "landed", "{} {}", self.summary, self.message);
        self
    }

    #[track_caller]
    fn is_stopped_for(&self, cause: &str) -> &Self {
        assert_eq!(self.summary["outcome"], "stopped", "{} {}", self.summary, self.message);
        self.by(cause)
    }

    /// Checks that the fault caused a state.
    #[track_caller]
    fn by(&self, cause: &str) -> &Self {
        let causes = self.column("cause");
        assert!(causes.contains(&cause), "{causes:?}");
        self
    }

    /// A column of the table.
    fn column(&self, name: &str) -> Vec<&str> {
        let column = self.table[0].iter().position(|column| column == name).unwrap();
        self.table[1..].iter().map(|row| row[column].as_str()).collect()
    }

    /// A column of the table as numbers; NaN for an empty cell.
    fn numbers(&self, name: &str) -> Vec<f64> {
        self.column(name).iter().map(|text| text.parse().unwrap_or(f64::NAN)).collect()
    }

    /// Checks that poses in use are at most `millis` old \[ms\].
    #[track_caller]
    fn flies_on_poses_no_older_than(&self, millis: f64) -> &Self {
        let [now, captured, fresh] = ["t_s", "pose_captured_s", "fresh"].map(|c| self.numbers(c));
        let used = (0..now.len()).filter(|&tick| fresh[tick] == 1.0);
        let oldest = used.map(|tick| 1e3 * (now[tick] - captured[tick])).fold(0.0, f64::max);
        assert!((1.0..=millis).contains(&oldest), "{oldest} ms");
        self
    }

    #[track_caller]
    fn coasts(&self) -> &Self {
        assert!(self.passed("Coast"), "{}", self.summary);
        self
    }

    #[track_caller]
    fn refuses(&self, least: f64) -> &Self {
        assert!(number(&self.summary, "/poses_refused") >= least, "{}", self.summary);
        self
    }
}

fn fly(flight: &[&str], line: &str) -> Flown {
    let testbed = Testbed::new("injected");
    let words: Vec<&str> = flight.iter().copied().chain(line.split_whitespace()).collect();
    let mut command = testbed.oqtal(&words);
    let output = command.arg("--out").arg(testbed.path("out")).output().unwrap();
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    let table = std::fs::read_to_string(testbed.path("out/telemetry.csv")).unwrap_or_default();
    let table = table.lines().map(|row| row.split(',').map(str::to_owned).collect()).collect();
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
    Flown { code: output.status.code(), summary, table, message: stderr(&output) }
}

#[test]
fn f01_poses_that_are_off_for_a_moment_are_coasted_through() {
    fly(&HOVER, "--clock lockstep --fault pose:off@4+0.1").coasts().by("no pose").lands();
}

#[test]
fn f02_poses_that_stay_off_stop_the_motors() {
    let flown = fly(&HOVER, "--clock lockstep --fault pose:off@4");
    flown.is_stopped_for("no pose");
    assert_eq!(flown.code, Some(1));
    assert!((4.2..4.3).contains(&number(&flown.summary, "/duration_s")), "{}", flown.summary);
}

#[test]
fn f03_stuck_poses_count_as_missing() {
    fly(&HOVER, "--clock lockstep --fault pose:stuck@1+0.1").coasts().by("pose frozen").lands();
}

#[test]
fn f04_delayed_poses_are_refused_by_their_capture_time() {
    fly(&HOVER, "--clock lockstep --fault pose:delayed=70ms@4").is_stopped_for("stale pose");
}

#[test]
fn f06_garbage_is_refused_and_flown_through() {
    fly(&HOVER, "--clock lockstep --fault pose:garbage@4+0.1").refuses(5.0).coasts().lands();
}

#[test]
fn f09_wrong_poses_are_refused_and_flown_through() {
    fly(&HOVER, "--clock lockstep --fault pose:wrong=0.5m@4+0.04").refuses(2.0).lands();
}

#[test]
fn f10_a_lasting_turn_is_never_accepted() {
    fly(&HOVER, "--clock lockstep --fault pose:wrong=180deg@4")
        .is_stopped_for("poses not as predicted");
}

#[test]
fn f11_poses_at_a_low_rate_are_flown_with() {
    let flown = fly(&HOVER, "--clock lockstep --fault pose:slow=30Hz@4+2");
    flown.lands();
    assert_eq!(flown.summary["state_sequence"].as_array().unwrap().len(), 1);
    fly(&HOVER, "--clock lockstep --fault pose:intermittent=30%@4+3").lands();
}

#[test]
fn f13_cameras_that_die_are_replaced_in_flight() {
    fly(&HOVER, "--clock in-process --fault mocap-emu:kill@4+0.1").coasts().lands();
}

#[test]
fn f13_cameras_that_die_end_a_flight_through_processes() {
    for (settings, state) in [("", "Stop"), ("--set vehicle.interface=attitude ", "Descend")] {
        let flown = fly(&BRIEF, &(settings.to_owned() + "--fault mocap-emu:kill@2"));
        assert!(flown.message.contains("mocap-emu was killed by signal 9"), "{}", flown.message);
        assert!(flown.is_stopped_for("no pose").passed(state) && flown.code == Some(1));
    }
}

#[test]
fn f14_a_daemon_that_is_replaced_does_not_take_off_again() {
    let flown = fly(&BRIEF, "--fault daemon:kill@1.5+0.3");
    assert_eq!((flown.code, &flown.summary["outcome"]), (Some(1), &"crashed".into()));
    // The new daemon observes the falling vehicle and could command it.
    let flown = fly(&HOVER, "--clock in-process --fault daemon:kill@4+0.3");
    assert_eq!(flown.summary["outcome"], "crashed", "{}", flown.summary);
    let (times, modes) = (flown.numbers("t_s"), flown.column("mode"));
    let (thrusts, states) = (flown.numbers("thrust"), flown.column("state"));
    let new: Vec<usize> = (0..times.len()).filter(|&tick| times[tick] > 4.2).collect();
    assert!(new.iter().any(|&tick| states[tick] == "Nominal"), "{states:?}");
    assert!(new.iter().all(|&tick| modes[tick] == "disarmed" && thrusts[tick] == 0.0));
    let flown = fly(&HOVER, "--clock in-process --fault daemon:kill@4");
    assert_eq!(flown.summary["outcome"], "crashed", "{}", flown.summary);
}

#[test]
fn f15_a_daemon_that_stops_for_some_periods_flies_on() {
    fly(&HOVER, "--clock lockstep --fault daemon:stop@4+0.1").lands();
    fly(&BRIEF, "--fault daemon:stop@3+0.1").lands();
}

#[test]
fn f17_a_plant_that_dies_leaves_no_truth() {
    let flown = fly(&HOVER, "--clock in-process --fault plant-sim:kill@4+1");
    flown.is_stopped_for("no pose");
    fly(&HOVER, "--clock lockstep --fault plant-sim:stop@4+0.1").coasts().lands();
}

#[test]
fn f18_a_vehicle_that_falls_silent_is_commanded_to_stop() {
    let flown = fly(&HOVER, "--clock lockstep --fault vehicle:off@4");
    flown.is_stopped_for("vehicle silent");
    assert!(number(&flown.summary, "/duration_s") < 4.6);
    let line = "--vehicle bridge:asctec --fault bridge:kill@1.5+0.1";
    fly(&BRIEF, line).is_stopped_for("vehicle silent");
}

#[test]
fn f20_wrong_bits_on_the_wire_are_flown_through() {
    fly(&BRIEF, "--vehicle bridge:asctec --set plant.wire.bit-error-rate=1e-4").lands();
}

#[test]
fn f21_garbage_in_place_of_commands_moves_nothing_beyond_its_limits() {
    let flown = fly(&HOVER, "--clock lockstep --fault command:garbage@4+0.05");
    flown.lands();
    assert_eq!(flown.summary["state_sequence"].as_array().unwrap().len(), 1);
}

#[test]
fn f22_late_turns_use_the_newest_pose_and_are_not_repeated() {
    let flown = fly(&HOVER, "--clock lockstep --fault daemon:slow=20ms@4+0.5");
    // Every second pose is superseded; the others are used at once.
    flown.lands().flies_on_poses_no_older_than(15.0 + 16.7);
    let superseded = number(&flown.summary, "/poses_superseded");
    assert!((14.0..=16.0).contains(&superseded), "{}", flown.summary);
    let (times, lateness) = (flown.numbers("t_s"), flown.numbers("wakeup_lateness_us"));
    let late = |tick: &usize| lateness[*tick] > 1000.0;
    let late: Vec<f64> = (0..times.len()).filter(late).map(|tick| times[tick]).collect();
    assert!(late.len() >= 14 && late.iter().all(|t_s| (4.0..4.55).contains(t_s)), "{late:?}");
    let least = times.windows(2).map(|pair| pair[1] - pair[0]).fold(1.0, f64::min);
    assert!(least > 0.5 / 60.0, "two ticks within {least} s");
    assert_eq!(flown.summary["state_sequence"].as_array().unwrap().len(), 1);
}

#[test]
fn f22_turns_that_are_later_still_are_reported() {
    let flown = fly(&HOVER, "--clock lockstep --fault daemon:slow=40ms@4+0.5");
    flown.lands().by("loop late");
    assert!(number(&flown.summary, "/deadline_misses") >= 3.0, "{}", flown.summary);
    assert!(flown.passed("Degraded"), "{}", flown.summary);
}

#[test]
fn f36_motors_that_never_start_or_stop_in_flight_end_it() {
    fly(&HOVER, "--clock lockstep --fault vehicle:wrong@4").is_stopped_for("motors not running");
    let flown = fly(&BRIEF, "--vehicle bridge:asctec --fault radio:off@0");
    flown.is_stopped_for("vehicle silent");
}

/// Faults of command, vehicle and radio that a flight survives.
#[test]
fn a_flight_survives_short_faults_of_every_kind() {
    for fault in [
        "command:off@4+0.15",
        "command:stuck@4+0.1",
        "command:wrong=80%@4+0.5",
        "command:slow=30Hz@4+1",
        "command:delayed=20ms@4+2",
        "command:intermittent@4+1",
        "vehicle:stuck@4+0.3",
        "vehicle:garbage@4+0.1",
        "vehicle:slow=20Hz@4+1",
        "vehicle:delayed@4+1",
        "vehicle:intermittent@4+1",
        "radio:off@4+0.15",
        "radio:delayed=20ms@4+2",
        "radio:intermittent@4+1",
        "mocap-emu:stop@4+0.1",
        "mocap-emu:slow=10ms@4+1",
        "plant-sim:slow=5ms@4+0.5",
    ] {
        let flown = fly(&HOVER, &format!("--clock in-process --fault {fault}"));
        flown.lands();
        assert_eq!(flown.summary["faults"].as_array().unwrap().len(), 1, "{fault}");
    }
}

#[test]
fn the_clocks_agree_with_every_fault_bit_for_bit() {
    let line = "--fault pose:garbage@3+0.05 --fault pose:intermittent@4+1 --fault pose:wrong@5.5+0.03 \
                --fault pose:delayed=40ms@6+0.5 --fault command:delayed=25ms@4+1 \
                --fault command:intermittent@6+0.3 --fault radio:intermittent@7+0.3 \
                --fault vehicle:slow@4 --fault daemon:stop@7.5+0.07 --fault mocap-emu:slow=7ms@8+0.5 \
                --fault plant-sim:stop@9+0.05 --fault pose:drift=0.02m/s@5+0.2 --fault pose:noise=1mm@5+0.5 \
                --fault pose:frozen-noise@7+0.05 --fault pose:mirror@8.1+0.05 --fault pose:rotate@8.2+0.05";
    let hash = |clock: &str| {
        let flown = fly(&HOVER, &format!("--clock {clock} {line}"));
        flown.lands();
        assert!(flown.passed("Nominal"));
        flown.summary["trajectory_hash"].clone()
    };
    let first = hash("lockstep");
    assert_eq!(first, hash("lockstep"));
    assert_eq!(first, hash("in-process"));
}

#[test]
fn the_configuration_of_a_flight_repeats_its_faults() {
    let testbed = Testbed::new("repeat");
    let words = ["--clock", "in-process", "--trajectory", "hover", "--duration", "3"];
    let faulty = [&words[..], &["--fault", "pose:intermittent@4+1", "--out", "first"]].concat();
    let first = testbed.summary(&faulty);
    let again = testbed.summary(&["--config", "first/config.toml"]);
    assert_eq!(first["trajectory_hash"], again["trajectory_hash"]);
    assert_eq!(again["faults"][0]["fault"], "pose:intermittent=50%@4+1");
    assert_ne!(first["trajectory_hash"], testbed.summary(&words)["trajectory_hash"]);
}

#[test]
fn faults_that_a_flight_cannot_have_are_refused() {
    let testbed = Testbed::new("refused");
    for (words, code, reason) in [
        (&["--fault", "pose:broken@1"][..], 64, "pose       off | stuck | garbage"),
        (&["--fault", "pose:off"], 64, "TARGET:KIND[=VALUE]@TIME[+DURATION]"),
        (&["--fault", "bridge:stop@1"], 64, "the flight has no bridge"),
        (&["--fault", "daemon:kill@1", "--clock", "lockstep"], 64, "time waits for every process"),
        (&["--set", "fault.inject=[\"pose:off\"]"], 78, "TARGET:KIND[=VALUE]@TIME[+DURATION]"),
        (&["--fault", "files:removed@1", "--clock", "in-process"], 64, "in real time only"),
        (
            &["--fault", "pose:off@1", "--vehicle", "link:asctec:/dev/null"],
            78,
            "fault.with-real-vehicle",
        ),
    ] {
        testbed.refuses(&[&["fly"], words].concat(), code, &[reason]);
    }
}

/// The loss of the instance's files ends a flight by a landing, also with noisy poses.
#[test]
fn f68_a_flight_lands_after_the_removal_of_its_files_with_noisy_poses() {
    let line = "--fault files:removed@2 --fault pose:noise=1mm@2 --fault pose:noise=0.3deg@2";
    let flown = fly(&BRIEF, line);
    assert!(flown.lands().by("files of the instance removed").passed("Land"), "{}", flown.summary);
    let reason = flown.summary["shortfall"].as_str().unwrap();
    assert!(reason.ends_with("before the end of the flight: files of the instance removed"));
    assert_eq!(flown.code, Some(1), "{}", flown.message);
}

/// Poses queue during a stall and then arrive together.
#[test]
fn f52_poses_that_queued_in_a_stall_are_flown_only_while_they_are_young() {
    for (line, outcome) in [
        ("--clock lockstep --fault pose:delayed=120ms@4+0.08", "landed"),
        ("--clock lockstep --fault pose:delayed=220ms@4+0.3", "stopped"),
    ] {
        let flown = fly(&HOVER, line);
        assert_eq!(flown.summary["outcome"], outcome, "{line}: {}", flown.message);
        flown.coasts().refuses(2.0).flies_on_poses_no_older_than(80.0);
    }
}

#[test]
fn f48_a_blind_vehicle_that_holds_its_attitude_descends() {
    let line = "--clock lockstep --set vehicle.interface=attitude --fault pose:off@4";
    let flown = fly(&HOVER, line);
    assert!(flown.is_stopped_for("no pose").passed("Descend"), "{}", flown.summary);
    let seconds = number(&flown.summary, "/duration_s");
    assert!((5.0..6.5).contains(&seconds), "{seconds} s");
    let flown = fly(&HOVER, &format!("{line}+0.6"));
    assert!(flown.lands().passed("Descend") && flown.passed("Land"), "{}", flown.summary);
}

#[test]
fn f37_f47_wind_does_not_push_the_vehicle_over_the_fence_under_power() {
    let line = "--clock lockstep --set plant.force-n=[2,0,0] --set plant.disturbance-spread=0 --set fence.x-m=[-1.5,1.5]";
    let flown = fly(&HOVER, line);
    assert!(flown.is_stopped_for("fence").passed("Hold"), "{}", flown.summary);
}

#[test]
fn f38_a_tilted_vehicle_is_stopped() {
    let line = "--clock lockstep --set plant.force-n=[1,0,0] --set plant.disturbance-spread=0 --set safety.tilt-limit-deg=5";
    fly(&HOVER, line).is_stopped_for("tipped");
}

#[test]
fn f40_a_vehicle_that_cannot_lift_off_is_stopped() {
    let line = "--clock lockstep --set plant.force-n=[0,0,-4] --set plant.disturbance-spread=0";
    let flown = fly(&HOVER, line);
    flown.is_stopped_for("thrust does not lift");
}

#[test]
fn f43_a_vehicle_that_is_too_fast_lands() {
    let flown = fly(&HOVER, "--clock lockstep --disturb force@6+0.5=6,0,0N");
    assert!(flown.lands().by("too fast").passed("Land"), "{}", flown.summary);
}

#[test]
fn f44_a_vehicle_that_wind_pushes_away_lands() {
    let line = "--clock lockstep --set plant.force-n=[1.4,0,0] --set plant.disturbance-spread=0";
    let flown = fly(&HOVER, line);
    assert!(flown.by("far from its reference").passed("Land"), "{}", flown.summary);
}

#[test]
fn f45_an_empty_battery_ends_the_flight() {
    let line =
        "--clock lockstep --set safety.battery-low-v=12.45 --set safety.battery-empty-v=12.4";
    let flown = fly(&HOVER, line);
    assert!(flown.lands().by("battery low").passed("Land"), "{}", flown.summary);
}

#[test]
fn f58_mirrored_poses_stop_the_motors() {
    let flown = fly(&HOVER, "--clock lockstep --fault pose:mirror@4");
    flown.is_stopped_for("poses do not follow the vehicle");
}

#[test]
fn f59_an_attitude_that_drifts_is_told() {
    let flown = fly(&LONG_HOVER, "--clock in-process --fault pose:drift=1deg/s@8");
    assert!(flown.by("poses do not follow the vehicle").passed("Degraded"), "{}", flown.summary);
}
