use super::*;
use crate::room::StoppingRoom;
use crate::trajectory;
use nalgebra::Vector4;
use oqtal_bus::code::Cause;
use oqtal_config::Setting;
use oqtal_control::trajectory::{Detour, FlightPlan, Reference, ReferenceMotion, Waypoints};

fn check(settings: &[&str], start: Option<Vector3<f64>>) -> Result<(), String> {
    let settings: Vec<_> =
        settings.iter().map(|text| Setting::parse("test", text).unwrap()).collect();
    let config = Config::from_settings(&settings).unwrap();
    let trajectory = trajectory(&config).unwrap();
    check_room(&config, &trajectory, start).map_err(|error| error.to_string())
}

#[test]
fn a_trajectory_that_fits_nowhere_is_refused_with_its_ends_and_the_border() {
    assert_eq!(check(&[], None), Ok(()));
    let circle = ["trajectory.kind=\"circle\"", "trajectory.circle.radius-m=4.0"];
    assert_eq!(check(&circle, None), Ok(()));
    let narrow = |border| check(&[&circle[..], &[border]].concat(), None).unwrap_err();
    let told = narrow("fence.x-m=[-4.5, 4.5]");
    assert!(told.starts_with("`fence.x-m` is [-4.5, 4.5]"), "{told}");
    assert!(told.contains("at least 10.38 m wide") && told.contains("x = "), "{told}");
    assert_eq!(check(&[&circle[..], &["fence.x-m=[-5.19, 5.19]"]].concat(), None), Ok(()));
    let told = narrow("fence.y-m=[-4.5, 4.5]");
    assert!(told.contains("at least 10.44 m wide"), "{told}");
    let polygon = "fence.polygon-m=[[-9.0, -4.9], [9.0, -4.9], [9.0, 4.9], [-9.0, 4.9]]";
    assert!(narrow(polygon).starts_with("`fence.polygon-m`"), "{}", narrow(polygon));
    let told = check(&["trajectory.height-m=3.0", "fence.z-m=[0.0, 3.5]"], None).unwrap_err();
    assert!(told.starts_with("`fence.z-m`") && told.contains("z = 3.00 m"), "{told}");
}

#[test]
fn of_a_room_that_is_too_narrow_the_setting_that_made_it_so_is_named() {
    let blamed = |settings: [&str; 3]| {
        let settings = settings.iter().enumerate();
        let settings: Vec<_> = settings
            .map(|(index, text)| Setting::parse(&format!("flag {index}"), text).unwrap())
            .collect();
        let config = Config::from_settings(&settings).unwrap();
        let path = trajectory(&config).unwrap();
        require_flyable(&config, &path, Some(Vector3::zeros())).unwrap_err().to_string()
    };
    let (border, margin) = ("fence.y-m=[-2.25, 2.25]", "fence.soft-margin-m=0.5");
    let told = blamed([border, margin, "fence.soft-margin-m=1.0"]);
    let blame = "flag 2: with `fence.soft-margin-m` = 1.0: `fence.y-m` is [-2.25, 2.25]";
    assert!(told.starts_with(blame), "{told}");
    let told = blamed([margin, border, "fence.y-m=[-1.7, 1.7]"]);
    assert!(told.starts_with("flag 2: `fence.y-m` is [-1.7, 1.7]"), "{told}");
    let told = blamed([border, margin, "trajectory.square.side-m=2.0"]);
    assert!(told.starts_with("flag 2: with `trajectory.square.side-m` = 2.0"), "{told}");
}

/// The configuration of `settings`, and its trajectory or the one through the points `table`.
fn flight(settings: &[&str], table: Option<&str>) -> (Config, Trajectory) {
    let settings: Vec<_> =
        settings.iter().map(|text| Setting::parse("test", text).unwrap()).collect();
    let config = Config::from_settings(&settings).unwrap();
    let points = table.map(|table| Waypoints::parse(table).unwrap());
    let trajectory = config.trajectory.trajectory(points).unwrap();
    (config, trajectory)
}

const WAYPOINTS: [&str; 2] = ["trajectory.kind=waypoints", "trajectory.waypoints-file=way.csv"];

/// Why a flight from the origin is refused; `None` if it is accepted.
fn refused(settings: &[&str], table: Option<&str>) -> Option<String> {
    let (config, trajectory) = flight(settings, table);
    let told = check_flyable(&config, &trajectory, Some(Vector3::zeros()));
    told.err().map(|error| error.to_string())
}

#[test]
fn a_path_near_the_floor_is_refused_with_a_height_that_suffices() {
    let check = |height: f64| {
        let table = format!("t,x,y,z\n0,0,0,1\n60,0,0,{height}\n61,0,0,1\n");
        let (config, trajectory) = flight(&WAYPOINTS, Some(&table));
        check_height(&config, &trajectory)
    };
    assert_eq!(check(0.16), Ok(()));
    let told = check(0.14).unwrap_err().to_string();
    assert!(told.contains("at 60.0 s the trajectory is at [0.000, 0.000, 0.140] m"), "{told}");
    for (half_length, height) in [("2.4", "1.36"), ("3", "1.66")] {
        let length = format!("trajectory.lemniscate.half-length-m={half_length}");
        let upright =
            ["trajectory.kind=lemniscate", "trajectory.lemniscate.plane=upright", &length];
        let told = refused(&upright, None).unwrap();
        let remedy = format!("`trajectory.height-m` is 1, it must be at least {height}, or");
        assert!(told.starts_with(&remedy) && !told.contains("fence"), "{told}");
        let high = format!("trajectory.height-m={height}");
        assert_eq!(refused(&[&upright[..], &[&high]].concat(), None), None);
        let (config, trajectory) = flight(&upright, None);
        assert!(require_flyable_in_flight(&config, &trajectory).is_ok(), "the vehicle may be high");
    }
    for kind in ["hover", "step", "square", "circle", "attitude-chirp", "attitude-doublet"] {
        let kind = format!("trajectory.kind={kind}");
        assert_eq!(refused(&[&kind], None), None);
        let told = refused(&[&kind, "trajectory.height-m=0.1"], None).unwrap();
        assert!(
            told.contains("0.16: the trajectory must stay") && !told.contains("smaller"),
            "{told}"
        );
    }
}

#[test]
fn every_fence_that_a_refusal_names_suffices() {
    for tenths in 10..30 {
        let radius = format!("trajectory.circle.radius-m={}", f64::from(tenths) / 10.0);
        let circle = ["trajectory.kind=circle", "fence.soft-margin-m=0.5", &radius];
        let narrow = ["fence.x-m=[-1, 1]", "fence.y-m=[-1, 1]"];
        let told = refused(&[&circle[..], &narrow].concat(), None).unwrap();
        let fence = ["x", "y"].map(|axis| {
            let (before, _) = told.split_once(&format!(" m in {axis}")).unwrap();
            let (_, range) = before.rsplit_once("from ").unwrap();
            format!("fence.{axis}-m=[{}]", range.replace(" to ", ","))
        });
        let wide = [&circle[..], &[&fence[0], &fence[1]]].concat();
        assert_eq!(refused(&wide, None), None, "{told}");
    }
}

#[test]
fn no_accepted_flight_has_a_heading_that_the_daemon_refuses() {
    let turned = |first: f64| format!("t,x,y,z,yaw_deg\n0,0,0,1,{first}\n8,1,0,1,{first}\n");
    let fence = Fence::new(&Config::default().fence);
    for first_deg in [-170.0, 30.0, 90.0, 150.0, 180.0, 270.0, 720.0] {
        let (config, trajectory) = flight(&WAYPOINTS, Some(&turned(first_deg)));
        assert!(is_flyable(&config, &trajectory, Some(Vector3::zeros())));
        let plan = FlightPlan::from_origin(&config.trajectory, &trajectory);
        let mut guard = crate::setpoint::SetpointGuard::new(fence.clone());
        let mut last: Option<Reference> = None;
        for tick in 0..(60.0 * plan.end_s()) as u32 {
            let reference = plan.sample(f64::from(tick) / 60.0);
            assert_eq!(guard.pass(0, &reference).refusal, None);
            // 2 rad/s, with the share for corrections.
            let turn = reference.yaw_rad - last.map_or(reference.yaw_rad, |last| last.yaw_rad);
            assert!(turn.abs() <= 1.6 / 60.0, "{first_deg}: {turn} rad at tick {tick}");
            last = Some(reference);
        }
    }
    let hasty = [&WAYPOINTS[..], &["trajectory.settle-s=0"]].concat();
    let told = refused(&hasty, Some(&turned(150.0))).unwrap();
    assert!(told.starts_with("`trajectory.settle-s` is 0, it must be at least 3.1"), "{told}");
    let brief = "t,x,y,z,yaw_deg\n0,0,0,1,0\n5,0,0,1,0\n5.002,0,0,1,160\n9,0,0,1,160\n";
    let told = refused(&WAYPOINTS, Some(brief)).unwrap();
    assert!(told.contains("rad/s in yaw for the trajectory at 5.00 s"), "{told}");
    assert!(!told.contains("would do"), "{told}");
    let unlimited = [&WAYPOINTS[..], &["vehicle.preset=spacecraft"]].concat();
    let told = refused(&unlimited, Some(brief)).unwrap();
    assert!(told.contains("0 s it turns by more than 137 deg in one tick"), "{told}");
    let step =
        ["trajectory.kind=step", "trajectory.step.axis=yaw", "trajectory.step.angle-deg=170"];
    assert!(refused(&step, None).unwrap().starts_with("`trajectory.step.angle-deg` is 170"));
}

#[test]
fn remedies_suffice_and_name_all_axes() {
    let far = "t,x,y,z\n0,0,0,1\n30,9,0,1\n60,0,0,1\n";
    let told = refused(&WAYPOINTS, Some(far)).unwrap();
    assert!(told.contains("it needs a fence from -8.00 to 10.11 m in x, or waypoints"), "{told}");
    assert_eq!(refused(&[&WAYPOINTS[..], &["fence.x-m=[-8, 10.11]"]].concat(), Some(far)), None);
    let near = "t,x,y,z\n0,0,0,1\n30,7.5,0,1\n60,0,0,1\n";
    let told = refused(&WAYPOINTS, Some(near)).unwrap();
    assert!(told.contains("or fence.soft-margin-m of at most 0.39"), "{told}");
    assert_eq!(
        refused(&[&WAYPOINTS[..], &["fence.soft-margin-m=0.39"]].concat(), Some(near)),
        None
    );
    let circle = [
        "trajectory.kind=circle",
        "trajectory.circle.radius-m=7.5",
        "trajectory.circle.period-s=30",
    ];
    let told = refused(&circle, None).unwrap();
    let fence = "a fence from -16.11 to 8.00 m in x and from -8.61 to 8.61 m in y, or smaller";
    assert!(told.contains(fence), "{told}");
    let wide = [&circle[..], &["fence.x-m=[-16.11, 8]", "fence.y-m=[-8.61, 8.61]"]].concat();
    assert_eq!(refused(&wide, None), None);
    let low = ["trajectory.kind=hover", "fence.z-m=[0, 6]"];
    let told = refused(&low, None).unwrap();
    assert!(told.ends_with("it needs a fence from -0.10 to 6.00 m in z"), "{told}");
    assert_eq!(refused(&["trajectory.kind=hover", "fence.z-m=[-0.1, 6]"], None), None);
}

#[test]
fn a_factor_of_time_suffices_for_every_limit_and_for_the_room() {
    let circle = |times: f64, radius_m: f64, fence_m: f64| {
        [
            "trajectory.kind=circle".to_owned(),
            format!("trajectory.circle.radius-m={radius_m}"),
            format!("trajectory.circle.period-s={}", 2.0 * times),
            format!("trajectory.circle.ramp-s={}", 2.0 * times),
            format!("fence.x-m=[-{fence_m}, {fence_m}]"),
            format!("fence.y-m=[-{fence_m}, {fence_m}]"),
        ]
    };
    for (radius_m, fence_m) in [(1.0, 3.3), (2.0, 5.4), (3.0, 8.0)] {
        for start in [None, Some(Vector3::zeros())] {
            let told = |times| {
                let settings = circle(times, radius_m, fence_m);
                let settings = settings.each_ref().map(String::as_str);
                let (config, trajectory) = flight(&settings, None);
                let told = check_flyable(&config, &trajectory, start).err();
                told.map_or_else(String::new, |error| error.to_string())
            };
            let first = told(1.0);
            let factors: Vec<f64> = first
                .split("multiplied by ")
                .skip(1)
                .filter_map(|rest| rest.split([' ', ',', ';']).next()?.parse().ok())
                .collect();
            assert!(!factors.is_empty(), "{first}");
            for factor in factors {
                assert_eq!(told(factor), "", "{radius_m} m, {start:?}: {first}");
            }
        }
    }
}

#[test]
fn where_the_vehicle_could_only_brake_below_the_floor_no_fence_is_a_remedy() {
    let fast = [
        "trajectory.kind=lemniscate",
        "trajectory.lemniscate.plane=upright",
        "trajectory.lemniscate.half-length-m=3",
        "trajectory.lemniscate.period-s=6",
        "vehicle.max-thrust-n=40",
        "fence.z-m=[-0.5, 9.0]",
    ];
    let told = refused(&[&fast[..], &["trajectory.height-m=1.8"]].concat(), None).unwrap();
    let both =
        "with that room, `vehicle.rate-authority-rad-s` is 2, it must be at least 2.87 rad/s";
    assert!(told.contains(both), "{told}");
    let with = |setting: &str| check(&[&fast[..], &[setting]].concat(), Some(Vector3::zeros()));
    let remedy = "it needs trajectory.lemniscate.period-s and ramp-s multiplied by ";
    assert!(told.contains(remedy) && !told.contains("a fence from"), "{told}");
    let height =
        told.split("trajectory.height-m = ").nth(1).and_then(|text| text.split(',').next());
    let height = height.unwrap_or_else(|| panic!("{told}"));
    assert_eq!(with(&format!("trajectory.height-m={height}")), Ok(()));
}

#[test]
fn a_polygon_that_is_too_narrow_is_named_with_the_distance() {
    let settings = ["trajectory.kind=hover", "fence.polygon-m=[[-2, -2], [2, -2], [0, 2]]"];
    let told = check(&settings, Some(Vector3::zeros())).unwrap_err();
    // The sides are 2 / sqrt(5) m from the origin, the margins are 1.1 m.
    let remedy = "it needs sides up to 0.21 m further outside";
    assert!(told.starts_with("`fence.polygon-m`") && told.contains(remedy), "{told}");
    let low = [
        "trajectory.kind=hover",
        "fence.polygon-m=[[-9, -9], [9, -9], [0, 9]]",
        "fence.z-m=[-0.5, 1.9]",
    ];
    let told = check(&low, Some(Vector3::zeros())).unwrap_err();
    assert!(told.starts_with("`fence.z-m`"), "{told}");
}

#[test]
fn from_a_known_start_a_point_outside_is_reported() {
    let settings = ["fence.x-m=[-0.5, 9.0]", "fence.soft-margin-m=0.2"];
    assert_eq!(check(&settings, Some(Vector3::x() * 3.0)), Ok(()));
    let near = ["fence.x-m=[-0.8, 9.0]", "fence.soft-margin-m=1.0", "trajectory.kind=\"hover\""];
    let told = check(&near, Some(Vector3::zeros())).unwrap_err();
    assert!(told.starts_with("`fence.x-m`") && told.contains("from -1.11 to 9.00"), "{told}");
    let top = ["trajectory.height-m=3.2", "fence.z-m=[-0.5, 4.0]", "trajectory.kind=\"hover\""];
    let told = check(&top, Some(Vector3::zeros())).unwrap_err();
    assert!(told.contains("from -0.50 to 4.31 m in z"), "{told}");
    let told = check(&settings, Some(Vector3::x() * 8.0)).unwrap_err();
    assert!(
        told.starts_with("`fence.x-m`")
            && told.contains("it needs a fence from -0.50 to ")
            && told.contains("at ["),
        "{told}"
    );
}

#[test]
fn in_flight_the_points_from_which_a_trajectory_fits_are_told() {
    let small = ["fence.x-m=[-2.0, 2.0]", "fence.y-m=[-2.0, 2.0]", "fence.soft-margin-m=1.0"];
    let circle = ["trajectory.kind=\"circle\"", "trajectory.circle.radius-m=0.65"];
    let (config, trajectory) = flight(&[&small[..], &circle].concat(), None);
    let told = fitting_starts(&config, &trajectory);
    assert!(told.contains("it fits from x = 0.41 to 0.89, y = -0.24 to 0.24, z = "), "{told}");
    let room = StoppingRoom::new(&config);
    let fits = |x: f64| {
        let (rate, acceleration) = (Vector4::zeros(), Vector4::zeros());
        let rest = ReferenceMotion { value: Vector4::new(x, 0.24, 1.0, 0.0), rate, acceleration };
        let detour = Detour::fly(trajectory.clone(), &rest, &Vector4::zeros(), room.legs());
        room.require(&detour, 1.0)
    };
    assert_eq!([fits(0.41), fits(0.89)], [Ok(()); 2]);
    assert_eq!(fits(0.0), Err(Cause::Fence));
    let corners = "fence.polygon-m=[[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]]";
    let (config, trajectory) = flight(&[&[corners][..], &circle].concat(), None);
    let told = fitting_starts(&config, &trajectory);
    assert!(told.contains("it goes from x = -1.30 to 0.00, y = -0.65 to 0.65, z = "), "{told}");
}

#[test]
fn a_point_is_flown_to_with_room_for_tracking_inside_the_soft_border() {
    let config = Config::default();
    let border_m = config.fence.x_m[1] - config.fence.soft_margin_m;
    let is_flown = |x: f64| require_target(&config, &Vector4::new(x, 0.0, 1.0, 0.0)).is_ok();
    assert_eq!([border_m - 0.11, border_m - 0.09].map(is_flown), [true, false]);
}
