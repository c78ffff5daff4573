use super::*;
use crate::trajectory;
use oqtal_config::Setting;
use oqtal_control::trajectory::Waypoints;

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
    assert!(told.contains("wider than 10.20 m") && told.contains("x = "), "{told}");
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

#[test]
fn waypoints_near_the_floor_are_refused() {
    let settings = ["trajectory.kind=waypoints", "trajectory.waypoints-file=way.csv"];
    let settings = settings.map(|text| Setting::parse("test", text).unwrap());
    let config = Config::from_settings(&settings).unwrap();
    let check = |height: f64| {
        let text = format!("t,x,y,z\n0,0,0,1\n60,0,0,{height}\n61,0,0,1\n");
        let waypoints = Waypoints::parse(&text).unwrap();
        check_height(&config, &config.trajectory.trajectory(Some(waypoints)).unwrap())
    };
    assert_eq!(check(0.11), Ok(()));
    let told = check(0.09).unwrap_err().to_string();
    assert!(told.contains("at 60.0 s the trajectory is at [0.000, 0.000, 0.090] m"), "{told}");
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
