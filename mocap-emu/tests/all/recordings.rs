//! Recordings in the three formats: accepted content, refused content and its error messages.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use oqtal_control::quaternion::Attitude;
use oqtal_mocap_emu::recording::{MAX_BYTES, Recording, Timing};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

fn parse(text: &str) -> Recording {
    Recording::parse(Path::new("a.csv"), text.as_bytes()).unwrap()
}

fn error(text: &str) -> String {
    Recording::parse(Path::new("a.csv"), text.as_bytes()).unwrap_err().to_string()
}

/// The error message for two lines under a complete header.
fn error_of_rows(first: &str, second: &str) -> String {
    error(&format!("t,x,y,z,qx,qy,qz,qw\n{first}\n{second}\n"))
}

fn times_ns(recording: &Recording) -> Vec<u64> {
    recording.poses().iter().map(|pose| pose.time_ns).collect()
}

#[test]
fn one_flight_is_the_same_in_every_format() {
    let named = Recording::read(&fixture("named.csv")).unwrap();
    assert_eq!(named, Recording::read(&fixture("tum.txt")).unwrap());
    assert_eq!(named, Recording::read(&fixture("euroc.csv")).unwrap());

    let poses = named.poses();
    assert_eq!(poses.len(), 20);
    assert_eq!(
        times_ns(&named)[..6],
        [0, 16_700_000, 33_300_000, 50_000_000, 70_000_000, 70_200_000]
    );
    // The fixtures contain a climbing circle at 1.3 rad/s, with a roll of 0.06 rad and yaw along the path.
    let rolled = Attitude::from_rotation_vector(Vector3::x() * 0.06);
    for pose in poses {
        let time = pose.time_ns as f64 * 1e-9;
        let angle = 1.3 * time;
        let circle =
            Vector3::new(0.6 * angle.cos() + 0.05, 0.6 * angle.sin() - 0.2, 0.8 + 0.15 * time);
        assert!((pose.position - circle).norm() < 1e-6, "{pose:?}");
        let yawed = Attitude::from_rotation_vector(Vector3::z() * angle);
        let expected = yawed.unit_quaternion() * rolled.unit_quaternion();
        let expected = Attitude::from_unit_quaternion(expected);
        assert!(pose.attitude.rotation_to(&expected).norm() < 1e-8, "{pose:?}");
    }
}

#[test]
fn timing_is_that_of_the_recorded_arrivals() {
    let timing = Recording::read(&fixture("named.csv")).unwrap().timing();
    let expected =
        Timing { mean_rate_hz: 19.0e9 / 359.1e6, duration_ns: 359_100_000, median_ns: 16_700_000 };
    assert_eq!(timing, expected);
}

#[test]
fn times_keep_every_digit() {
    let unix = parse(
        "t,x,y,z,qx,qy,qz,qw\n1724083834.4711175,0,0,0,0,0,0,1\n1724083834.471117501,0,0,0,0,0,0,1\n",
    );
    assert_eq!(times_ns(&unix), [0, 1]);
    let scientific =
        parse("1.724083834471117500e+09 0 0 0 0 0 0 1\n1724083834.4711180004 0 0 0 0 0 0 1");
    assert_eq!(times_ns(&scientific), [0, 500]);
    let around_zero =
        parse("-.5 0 0 0 0 0 0 1\n-1e-9 0 0 0 0 0 0 1\n0e99 0 0 0 0 0 0 1\n2.5e-9 0 0 0 0 0 0 1");
    assert_eq!(times_ns(&around_zero), [0, 499_999_999, 500_000_000, 500_000_003]);
}

#[test]
fn equal_times_are_kept() {
    let recording =
        parse("0 0 0 0 0 0 0 1\n0 1 0 0 0 0 0 1\n0.01 2 0 0 0 0 0 1\n0.01 3 0 0 0 0 0 1\n");
    assert_eq!(times_ns(&recording), [0, 0, 10_000_000, 10_000_000]);
}

#[test]
fn line_ends_marks_comments_and_blank_lines_change_nothing() {
    let plain = fs::read_to_string(fixture("named.csv")).unwrap();
    let dressed =
        format!("\u{feff}\r\n# a comment\r\n{}\r\n \r\n# end\r\n", plain.replace('\n', "\r\n"));
    assert_eq!(parse(&dressed), parse(&plain));
    assert_eq!(parse(plain.trim_end()), parse(&plain));
    assert_eq!(parse(&plain.replace("qW,qx", "\"qW\",\"qx\"").replace(',', " , ")), parse(&plain));
}

#[test]
fn a_comment_that_names_the_columns_of_tum_text_is_not_a_header() {
    let rows = "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n";
    assert_eq!(parse(&format!("# timestamp, tx, ty, tz, qx, qy, qz, qw\n{rows}")), parse(rows));
}

#[test]
fn quaternions_come_out_with_unit_norm() {
    let recording = parse("0 0 0 0 0 0 0 0.995\n1 0 0 0 0 0 0 -1.005\n");
    assert_eq!(recording.poses()[0].attitude.xyzw(), [0.0, 0.0, 0.0, 1.0]);
    assert_eq!(recording.poses()[1].attitude.xyzw(), [0.0, 0.0, 0.0, -1.0]);
}

#[test]
fn a_file_that_cannot_be_read_is_named_with_the_reason() {
    let missing = Recording::read(Path::new("no/such.csv")).unwrap_err();
    assert_eq!(
        missing.to_string(),
        "no/such.csv: cannot be read: No such file or directory (os error 2)"
    );
    assert_eq!(missing.line, None);
}

#[test]
fn a_file_above_the_limit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.csv");
    File::create(&path).unwrap().set_len(MAX_BYTES + 1).unwrap();
    let error = Recording::read(&path).unwrap_err().to_string();
    assert_eq!(error, format!("{}: larger than 64 MiB", path.display()));
}

#[test]
fn empty_files_are_refused() {
    assert_eq!(error(""), "a.csv:1: empty");
    assert_eq!(error("\r\n  \n# only words\n"), "a.csv:1: empty");
}

#[test]
fn unknown_formats_are_refused() {
    let unknown = "neither a header naming t,x,y,z,qx,qy,qz,qw, nor TUM text, nor a EuRoC header";
    assert_eq!(error("0.1,0,0,0,0,0,0,1\n0.2,0,0,0,0,0,0,1\n"), format!("a.csv:1: {unknown}"));
    assert_eq!(error("# words\n\ntime;x;y;z\n"), format!("a.csv:3: {unknown}"));
    assert_eq!(error("\0\u{1}\u{2}"), format!("a.csv:1: {unknown}"));
}

#[test]
fn missing_columns_are_named() {
    assert_eq!(error("t,x,y,z,qy,qz\n"), "a.csv:1: the header lacks qx, qw");
    assert_eq!(error("t,x [mm],y,z,qx,qy,qz,qw\n"), "a.csv:1: the header lacks x");
    let header =
        "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n";
    assert_eq!(error(header), "a.csv:1: the header lacks p_RS_R_z");
}

#[test]
fn lines_cut_short_are_refused() {
    let good = "0.1,0,0,0,0,0,0,1";
    assert_eq!(error_of_rows(good, "0.2"), "a.csv:3: expected 8 fields, found 1");
    assert_eq!(error_of_rows(good, "0.2,0,0,0,0,0,0,1,5"), "a.csv:3: expected 8 fields, found 9");
    assert_eq!(error("0 0 0 0 0 0 0 1\r\n\r\n1 0 0"), "a.csv:3: expected 8 fields, found 3");
}

#[test]
fn fields_that_are_not_finite_numbers_are_refused() {
    let good = "0.1,0,0,0,0,0,0,1";
    assert_eq!(error_of_rows(good, "0.2,0,0,0,0,0,0,one"), "a.csv:3: qw is not a number: \"one\"");
    assert_eq!(error_of_rows(good, "0.2,,0,0,0,0,0,1"), "a.csv:3: x is not a number: \"\"");
    let long = format!("0.2,0,{},0,0,0,0,1", "a".repeat(1000));
    assert_eq!(
        error_of_rows(good, &long),
        format!("a.csv:3: y is not a number: \"{}\"", "a".repeat(40))
    );
    assert_eq!(error_of_rows("0.1,NaN,0,0,0,0,0,1", good), "a.csv:2: x is not finite");
    assert_eq!(error_of_rows("inf,0,0,0,0,0,0,1", good), "a.csv:2: t is not finite");
    assert_eq!(error("0 0 0 0 0 0 0 1\n1 0 -1e999 0 0 0 0 1"), "a.csv:2: ty is not finite");
}

#[test]
fn times_that_nanoseconds_cannot_hold_are_refused() {
    let good = "0.1,0,0,0,0,0,0,1";
    assert_eq!(error_of_rows(good, "1e10,0,0,0,0,0,0,1"), "a.csv:3: t is out of range");
    assert_eq!(error_of_rows("-9223372037,0,0,0,0,0,0,1", good), "a.csv:2: t is out of range");
    let widest = parse("-9223372036.8 0 0 0 0 0 0 1\n9223372036.8 0 0 0 0 0 0 1");
    assert_eq!(times_ns(&widest), [0, 18_446_744_073_600_000_000]);
}

#[test]
fn time_going_back_is_refused_with_both_times() {
    assert_eq!(
        error_of_rows("1748113190.862681,0,0,0,0,0,0,1", "1748113190.862680,0,0,0,0,0,0,1"),
        "a.csv:3: time goes back from 1748113190.862681 to 1748113190.862680"
    );
}

#[test]
fn quaternions_that_are_not_of_unit_norm_are_refused() {
    assert_eq!(
        error_of_rows("0,0,0,0,0,0,0,1", "1,0,0,0,0,0,0.6,0.7"),
        "a.csv:3: norm of the quaternion is 0.9220, not 1"
    );
    assert_eq!(
        error_of_rows("0,0,0,0,0,0,0,0", "1,0,0,0,0,0,0,1"),
        "a.csv:2: norm of the quaternion is 0.0000, not 1"
    );
}

#[test]
fn fewer_than_two_poses_are_refused() {
    let expected = "expected at least 2 poses at different times, found";
    let header = "t,x,y,z,qx,qy,qz,qw\n";
    assert_eq!(error(header), format!("a.csv:1: {expected} 0"));
    let one = format!("{header}0,0,0,0,0,0,0,1\n\n");
    assert_eq!(error(&one), format!("a.csv:2: {expected} 1"));
    let at_once = format!("{header}5,0,0,0,0,0,0,1\n5,1,0,0,0,0,0,1\n");
    assert_eq!(error(&at_once), format!("a.csv:3: {expected} 2"));
}

/// Real recordings in the folder named by the environment variable `OQTAL_RECORDINGS`: each is accepted, or refused with its
/// file name and line.
#[test]
fn real_recordings_are_read_or_refused_with_a_line() {
    let Some(folder) = std::env::var_os("OQTAL_RECORDINGS") else {
        eprintln!("skipped: OQTAL_RECORDINGS names no folder");
        return;
    };
    let mut read = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if !path.extension().is_some_and(|extension| extension == "csv" || extension == "txt") {
            continue;
        }
        match Recording::read(&path) {
            Ok(recording) => {
                read += 1;
                println!(
                    "{}: {} poses, {:?}",
                    path.display(),
                    recording.poses().len(),
                    recording.timing()
                );
            }
            Err(error) => {
                println!("{error}");
                assert!(error.line.is_some());
                assert!(error.to_string().starts_with(&format!("{}:", path.display())));
            }
        }
    }
    assert!(read > 0, "no recording in the folder");
}
