//! Recordings in every format, played to their end with every clock.

use crate::common::{SERVICES, Testbed, assert_refused, json, number, stderr, wait_for};
use oqtal_bus::message::{CommandV1, Stamps};
use oqtal_bus::topic::{COMMAND, POSE, Role};
use oqtal_bus::transport::{Publish, Subscribe, Transport};

/// One second of a circle at 50 Hz: time \[s\], position \[m, world\], quaternion \[scalar last\].
fn poses() -> impl Iterator<Item = (f64, [f64; 3], [f64; 4])> {
    (0..50)
        .map(|k| {
            let t = f64::from(k) / 50.0;
            let half = 0.05 * t;
            ([t.cos() - 1.0, t.sin(), 1.0], [0.0, 0.0, half.sin(), half.cos()], t)
        })
        .map(|(position, attitude, t)| (t, position, attitude))
}

fn named() -> String {
    let rows = poses().map(|(t, [x, y, z], [qx, qy, qz, qw])| {
        format!("{},{x},{y},{z},{qx},{qy},{qz},{qw}\n", 1.7e9 + t)
    });
    std::iter::once("t,x,y,z,qx,qy,qz,qw\n".to_owned()).chain(rows).collect()
}

fn tum() -> String {
    let rows = poses().map(|(t, [x, y, z], [qx, qy, qz, qw])| {
        format!("{} {x} {y} {z} {qx} {qy} {qz} {qw}\n", 1.7e9 + t)
    });
    std::iter::once("# timestamp tx ty tz qx qy qz qw\n".to_owned()).chain(rows).collect()
}

fn euroc() -> String {
    let head = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n";
    let rows = poses().map(|(t, [x, y, z], [qx, qy, qz, qw])| {
        let nanos = 1_700_000_000_000_000_000 + (t * 1e9).round() as u64;
        format!("{nanos},{x},{y},{z},{qw},{qx},{qy},{qz}\n")
    });
    std::iter::once(head.to_owned()).chain(rows).collect()
}

#[test]
fn every_format_is_played_alike_by_every_clock() {
    let testbed = Testbed::new("replay");
    let mut ticks = Vec::new();
    for (name, text) in [("a.csv", named()), ("a.txt", tum()), ("b.csv", euroc())] {
        let file = format!("replay:{}", testbed.write(name, &text).display());
        for clock in ["in-process", "lockstep"] {
            let summary = testbed.summary(&["--mocap", &file, "--clock", clock]);
            assert_eq!(summary["outcome"], "replayed", "{name} {clock}");
            assert_eq!(summary["error_source"], "pose");
            assert!(summary["position_error_m"].is_null());
            assert!(summary["trajectory_hash"].is_null());
            ticks.push(number(&summary, "/ticks"));
        }
    }
    assert!(ticks[0] > 40.0);
    assert!(ticks.iter().all(|count| *count == ticks[0]), "{ticks:?}");
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
}

/// Recording of a vehicle at rest with poses at the given times \[ms\].
fn seen_at(millis: impl Iterator<Item = u64>) -> String {
    let rows = millis.map(|t| {
        let noise = 1e-6 * (t % 97) as f64;
        format!("{},{noise},0,1,0,0,0,1\n", t as f64 * 1e-3)
    });
    std::iter::once("t,x,y,z,qx,qy,qz,qw\n".to_owned()).chain(rows).collect()
}

#[test]
fn an_irregular_recording_leaves_the_state_and_a_gap_changes_it() {
    let testbed = Testbed::new("replay-gaps");
    let pauses = [10, 20, 40, 30, 10, 10, 40, 30, 20, 3, 17].into_iter().cycle();
    let times: Vec<u64> = pauses
        .take(400)
        .scan(0, |t, pause| {
            *t += pause;
            Some(*t)
        })
        .collect();
    let fly = |name: &str, text: String| {
        let file = format!("replay:{}", testbed.write(name, &text).display());
        testbed.summary(&["--mocap", &file, "--clock", "in-process"])
    };
    let regular = fly("a.csv", seen_at(times.iter().copied()));
    assert_eq!(regular["state_sequence"], serde_json::json!(["Nominal"]));
    // Frames are numbered by time: the count is exact within one frame at either end.
    assert!(number(&regular, "/lost/pose") <= 1.0, "{}", regular["lost"]);
    let gap = |k: usize| !(200..210).contains(&k);
    let gone = times.iter().enumerate().filter(|(k, _)| gap(*k)).map(|(_, t)| *t);
    let torn = fly("b.csv", seen_at(gone));
    assert_eq!(torn["state_sequence"], serde_json::json!(["Nominal", "Coast", "Nominal"]));
    assert!((number(&torn, "/lost/pose") - 10.0).abs() <= 2.0, "{}", torn["lost"]);
}

#[test]
fn in_real_time_a_recording_waits_until_the_daemon_listens() {
    let testbed = Testbed::new("replay-waits");
    let bus = testbed.bus();
    let mut poses = bus.observer(&POSE).unwrap();
    let mut health = bus.observer(&Role::Mocap.health()).unwrap();
    let file = format!("mocap.replay={:?}", testbed.write("a.csv", &named()).display().to_string());
    let _mocap = testbed.start(&["mocap-emu", "run", "--set", &file]);
    // Three health messages take one second, the length of the recording.
    for _ in 0..3 {
        wait_for("the cameras", || health.receive().unwrap());
    }
    assert!(poses.latest().unwrap().is_none(), "poses without a daemon");
    let mut commands = bus.writer(&COMMAND).unwrap();
    commands.send(0, Stamps::default(), CommandV1::default()).unwrap();
    commands.notify().unwrap();
    let (header, _) = wait_for("the first pose", || poses.receive().unwrap());
    assert_eq!(header.pose_sequence, 1);
}

#[test]
fn a_recording_keeps_its_own_timing_in_real_time() {
    let testbed = Testbed::new("replay-real");
    let file = format!("replay:{}", testbed.write("a.csv", &named()).display());
    let summary = testbed.summary(&["--mocap", &file]);
    assert_eq!(summary["outcome"], "replayed");
    assert!((0.5..2.0).contains(&number(&summary, "/duration_s")));
}

#[test]
fn a_daemon_that_only_observes_is_named_so_by_every_command_and_in_its_recordings() {
    for setting in ["safety.observe-only=true", "mocap.replay=\"rest.csv\""] {
        let testbed = Testbed::new("observes");
        testbed.write("rest.csv", &seen_at((0..1500).map(|k| 20 * k)));
        let _processes = SERVICES.map(|name| testbed.start(&[name, "run", "--set", setting]));
        let said = |words: &[&str]| {
            let output = testbed.oqtal(words).output().unwrap();
            let text = String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(&output);
            (output.status.code(), text)
        };
        let status = wait_for("an observation", || {
            Some(said(&["ctl", "status"]).1).filter(|text| text.contains("daemon: observing"))
        });
        let reason = "the daemon only observes (safety.observe-only, mocap.replay)";
        assert!(status.contains(reason) && !status.contains("square"), "{status}");
        for words in [&["arm"][..], &["land"], &["disarm"], &["hover"], &["goto", "0", "0", "1"]] {
            let refused = testbed.oqtal(&[&["ctl"], words].concat()).output().unwrap();
            assert_refused(
                &refused,
                1,
                &["safety.observe-only", "to fly, start the daemon without"],
            );
        }
        let (code, text) = said(&["ctl", "stop"]);
        assert_eq!(code, Some(0), "{text}");
        assert!(text.contains(reason) && !text.contains("ctl arm"), "{text}");
        let (code, text) = said(&["record", "--attach", "--seconds", "1", "--out", "a.mcap"]);
        assert_eq!(code, Some(0), "{text}");
        let report = testbed.study(&["report", "a.mcap", "--json"]).output().unwrap();
        assert_eq!(report.status.code(), Some(0), "{}", stderr(&report));
        let summary = json(&report);
        assert_eq!(summary["outcome"], "observed", "{summary:#}");
        assert!(summary["shortfall"].is_null(), "{summary:#}");
    }
}
