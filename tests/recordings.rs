//! Recordings of flights: complete, readable by other programs, sufficient for the report, and replayed bit for bit.

use std::path::Path;
use std::process::{Command, Output};

use crate::common::{SERVICES, Testbed, assert_refused, number, peers, stderr, wait_for};
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_observe::recording::{DaemonHistory, InputHistory, RecordingFile, flight, play};
use rustix::process::Signal;
use serde_json::Value;

/// A hover of one second.
const HOVER: [&str; 6] =
    ["--trajectory", "hover", "--duration", "1", "--set", "trajectory.settle-s=0.5"];

/// Runs `oqtal` with `words`; it must fail with this code and a message that contains `parts`.
#[track_caller]
fn fails(testbed: &Testbed, words: &[&str], code: i32, parts: &[&str]) {
    assert_refused(&testbed.study(words).output().unwrap(), code, parts);
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

/// Replays the recording; it must agree bit for bit. Returns the result.
fn replays(testbed: &Testbed, file: &str) -> Value {
    let result = json(&testbed.succeeds(&["replay", file, "--json"]));
    assert!(number(&result, "/ticks") > 60.0, "{result}");
    assert_eq!(result["identical"], result["ticks"], "{result}");
    assert_eq!((&result["unmatched"], &result["missing"]), (&Value::from(0), &Value::from(0)));
    result
}

#[test]
fn a_recording_reproduces_the_report_and_replays_bit_for_bit() {
    for (clock, flights) in
        [("lockstep", "processes"), ("in-process", "all"), ("real", "processes")]
    {
        let testbed = Testbed::new("again");
        let setting = format!("record.flights={flights}");
        let words = [&HOVER[..], &["--clock", clock, "--set", &setting, "--out", "d"]].concat();
        let summary = testbed.summary(&words);
        let page = |name: &str| std::fs::read_to_string(testbed.path("d").join(name)).unwrap();
        let flown = page("report.html");
        let again = testbed.succeeds(&["report", "d/flight.mcap", "--json"]);
        assert_eq!(json(&again), summary, "{clock}");
        assert!(page("report.html") == flown, "{clock}: the pages differ");
        testbed.succeeds(&["export", "d/flight.mcap", "--format", "csv"]);
        assert!(page("flight-csv/ticks.csv") == page("telemetry.csv"), "{clock}: tables differ");
        replays(&testbed, "d/flight.mcap");
    }
}

#[test]
fn a_flight_with_dropouts_outliers_and_a_landing_on_request_replays_bit_for_bit() {
    let testbed = Testbed::new("rough");
    let words = [
        &HOVER[..],
        &["--clock", "lockstep", "--out", "d", "--controller", "oqtal-dt"],
        &["--set", "mocap.dropout-probability=0.1", "--set", "mocap.outlier-probability=0.05"],
    ]
    .concat();
    let output = testbed.fly(&words);
    assert!(testbed.path("d/flight.mcap").exists(), "{}", stderr(&output));
    replays(&testbed, "d/flight.mcap");
}

#[test]
fn f68_a_landing_after_a_loss_of_files_is_told_and_replays_bit_for_bit() {
    let testbed = Testbed::new("lost");
    let words = [&HOVER[..], &["--fault", "files:removed@2", "--out", "d"]].concat();
    let output = testbed.fly(&words);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let file = RecordingFile::read(&testbed.path("d/flight.mcap")).unwrap();
    assert!(tells(&file, "files of the instance removed"));
    replays(&testbed, "d/flight.mcap");
}

#[test]
fn a_recording_that_is_removed_in_flight_is_told_and_no_condition_is_logged_twice() {
    let testbed = Testbed::new("removed");
    let words = [&["fly"], &HOVER[..], &["--out", "d"]].concat();
    let flight = testbed.start(&words);
    let path = testbed.path("d/flight.mcap");
    wait_for("a recording", || std::fs::remove_file(&path).ok());
    let output = flight.wait();
    assert_refused(&output, 71, &["flight.mcap was removed while it was recorded"]);
    let log = std::fs::read_to_string(testbed.path("d/daemon.log")).unwrap();
    let conditions = log.lines().filter_map(|line| line.split_once(" state="));
    let conditions: Vec<_> = conditions.map(|(line, _)| line.split_whitespace().skip(1)).collect();
    assert!(conditions.len() > 3, "{log}");
    assert!(conditions.windows(2).all(|pair| pair[0].clone().ne(pair[1].clone())), "{log}");
}

#[test]
fn a_recording_that_is_renamed_in_flight_is_whole_under_its_new_name() {
    let testbed = Testbed::new("renamed");
    let flight = testbed.start(&[&["fly"], &HOVER[..], &["--out", "d"]].concat());
    let (old, new) = (testbed.path("d/flight.mcap"), testbed.path("renamed.mcap"));
    wait_for("a recording", || std::fs::rename(&old, &new).ok());
    let output = flight.wait();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("renamed.mcap"), "{}", stderr(&output));
    assert_eq!(RecordingFile::read(&new).unwrap().cut_off, None);
}

#[test]
fn a_flight_whose_directory_is_moved_names_the_command_that_makes_its_report() {
    let testbed = Testbed::new("moved");
    let bus = testbed.bus();
    let flight = testbed.start(&[&["fly"], &HOVER[..], &["--out", "d"]].concat());
    testbed.take_off(&bus);
    std::fs::rename(testbed.path("d"), testbed.path("moved")).unwrap();
    let output = flight.wait();
    let recording = testbed.path("moved/flight.mcap").canonicalize().unwrap();
    let remedy = format!("`oqtal report {} --out FILE`", recording.display());
    assert_refused(&output, 71, &[&remedy]);
}

/// Whether an event of the recording contains `text`.
fn tells(file: &RecordingFile, text: &str) -> bool {
    let events = file.channels.iter().find(|(_, channel)| channel.topic == "events").unwrap().0;
    let mut events = file.messages.iter().filter(|message| message.channel == *events);
    events.any(|event| String::from_utf8_lossy(&event.data).contains(text))
}

#[test]
fn faults_at_the_daemons_end_of_a_topic_are_recorded_and_replay_bit_for_bit() {
    let faults = [
        ["pose:wrong=0.01m@1+0.5", "pose:stuck@0.5+0.05"],
        ["pose:garbage@0.5+0.02", "vehicle:garbage@1+0.3"],
        ["vehicle:stuck@1+0.5", "pose:stuck@0.5+0.05"],
    ];
    for (faults, clock) in faults.into_iter().zip(["lockstep", "in-process", "lockstep"]) {
        let testbed = Testbed::new("faulty");
        let mut words = [&HOVER[..], &["--clock", clock, "--out", "d"]].concat();
        words.extend(["--set", "record.flights=all"]);
        words.extend(faults.iter().flat_map(|fault| ["--fault", fault]));
        let output = testbed.fly(&words);
        let path = testbed.path("d/flight.mcap");
        assert!(path.exists(), "{}", stderr(&output));
        let file = RecordingFile::read(&path).unwrap();
        for fault in faults {
            assert!(tells(&file, &format!("{fault} begins")), "{fault}");
            let target = fault.split_once(':').unwrap().0;
            let topic = format!("read/{target}");
            let info = json(&testbed.succeeds(&["info", "d/flight.mcap", "--json"]));
            assert!(number(&info["topics"][&topic], "/messages") > 60.0, "{fault}: {topic}");
        }
        replays(&testbed, "d/flight.mcap");
    }
}

#[test]
fn two_recordings_are_compared_and_shown() {
    let testbed = Testbed::new("two");
    for seed in ["1", "2"] {
        let out = format!("d{seed}");
        let words = ["--clock", "lockstep", "--out", &out, "--seed", seed];
        testbed.summary(&[&HOVER[..], &words].concat());
    }
    let text = testbed.succeeds(&["compare", "d1/flight.mcap", "d2/flight.mcap"]);
    assert!(text.contains("clock.seed") && text.contains("position [m], mean"), "{text}");
    assert!(testbed.path("results/compare-1/compare.html").exists());
    // A directory receives the page, and a page is replaced; no other file is, least of all a recording.
    let compare = ["compare", "d1", "d2", "--out"];
    testbed.succeeds(&[&compare[..], &["results"]].concat());
    testbed.succeeds(&[&compare[..], &["results/compare.html"]].concat());
    let recorded = std::fs::read(testbed.path("d1/flight.mcap")).unwrap();
    for file in ["d1/flight.mcap", "d1/config.toml"] {
        let part = format!("{file} exists and is not a page");
        fails(&testbed, &[&compare[..], &[file]].concat(), 64, &[&part]);
        fails(&testbed, &["report", "d1", "--out", file], 64, &[&part]);
        assert!(testbed.path(file).exists());
    }
    fails(&testbed, &["replay", "d1", "--out", "d1/flight.mcap"], 64, &["is a recording"]);
    assert!(std::fs::read(testbed.path("d1/flight.mcap")).unwrap() == recorded);
    let info = json(&testbed.succeeds(&["info", "d1/flight.mcap", "--json"]));
    assert_eq!(info["is_complete"], true);
    assert_eq!(info["facts"]["oqtal.recording"]["version"], env!("CARGO_PKG_VERSION"));
    testbed.succeeds(&["export", "d1/flight.mcap", "--format", "tum", "--topics", "truth"]);
    let over = ["export", "d1/flight.mcap", "--format", "csv", "--out", "d1"];
    fails(&testbed, &over, 64, &["d1/telemetry.csv is of a flight"]);
    let line = std::fs::read_to_string(testbed.path("d1/flight-tum/truth.tum")).unwrap();
    assert_eq!(line.lines().next().unwrap().split(' ').count(), 8);
}

/// Compares the content of `d/flight.mcap`, `read` by another implementation, with the program's overview.
fn agrees_with_ours(testbed: &Testbed, read: &Value) {
    let ours = json(&testbed.succeeds(&["info", "d/flight.mcap", "--json"]));
    let counts = ours["topics"].as_object().unwrap().iter();
    let counts = counts.filter(|(_, topic)| topic["messages"] != 0);
    let mut topics = 0;
    for (topic, overview) in counts {
        topics += 1;
        assert_eq!(read["messages"][topic], overview["messages"], "{topic}");
        assert_eq!(read["indexed"][topic], overview["messages"], "{topic}");
        assert_eq!(read["schemas"][topic], overview["schema"], "{topic}");
    }
    assert_eq!(read["messages"].as_object().unwrap().len(), topics);
    assert_eq!(read["ordered"], true);
}

/// Reads the recording of a default flight with a reader of `tests/peers`.
fn read_by(mut reader: Command) -> (Testbed, Value) {
    let testbed = Testbed::new("peer");
    testbed.summary(&["--clock", "lockstep", "--out", "d"]);
    let output = reader.arg(testbed.path("d/flight.mcap")).output();
    let output = output.expect("the interpreter of a peer");
    assert!(output.status.success(), "{}", stderr(&output));
    let read = json(&String::from_utf8(output.stdout).unwrap());
    (testbed, read)
}

#[test]
fn python_reads_and_decodes_every_message() {
    let Some(reader) = peers::python("mcap_reader.py") else { return };
    let (testbed, read) = read_by(reader);
    agrees_with_ours(&testbed, &read);
    assert_eq!(read["last_tick"], read["messages"]["telemetry"]);
}

#[test]
fn javascript_reads_every_message() {
    let Some(reader) = peers::node("mcap_reader.js") else { return };
    let (testbed, read) = read_by(reader);
    agrees_with_ours(&testbed, &read);
}

/// History of the only daemon of a recording.
fn history(path: &Path) -> DaemonHistory {
    let mut history = InputHistory::default();
    play(&RecordingFile::read(path).unwrap(), &mut history).unwrap();
    let mut histories = history.finish();
    assert_eq!(histories.len(), 1);
    histories.remove(0)
}

/// `RECORDING_KILLS` sets the number of kills.
#[test]
fn a_recording_whose_writer_was_killed_is_read_up_to_its_last_chunk() {
    let kills = std::env::var("RECORDING_KILLS").ok().and_then(|text| text.parse().ok());
    for kill in 0..kills.unwrap_or(2_u64) {
        let testbed = Testbed::new("killed");
        let flying = testbed.start(&["fly", "--clock", "lockstep", "--out", "d"]);
        let path = testbed.path("d/flight.mcap");
        // The size differs between kills, and differs from the size of a chunk.
        let size = 600_000 + kill * 217_131;
        let is_there =
            || std::fs::metadata(&path).is_ok_and(|file| file.len() > size).then_some(());
        wait_for("a recording of some size", is_there);
        flying.signal(Signal::KILL);
        flying.wait();
        let file = RecordingFile::read(&path).unwrap();
        assert!(file.cut_off.is_some() && file.messages.len() > 100);
        let history = history(&path);
        assert!(history.is_complete(), "{} records are missing", history.missing);
        replays(&testbed, "d/flight.mcap");
    }
}

/// Output of `command` whose files cannot grow beyond `kib` \[KiB\]. The limit acts like a full disk; its signal is ignored.
fn on_full_disk(testbed: &Testbed, kib: u32, command: &Command) -> Output {
    let script = format!("trap '' XFSZ; ulimit -f {kib}; exec \"$0\" \"$@\"");
    Command::new("bash")
        .args(["-c", &script, env!("CARGO_BIN_EXE_oqtal")])
        .args(command.get_args())
        .current_dir(testbed.path(""))
        .output()
        .unwrap()
}

#[test]
fn a_recording_that_cannot_grow_ends_and_its_size_is_printed() {
    let testbed = Testbed::new("full-record");
    let _services = testbed.services();
    testbed.wait_for_daemon();
    let output = on_full_disk(
        &testbed,
        800,
        &testbed.oqtal(&["record", "--out", "r.mcap", "--seconds", "60"]),
    );
    assert_refused(&output, 71, &["r.mcap: File too large; the recording ends here"]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains(" messages, 0.8 MB: r.mcap"), "{said}");
}

#[test]
fn a_file_that_cannot_grow_is_reported_and_the_flight_lands() {
    let testbed = Testbed::new("full");
    // In-process, since shared memory would exceed the limit.
    let recorded = ["--clock", "in-process", "--set", "record.flights=all", "--out", "d"];
    let output = on_full_disk(
        &testbed,
        800,
        &testbed.oqtal(&[&["fly"], &HOVER[..], &recorded[..]].concat()),
    );
    assert_refused(&output, 71, &["flight.mcap"]);
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("landed"));
    assert!(RecordingFile::read(&testbed.path("d/flight.mcap")).unwrap().cut_off.is_some());
    let page = ["report", "d/flight.mcap", "--out", "p.html"];
    let full = on_full_disk(&testbed, 1, &testbed.study(&page));
    assert_refused(&full, 71, &["p.html: File too large"]);
    // No part of a page is in the way.
    testbed.succeeds(&page);
}

/// Settings of the recording alone: those of the flight remain the daemon's.
#[test]
fn a_recorder_with_limits_of_its_own_records_the_configuration_of_the_daemon() {
    let testbed = Testbed::new("limits");
    let _services =
        SERVICES.map(|process| testbed.start(&[process, "run", "--set", "trajectory.kind=hover"]));
    testbed.wait_for_daemon();
    let words = ["record", "--set", "record.file-min=0.01", "--seconds", "2", "--out", "own.mcap"];
    let output = testbed.oqtal(&words).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(!stderr(&output).contains("another configuration"), "{}", stderr(&output));
    let second = flight(&RecordingFile::read(&testbed.path("own.2.mcap")).unwrap()).unwrap();
    assert_eq!(second.config.trajectory.kind, TrajectoryKind::Hover);
    assert_eq!(second.config.record.file_min, 0.01);
}

#[test]
fn a_service_is_recorded_over_several_files_without_a_gap() {
    let testbed = Testbed::new("files");
    let setting = ["--set", "record.file-min=0.01"];
    let words = [&["record", "--out", "r.mcap"], &setting[..]].concat();
    let recording = testbed.start(&words);
    wait_for("the first file", || testbed.path("r.mcap").exists().then_some(()));
    let services = SERVICES
        .map(|process| testbed.start(&[process, "run", "--set", "safety.arm-at-start=true"]));
    testbed.wait_for_daemon();
    let name = |number: usize| match number {
        1 => testbed.path("r.mcap"),
        _ => testbed.path(&format!("r.{number}.mcap")),
    };
    let files = || (1..).take_while(|number| name(*number).exists()).count();
    // The start time of the daemon varies; two files later it has flown throughout one.
    let begun = files();
    wait_for("three more files", || (files() >= begun + 3).then_some(()));
    recording.signal(Signal::INT);
    let output = recording.wait();
    assert!(output.status.success(), "{}", stderr(&output));
    drop(services);
    let mut history = InputHistory::default();
    for number in 1..=files() {
        play(&RecordingFile::read(&name(number)).unwrap(), &mut history).unwrap();
    }
    let histories = history.finish();
    assert_eq!(histories.len(), 1);
    assert!(histories[0].is_complete() && histories[0].turns.len() > 60);
}

#[test]
fn a_file_that_is_not_a_recording_is_refused_with_the_reason() {
    let testbed = Testbed::new("none");
    testbed.write("text.mcap", "t,x,y,z\n");
    testbed.write("empty.mcap", "");
    for command in ["info", "report", "replay"] {
        fails(&testbed, &[command, "nowhere.mcap"], 65, &["nowhere.mcap: No such file"]);
        for name in ["text.mcap", "empty.mcap"] {
            let parts = [name, "not a recording", "expected a file that `oqtal fly`"];
            fails(&testbed, &[command, name], 65, &parts);
        }
    }
    testbed.summary(&[&HOVER[..], &["--clock", "lockstep", "--out", "d"]].concat());
    let bytes = std::fs::read(testbed.path("d/flight.mcap")).unwrap();
    std::fs::write(testbed.path("d/short.mcap"), &bytes[..60]).unwrap();
    fails(&testbed, &["info", "d/short.mcap"], 65, &[]);
    let (key, value) = (b"layout\x01\0\0\0".as_slice(), b"9");
    let at = bytes.windows(key.len()).position(|window| window == key).unwrap() + key.len();
    let mut other = bytes;
    other[at] = value[0];
    std::fs::write(testbed.path("d/other.mcap"), &other).unwrap();
    fails(&testbed, &["report", "d/other.mcap"], 76, &[env!("CARGO_PKG_VERSION"), "layout"]);
    fails(&testbed, &["record", "--seconds", "-1"], 64, &[]);
    fails(&testbed, &["record", "--seconds", "nan"], 64, &[]);
    let existing = ["record", "--out", "d/flight.mcap", "--seconds", "1"];
    fails(&testbed, &existing, 71, &["File exists", "--out"]);
    fails(&testbed, &["report", "d/none.mcap"], 65, &["No such file"]);
    testbed.refuses(&["record", "--attach"], 75, &["no daemon answers on instance"]);
    let output =
        testbed.oqtal(&["record", "--seconds", "1.5", "--out", "w.mcap"]).output().unwrap();
    assert!(
        stderr(&output).contains("waits for a daemon: no daemon answers"),
        "{}",
        stderr(&output)
    );
}
