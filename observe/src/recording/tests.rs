//! Recordings written and read: complete, truncated at any byte, damaged.

use std::path::PathBuf;

use oqtal_bus::code::{Answer, InputKind, Mode, OperatorCommand};
use oqtal_bus::message::{EventV1, Header, InputV1, PoseV1, TelemetryV1, TruthV1};
use oqtal_bus::text::LongText;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Sample};
use oqtal_config::{ClockKind, Config};
use proptest::prelude::*;
use tempfile::TempDir;

use super::mcap::decode::Cursor;
use super::mcap::encode::Fields;
use super::mcap::{MAGIC, Opcode};
use super::*;
use crate::flight::{Flight, Outcome};
use crate::provenance::Provenance;
use crate::sink::{Reception, Sink};

const PROVENANCE: Provenance = Provenance { version: "1.2.3", revision: "abc" };
const SAMPLES: u64 = 200;

fn configuration() -> Config {
    let mut config = Config::default();
    config.clock.kind = ClockKind::Lockstep;
    config
}

fn pose(number: u64) -> (Reception, PoseV1) {
    let header = Header { sequence: number, source: 7, ..Header::default() };
    let received_at = Time::VIRTUAL_START + Span::from_millis(16 * number as i64);
    let position = [number as f64, f64::NAN, -0.0];
    (Reception { header, received_at }, PoseV1 { position, ..PoseV1::default() })
}

/// A recorder into a directory, with its first file.
fn create(directory: &TempDir, config: &Config, rotates: bool) -> (PathBuf, McapRecorder) {
    let path = directory.path().join("r.mcap");
    fn complain(message: &str) {
        panic!("{message}");
    }
    let provenance = PROVENANCE;
    let plan = RecordingPlan { path: path.clone(), config, provenance, rotates, complain };
    (path, McapRecorder::create(&plan).unwrap())
}

/// Records [`SAMPLES`] poses and ticks into a directory; returns the first file.
fn record(directory: &TempDir, config: &Config, rotates: bool) -> (PathBuf, RecordingResult) {
    let (path, mut recorder) = create(directory, config, rotates);
    for number in 1..=SAMPLES {
        let (reception, sample) = pose(number);
        recorder.sample(&reception, Sample::Pose(&sample));
        let time = reception.received_at;
        let tick = TelemetryV1 { time, tick: number, ..Default::default() };
        recorder.sample(&reception, Sample::Telemetry(&tick));
    }
    recorder.lost(ObservedTopic::Pose, 3);
    (path, recorder.finish())
}

/// List of the poses received.
#[derive(Default)]
struct Poses(Vec<(Reception, PoseV1)>);

impl Sink for Poses {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        if let Sample::Pose(pose) = sample {
            self.0.push((*reception, *pose));
        }
    }
}

fn poses(file: &RecordingFile) -> Vec<(Reception, PoseV1)> {
    let mut poses = Poses::default();
    play(file, &mut poses).unwrap();
    poses.0
}

/// Whether `read` contains the first recorded poses, bit for bit.
fn are_the_first(read: &[(Reception, PoseV1)]) -> bool {
    read.iter().zip(1..).all(|((reception, read), number)| {
        let (wanted, sample) = pose(number);
        let bits = |pose: &PoseV1| pose.position.map(f64::to_bits);
        reception.header == wanted.header
            && reception.received_at == wanted.received_at
            && bits(read) == bits(&sample)
    })
}

#[test]
fn a_recording_is_read_as_written() {
    let directory = tempfile::tempdir().unwrap();
    let config = configuration();
    let (path, result) = record(&directory, &config, false);
    assert_eq!((result.failure, result.dropped, result.files.len()), (None, 0, 1));
    let file = RecordingFile::read(&path).unwrap();
    assert_eq!(file.cut_off, None);
    assert_eq!(file.messages.len() as u64, result.messages);
    assert_eq!(std::fs::metadata(&path).unwrap().len(), result.bytes);
    assert_eq!(file.fact("oqtal.recording", "version"), Some("1.2.3"));
    let name = path.display().to_string();
    assert_eq!(
        Config::parse(&name, &file.config_text().unwrap(), &[]).unwrap().hash(),
        config.hash()
    );
    let read = poses(&file);
    assert!(read.len() as u64 == SAMPLES && are_the_first(&read));
    let overview = RecordingOverview::of(&file);
    assert_eq!(overview.topics["pose"].messages, SAMPLES);
    assert!((overview.topics["pose"].rate_hz - 62.5).abs() < 1e-9);
    assert_eq!(overview.topics["events"].messages, 2, "the daemon's state, and the loss");
}

#[test]
fn the_rate_of_a_topic_is_that_of_its_publication() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = record(&directory, &configuration(), false);
    let mut file = RecordingFile::read(&path).unwrap();
    let first = file.messages[0].log_time;
    // Everything is received within a microsecond.
    file.messages.iter_mut().zip(0..).for_each(|(message, k)| message.log_time = first + k % 1000);
    let rate_hz = RecordingOverview::of(&file).topics["telemetry"].rate_hz;
    assert!((rate_hz - 62.5).abs() < 1e-9, "{rate_hz} Hz");
}

#[test]
fn files_follow_each_other_without_a_gap() {
    let directory = tempfile::tempdir().unwrap();
    let mut config = configuration();
    config.record.file_min = 1.0 / 60.0;
    let (_, result) = record(&directory, &config, true);
    assert_eq!(result.files.len(), 4);
    let read: Vec<_> =
        result.files.iter().flat_map(|path| poses(&RecordingFile::read(path).unwrap())).collect();
    assert!(read.len() as u64 == SAMPLES && are_the_first(&read));
}

#[test]
fn each_flight_of_a_recording_is_read_by_itself_with_the_settings_changed_before_it() {
    let directory = tempfile::tempdir().unwrap();
    let (path, mut recorder) = create(&directory, &configuration(), false);
    let (command, text) = (OperatorCommand::Set.code(), LongText::new("control.controller=pid"));
    // Periods of 16 ms; the second flight begins a quarter of a second after the first, the third long after the second.
    let flights = [100..150, 164..200, 400..430];
    for number in 1..=500_u64 {
        let (reception, _) = pose(number);
        let time = reception.received_at;
        if number == 155 {
            let change = EventV1 { number: 1, command, text, time, ..EventV1::default() };
            recorder.sample(&reception, Sample::Event(&change));
        }
        recorder.sample(&reception, Sample::Truth(&TruthV1 { time, ..TruthV1::default() }));
        let is_flying = flights.iter().any(|flight| flight.contains(&number));
        let mode = if is_flying { Mode::Flying } else { Mode::Disarmed }.code();
        let tick = TelemetryV1 { time, tick: number, mode, ..TelemetryV1::default() };
        recorder.sample(&reception, Sample::Telemetry(&tick));
    }
    recorder.finish();
    let whole = read(&path).unwrap();
    assert_eq!(flight(&whole).unwrap().flights().count(), 3);
    let listed = whole.flights().unwrap();
    assert_eq!(listed.iter().map(|it| it.flight).collect::<Vec<_>>(), [1, 2, 3]);
    let known = configuration().control.controller.name();
    for (number, ticks, law) in [(1, 100..150, known), (2, 164..200, "pid"), (3, 400..430, "pid")] {
        let one = read(&PathBuf::from(format!("{}#{number}", path.display()))).unwrap();
        let flown = flight(&one).unwrap();
        let armed: Vec<u64> = flown.armed().map(|sample| sample.telemetry.tick).collect();
        assert_eq!(armed, ticks.collect::<Vec<u64>>());
        assert_eq!(flown.outcome, Outcome::Landed, "{number}");
        assert_eq!(flown.config_at_arming().control.controller.name(), law);
    }
    let beyond = read(&PathBuf::from(format!("{}#4", path.display()))).unwrap_err();
    assert!(beyond.to_string().contains("has 3 flights"), "{beyond}");
}

#[test]
fn every_file_has_the_settings_that_were_changed_before_it() {
    let directory = tempfile::tempdir().unwrap();
    let mut config = configuration();
    config.record.file_min = 1.0 / 60.0;
    let (_, mut recorder) = create(&directory, &config, true);
    let (command, text) = (OperatorCommand::Set.code(), LongText::new("control.controller=pid"));
    let change = EventV1 { number: 1, command, text, ..EventV1::default() };
    recorder.facts(Facts::new("granted", [("policy", "fifo".to_owned())]));
    recorder.sample(&pose(1).0, Sample::Event(&change));
    // 4.3 s in files of a second, the third of which has the start of another daemon.
    for number in 1..=270 {
        let (reception, _) = pose(number);
        let time = reception.received_at;
        if number == 150 {
            let start = InputV1 { time, kind: InputKind::Start.code(), ..InputV1::default() };
            recorder.sample(&reception, Sample::Input(&start));
        }
        recorder.sample(&reception, Sample::Truth(&TruthV1 { time, ..TruthV1::default() }));
        let tick = TelemetryV1 { time, tick: number, ..TelemetryV1::default() };
        recorder.sample(&reception, Sample::Telemetry(&tick));
    }
    let files: Vec<_> =
        recorder.finish().files.iter().map(|path| RecordingFile::read(path).unwrap()).collect();
    assert!(files.iter().all(|file| file.fact("granted", "policy") == Some("fifo")));
    let flights: Vec<_> = files.iter().map(|file| flight(file).unwrap()).collect();
    let laws: Vec<_> =
        flights.iter().map(|it| it.config_at_arming().control.controller.name()).collect();
    let at_start = config.control.controller.name();
    assert_eq!(laws, ["pid", "pid", "pid", at_start], "the last file is of another daemon");
    assert_eq!(flights[1].changes.len(), 1);
}

#[test]
fn a_later_file_has_the_last_change_of_each_setting_that_was_not_refused_by_this_daemon() {
    let later = |daemon: u64| {
        let directory = tempfile::tempdir().unwrap();
        let mut config = configuration();
        config.record.file_min = 1.0 / 60.0;
        let (_, mut recorder) = create(&directory, &config, true);
        let tick = |recorder: &mut McapRecorder, source, number| {
            let (mut reception, _) = pose(number);
            reception.header.source = source;
            let time = reception.received_at;
            recorder.sample(&reception, Sample::Truth(&TruthV1 { time, ..TruthV1::default() }));
            let tick = TelemetryV1 { time, tick: number, ..TelemetryV1::default() };
            recorder.sample(&reception, Sample::Telemetry(&tick));
        };
        tick(&mut recorder, 7, 1);
        let change = |number, text: &str| EventV1 {
            number,
            command: OperatorCommand::Set.code(),
            text: LongText::new(text),
            ..EventV1::default()
        };
        let tilts = (2..20).map(|tilt| change(tilt, &format!("position.tilt-limit-deg={tilt}")));
        let refused = change(40, "position.tilt-limit-deg=5\ncontrol.controller=geometric");
        let answer = Answer::Refused.code();
        let changes = std::iter::once(change(1, "control.controller=pid")).chain(tilts);
        for event in changes.chain([refused, EventV1 { answer, ..refused }]) {
            recorder.sample(&pose(1).0, Sample::Event(&event));
        }
        // The message of the start of another daemon is lost.
        (2..=100).for_each(|number| tick(&mut recorder, daemon, number));
        let files = recorder.finish().files;
        flight(&RecordingFile::read(&files[1]).unwrap()).unwrap()
    };
    let (same, other) = (later(7), later(8));
    let settings = ["control.controller=pid", "position.tilt-limit-deg=19"];
    assert_eq!(same.changed_settings(), settings);
    assert_eq!(same.changes.len(), settings.len());
    assert!(other.changes.is_empty(), "{:?}", other.changed_settings());
}

#[test]
fn a_flight_that_was_landed_because_it_lasted_too_long_is_read_with_that_outcome() {
    let outcome = |closing| {
        let (directory, config) = (tempfile::tempdir().unwrap(), configuration());
        let (path, mut recorder) = create(&directory, &config, false);
        for number in 1..=100 {
            let (reception, _) = pose(number);
            let (time, attitude) = (reception.received_at, [0.0, 0.0, 0.0, 1.0]);
            let mode = if number < 50 { Mode::Flying } else { Mode::Disarmed }.code();
            let tick = TelemetryV1 { time, tick: number, mode, ..TelemetryV1::default() };
            recorder.sample(&reception, Sample::Telemetry(&tick));
            let truth = TruthV1 { time, attitude, ..TruthV1::default() };
            recorder.sample(&reception, Sample::Truth(&truth));
        }
        recorder.close(&Flight { outcome: closing, ..Flight::new(&config) });
        flight(&RecordingFile::read(&path).unwrap()).unwrap().outcome
    };
    let read = [Outcome::Landed, Outcome::Unfinished, Outcome::Timeout].map(outcome);
    assert_eq!(read, [Outcome::Landed, Outcome::Landed, Outcome::Timeout]);
}

#[test]
fn a_file_of_another_recording_is_kept_and_passed_over() {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("r.2.mcap"), "of another").unwrap();
    let mut config = configuration();
    config.record.file_min = 1.0 / 60.0;
    let (_, result) = record(&directory, &config, true);
    assert_eq!((result.failure, result.files.len()), (None, 4));
    assert_eq!(result.files[1], directory.path().join("r.3.mcap"));
    assert_eq!(std::fs::read(directory.path().join("r.2.mcap")).unwrap(), b"of another");
    let read = result.files.iter().map(|path| poses(&RecordingFile::read(path).unwrap()).len());
    assert_eq!(read.sum::<usize>() as u64, SAMPLES);
}

#[test]
fn a_file_is_read_up_to_wherever_it_was_cut_off() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = record(&directory, &configuration(), false);
    let bytes = std::fs::read(&path).unwrap();
    let mut most = 0;
    // Nothing is missing without the magic bytes at the end.
    for length in (0..bytes.len() - MAGIC.len()).step_by(997) {
        match RecordingFile::parse(&path, &bytes[..length]) {
            Ok(file) => {
                let read = poses(&file);
                assert!(are_the_first(&read) && read.len() >= most, "cut off at {length}");
                assert!(file.cut_off.is_some(), "cut off at {length}");
                most = read.len();
            }
            Err(error) => assert!(most == 0 && error.to_string().contains("not a recording")),
        }
    }
    assert_eq!(most as u64, SAMPLES);
}

#[test]
fn a_chunk_holds_half_a_second_at_most() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = record(&directory, &configuration(), false);
    let bytes = std::fs::read(&path).unwrap();
    let mut rest = Cursor(&bytes[mcap::MAGIC.len()..]);
    let mut lengths = Vec::new();
    while let Some((opcode, body)) = rest.record() {
        if opcode == Opcode::Chunk as u8 {
            let mut fields = Cursor(body);
            let (first, last) = (fields.u64().unwrap(), fields.u64().unwrap());
            lengths.push(last - first);
        }
    }
    assert!(lengths.len() >= 6 && lengths.iter().all(|nanos| *nanos < 500_000_000), "{lengths:?}");
}

#[test]
fn chunks_within_chunks_are_damage() {
    let mut nested = Vec::new();
    for _ in 0..2000 {
        let records = std::mem::take(&mut nested);
        let size = records.len() as u64;
        nested.record(Opcode::Chunk, |bytes| {
            bytes.u64s(&[0, 0, size]);
            bytes.extend([0; 4]);
            bytes.text("");
            bytes.u64s(&[size]);
            bytes.extend_from_slice(&records);
        });
    }
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = record(&directory, &configuration(), false);
    let mut bytes = std::fs::read(&path).unwrap();
    // After the last whole record of a file that is cut off.
    bytes.truncate(bytes.len() * 3 / 4);
    let mut rest = Cursor(&bytes[mcap::MAGIC.len()..]);
    while rest.record().is_some() {}
    bytes.truncate(bytes.len() - rest.0.len());
    bytes.extend(nested);
    let file = RecordingFile::parse(&path, &bytes).unwrap();
    assert_eq!(file.cut_off.as_deref(), Some("record 0x06 is damaged"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn a_damaged_file_is_read_or_refused(flips in prop::collection::vec((any::<u32>(), any::<u8>()), 1..6)) {
        let directory = tempfile::tempdir().unwrap();
        let (path, _) = record(&directory, &configuration(), false);
        let mut bytes = std::fs::read(&path).unwrap();
        for (at, value) in flips {
            let at = at as usize % bytes.len();
            bytes[at] = value;
        }
        if let Ok(file) = RecordingFile::parse(&path, &bytes) {
            let _ = play(&file, &mut Poses::default());
            let _ = flight(&file);
            let _ = RecordingOverview::of(&file).to_text();
        }
    }
}
