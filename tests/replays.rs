//! Recordings, played to their end in every format and by every clock.

mod common;

use common::{Testbed, number};

/// A second of a vehicle that circles, at 50 Hz, as (t, position, quaternion scalar last).
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

#[test]
fn a_recording_keeps_its_own_timing_in_real_time() {
    let testbed = Testbed::new("replay-real");
    let file = format!("replay:{}", testbed.write("a.csv", &named()).display());
    let summary = testbed.summary(&["--mocap", &file]);
    assert_eq!(summary["outcome"], "replayed");
    assert!((0.5..2.0).contains(&number(&summary, "/duration_s")));
}
