//! Waypoint tables: what is accepted, what is refused, and the path between the points.

use std::fmt::Write;

use nalgebra::Vector3;
use oqtal_control::trajectory::{
    Reference, Trajectory, TrajectoryKind, TrajectoryOptions, WaypointCurve, WaypointProblem,
    Waypoints,
};
use proptest::prelude::*;

fn trajectory(text: &str) -> Trajectory {
    let options =
        TrajectoryOptions { kind: TrajectoryKind::Waypoints, ..TrajectoryOptions::default() };
    options.trajectory(Some(Waypoints::parse(text).unwrap())).unwrap()
}

#[test]
fn path_passes_through_its_points_and_rests_at_its_ends() {
    let path = trajectory(
        "\u{feff}t,x,y,z,yaw_deg\r\n0,0,0,1,0\r\n\r\n4, 1, 0.5, 1.2, 6\r\n9,2,0.5,1,18\r\n",
    );
    assert_eq!(path.duration_s(), 9.0);
    assert_eq!(path.sample(4.0).position, Vector3::new(1.0, 0.5, 1.2));
    assert_eq!(path.sample(4.0).yaw_rad, 6.0_f64.to_radians());
    assert!(path.sample(4.0).velocity.x > 0.1);
    for (t_s, position) in [(0.0, Vector3::new(0.0, 0.0, 1.0)), (9.0, Vector3::new(2.0, 0.5, 1.0))]
    {
        assert_eq!(path.sample(t_s).position, position);
        assert_eq!(path.sample(t_s).velocity, Vector3::zeros());
    }
    assert_eq!(path.sample(-1.0), path.sample(0.0));
    assert_eq!(path.sample(10.0), path.sample(9.0));
}

#[test]
fn yaw_is_zero_without_its_column_and_turns_as_written_unless_it_is_wrapped() {
    assert_eq!(trajectory("t,x,y,z\n0,0,0,1\n1,1,0,1\n").sample(0.7).yaw_rad, 0.0);
    for (written, flown) in [
        ([0.0, 180.0, 360.0], [0.0, 180.0, 360.0]),
        ([0.0, 270.0, -90.0], [0.0, 270.0, -90.0]),
        ([170.0, -170.0, -150.0], [170.0, 190.0, 210.0]),
        ([-170.0, 170.0, -180.0], [-170.0, -190.0, -180.0]),
        ([180.0, -180.0, 0.0], [180.0, 180.0, 360.0]),
    ] {
        let [a, b, c] = written;
        let text = format!("t,x,y,z,yaw_deg\n0,0,0,1,{a}\n9,0,0,1,{b}\n18,0,0,1,{c}\n");
        let path = trajectory(&text);
        for (t_s, flown) in [0.0, 9.0, 18.0].into_iter().zip(flown) {
            let yaw_deg = path.sample(t_s).yaw_rad.to_degrees();
            assert!((yaw_deg - flown).abs() < 1e-9, "{yaw_deg} of {written:?} at {t_s} s");
        }
        let rate = |t_s: f64| path.sample(t_s).yaw_rate_rad_s;
        let difference = path.sample(4.0001).yaw_rad - path.sample(3.9999).yaw_rad;
        assert!((rate(4.0) - difference / 2e-4).abs() < 1e-6, "{written:?}");
        assert_eq!([rate(0.0), rate(18.0)], [0.0; 2]);
    }
}

#[test]
fn dense_points_of_a_smooth_path_give_back_the_path() {
    let mut text = String::from("t,x,y,z\n");
    for k in 0..=100 {
        let t_s = f64::from(k) * 0.1;
        writeln!(text, "{t_s},{},{},1", (0.6 * t_s).sin(), 0.4 * t_s).unwrap();
    }
    let path = trajectory(&text);
    for k in 10..900 {
        let t_s = 0.5 + f64::from(k) * 0.01;
        let reference = path.sample(t_s);
        assert!((reference.position.x - (0.6 * t_s).sin()).abs() < 2e-3);
        assert!((reference.velocity.y - 0.4).abs() < 1e-9);
    }
}

#[test]
fn least_snap_passes_through_the_points_at_rest_at_the_ends_and_smooth_in_between() {
    let options = TrajectoryOptions {
        kind: TrajectoryKind::Waypoints,
        waypoints_curve: WaypointCurve::MinimumSnap,
        ..TrajectoryOptions::default()
    };
    let text = "t,x,y,z,yaw_deg\n0,0,0,1,0\n1.5,1,0.5,1.2,6\n2,2,0.5,1,18\n5,2,-1,1.5,20\n";
    let path = options.trajectory(Some(Waypoints::parse(text).unwrap())).unwrap();
    for (t_s, [x, y, z]) in
        [(1.5, [1.0, 0.5, 1.2]), (2.0, [2.0, 0.5, 1.0]), (5.0, [2.0, -1.0, 1.5])]
    {
        let off = path.sample(t_s).position - Vector3::new(x, y, z);
        assert!(off.norm() < 1e-9, "{off} at {t_s} s");
    }
    for t_s in [0.0, 5.0] {
        let end = path.sample(t_s);
        assert!(end.velocity.norm() + end.acceleration.norm() + end.jerk.norm() < 1e-7, "{end:?}");
    }
    let h = 1e-4;
    for k in 1..500 {
        let t_s = f64::from(k) * 0.01;
        let [before, now, after] = [-h, 0.0, h].map(|off_s| path.sample(t_s + off_s));
        let slope = |of: fn(&Reference) -> Vector3<f64>| (of(&after) - of(&before)) / (2.0 * h);
        assert!((slope(|it| it.position) - now.velocity).norm() < 1e-4, "velocity at {t_s} s");
        assert!(
            (slope(|it| it.velocity) - now.acceleration).norm() < 1e-3,
            "acceleration at {t_s} s"
        );
        assert!((slope(|it| it.acceleration) - now.jerk).norm() < 1e-2, "jerk at {t_s} s");
        assert!((slope(|it| it.jerk) - now.snap).norm() < 1e-1, "snap at {t_s} s");
        // The fifth derivative is continuous at the points too: the snap has no kink.
        let kink = (after.snap - now.snap * 2.0 + before.snap).norm();
        assert!(kink < 1e-3, "{kink} at {t_s} s");
    }
}

#[test]
fn bad_tables_are_refused_with_line_and_reason() {
    use WaypointProblem as P;
    let count = |expected, found| P::FieldCount { expected, found };
    let cases = [
        ("", 1, P::Header),
        ("x,y,z,t\n0,0,0,1\n", 1, P::Header),
        ("t,x,y\n0,0,0\n", 1, P::Header),
        ("t,x,y,z,yaw\n0,0,0,1,0\n1,1,0,1,0\n", 1, P::YawUnit),
        ("t,x,y,z,yaw_rad\n0,0,0,1,0\n1,1,0,1,0\n", 1, P::YawUnit),
        ("t,x,y,z,yaw_deg,roll\n0,0,0,1,0,0\n", 1, P::Header),
        ("\n0,0,0,1\n1,0,0,1\n", 2, P::Header),
        ("t,x,y,z\n", 1, P::TooFew),
        ("t,x,y,z\n0,0,0,1\n", 2, P::TooFew),
        ("t,x,y,z\n0,0,0,1\n\n1,0,0\n", 4, count(4, 3)),
        ("t,x,y,z,yaw_deg\n0,0,0,1\n", 2, count(5, 4)),
        ("t,x,y,z\n0,0,0,1\n1,0,oops,1\n", 3, P::Number { column: "y" }),
        ("t,x,y,z\n0,0,0,1\n1,0,0,NaN\n", 3, P::Number { column: "z" }),
        ("t,x,y,z\n0,inf,0,1\n", 2, P::Number { column: "x" }),
        ("t,x,y,z,yaw_deg\n0,0,0,1,1e5\n", 2, P::Number { column: "yaw_deg" }),
        ("t,x,y,z\n0,0,0,1\n2,0,0,-0.4\n", 3, P::BelowFloor),
        ("t,x,y,z\n0.5,0,0,1\n", 2, P::FirstTime),
        ("t,x,y,z\n0,0,0,1\n2,0,0,1\n2,1,0,1\n", 4, P::TimeOrder),
        ("t,x,y,z\n0,0,0,1\n2,0,0,1\n1,1,0,1\n", 4, P::TimeOrder),
    ];
    for (text, line, problem) in cases {
        let error = Waypoints::parse(text).unwrap_err();
        assert_eq!((error.line, error.problem), (line, problem), "{text:?}");
        assert!(error.to_string().starts_with(&format!("line {line}: ")));
    }
}

proptest! {
    #[test]
    fn any_text_is_parsed_or_refused(text in "(t,x,y,z\n)?[-0-9.,eE\n]{0,80}") {
        let _ = Waypoints::parse(&text);
    }

    #[test]
    fn path_is_continuous_in_position_and_velocity_and_stays_between_its_points(
        points in prop::collection::vec((0.2..5.0_f64, prop::array::uniform3(-3.0..3.0_f64)), 2..8),
    ) {
        let mut text = String::from("t,x,y,z\n");
        let mut times = Vec::new();
        // From the floor up.
        let points: Vec<_> = points.into_iter().map(|(dt_s, [x, y, z])| (dt_s, [x, y, z.abs()])).collect();
        for (dt_s, [x, y, z]) in &points {
            let t_s: f64 = times.last().map_or(0.0, |last| last + dt_s);
            writeln!(text, "{t_s},{x},{y},{z}").unwrap();
            times.push(t_s);
        }
        let path = trajectory(&text);
        for (k, pair) in times.windows(2).enumerate() {
            let (from, to) = (Vector3::from(points[k].1), Vector3::from(points[k + 1].1));
            let (least, greatest) = (from.inf(&to), from.sup(&to));
            for j in 0..=50 {
                let t_s = pair[0] + (pair[1] - pair[0]) * f64::from(j) / 50.0;
                let position = path.sample(t_s).position;
                prop_assert!((0..3).all(|i| (least[i] - 1e-9..=greatest[i] + 1e-9).contains(&position[i])));
                let h = 1e-6;
                let (before, after) = (path.sample(t_s - h), path.sample(t_s + h));
                prop_assert!((after.velocity - before.velocity).norm() < 1e-2);
                let slope = (after.position - before.position) / (2.0 * h);
                if (h..path.duration_s() - h).contains(&t_s) {
                    prop_assert!((slope - path.sample(t_s).velocity).norm() < 1e-2);
                }
            }
        }
    }
}
