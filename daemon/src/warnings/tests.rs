use super::*;
use oqtal_config::Setting;
use oqtal_control::controller::ControllerName;
use oqtal_control::trajectory::Waypoints;

fn told(settings: &[&str], waypoints: Option<&str>) -> Vec<String> {
    let settings: Vec<_> =
        settings.iter().map(|text| Setting::parse("test", text).unwrap()).collect();
    let config = Config::from_settings(&settings).unwrap();
    let waypoints = waypoints.map(|text| Waypoints::parse(text).unwrap());
    warnings(&config, &config.trajectory.trajectory(waypoints).unwrap())
}

#[test]
fn a_step_from_which_the_vehicle_is_landed_and_a_law_without_its_feed_forward_are_told() {
    let square = |side: &str| told(&["trajectory.kind=square", side], None).join("\n");
    assert_eq!(square("trajectory.square.side-m=3"), "");
    let text = square("trajectory.square.side-m=4");
    assert!(text.contains("is up to 4.00 m from it") && text.contains("lands it"), "{text}");
    let pid = ["control.controller=pid", "control.stack=predictive"];
    let text = told(&pid, None).join("\n");
    assert!(text.contains("control.pid.feed-forward"), "{text}");
    assert_eq!(told(&[&pid[..], &["control.pid.feed-forward=true"]].concat(), None).len(), 0);
}

#[test]
fn shipped_trajectories_need_no_warning() {
    for kind in ["hover", "step", "square", "circle", "lemniscate", "attitude-chirp"] {
        let told = told(&[&format!("trajectory.kind={kind}")], None);
        assert!(told.is_empty(), "{kind}: {told:?}");
    }
}

#[test]
fn a_speed_beyond_the_limit_is_reported_with_its_instant_and_a_remedy() {
    let kind = "trajectory.kind=waypoints";
    let told_of = |text| told(&[kind], Some(text)).join("\n");
    assert!(told_of("t,x,y,z\n0,0,0,1\n20,6,0,1\n").is_empty());
    let text = told_of("t,x,y,z\n0,0,0,1\n1,6,0,1\n");
    for part in ["at 0.50 s", "9.00 m/s", "position.horizontal-velocity-limit-m-s is 0.8"] {
        assert!(text.contains(part), "{text}");
    }
    assert!(text.contains("11.3 times slower"), "{text}");
    // With a higher limit it is left further.
    assert!(text.contains("tilt-limit-deg") && !text.contains("raise"), "{text}");
    let text = told_of("t,x,y,z\n0,0,0,1\n10,12,0,1\n");
    assert!(text.ends_with("or fly oqtal-dt, which follows it") && !text.contains('\n'), "{text}");
    let text = told(&["trajectory.take-off-s=1"], None).join("\n");
    assert!(text.starts_with("the take-off") && text.contains("take-off-s"), "{text}");
}

#[test]
fn f70_a_path_on_which_the_envelope_leaves_the_law_no_room_is_told() {
    let height = |height: &str, law| told(&["trajectory.kind=hover", height, law], None).join("\n");
    let (low, high) = ("trajectory.height-m=0.2", "trajectory.height-m=0.5");
    for guarded in ["control.controller=external", "control.fallback=geometric"] {
        let text = height(low, guarded);
        assert!(text.contains("at 0.20 m above the floor the fallback law flies"), "{text}");
        assert_eq!(height(high, guarded), "", "{guarded}");
        let upright = |height: &str| {
            let plane = "trajectory.lemniscate.plane=upright";
            told(&["trajectory.kind=lemniscate", plane, height, guarded], None).join("\n")
        };
        // Its lowest point is 0.325 m below its middle.
        let text = upright("trajectory.height-m=0.73");
        assert!(text.contains("0.3 above the floor; lower that margin, fly higher"), "{text}");
        assert_eq!(upright("trajectory.height-m=0.85"), "", "{guarded}");
        // To 2 m beside the start, at 1 m/s.
        let circle = ["trajectory.kind=circle", "trajectory.circle.radius-m=1", guarded];
        let fast = ["trajectory.circle.period-s=6.283", "position.horizontal-velocity-limit-m-s=2"];
        let near = |x: &str| told(&[&circle[..], &fast, &[x]].concat(), None).join("\n");
        let text = near("fence.x-m=[-2.5, 0.7]");
        assert!(text.contains("m/s, the fallback law flies instead of"), "{text}");
        assert!(!near("fence.x-m=[-5, 5]").contains("fallback law"), "{guarded}");
    }
    assert_eq!(height(low, "control.controller=geometric"), "");
}

#[test]
fn a_warning_names_a_law_that_the_vehicle_replaces() {
    let attitude = "vehicle.interface=attitude";
    let text = told(&[attitude, "control.controller=lqr"], None).join("\n");
    assert!(text.contains("lqr flies like every law but oqtal-dt"), "{text}");
    assert!(told(&[attitude, "control.controller=oqtal-dt"], None).is_empty());
    assert!(told(&["control.controller=lqr"], None).is_empty());
}

#[test]
fn a_warning_of_old_poses_names_every_limit_below_their_age() {
    let [both, one] =
        [90, 70].map(|ms| told(&[&format!("mocap.latency-ms={ms}")], None).swap_remove(0));
    let keys = "raise safety.max-pose-age-ms and safety.pose-age-limit-ms";
    assert!(both.ends_with(keys), "{both}");
    assert!(one.ends_with("raise safety.pose-age-limit-ms"), "{one}");
}

#[test]
fn a_change_of_a_law_that_does_not_fly_is_reported() {
    let config = |gain: &str| {
        let settings = ["control.controller=oqtal-dt", gain];
        Config::from_settings(&settings.map(|text| Setting::parse("test", text).unwrap())).unwrap()
    };
    let of = |gain| {
        without_effect(&Config::from_settings(&[]).unwrap(), &config(gain)).collect::<Vec<_>>()
    };
    let text = of("control.lqr.attitude-weight=10").join("\n");
    assert_eq!(
        text,
        "control.lqr.attitude-weight: no effect, since control.controller is oqtal-dt"
    );
    assert!(of("control.oqtal-dt.attitude-weight=900").is_empty());
}

#[test]
fn a_change_of_a_law_whose_place_the_vehicle_takes_is_reported() {
    let told = |law: &str, extent: &str| {
        let gain = format!("control.{law}.attitude-weight");
        let config = |gains: &[String]| {
            let own =
                ["vehicle.interface=attitude".to_owned(), format!("control.controller={law}")];
            let settings = own.iter().chain(gains);
            let settings = settings.map(|text| Setting::parse("test", text).unwrap());
            Config::from_settings(&settings.collect::<Vec<_>>()).unwrap()
        };
        let next = config(&[format!("{gain}=900")]);
        let told: Vec<_> = without_effect(&config(&[]), &next).collect();
        let note =
            format!("{gain}: no effect{extent}, since the vehicle holds its attitude by itself");
        assert_eq!(told, [note]);
    };
    told("oqtal-dt", "");
    told("oqtal", " on roll and pitch");
}

#[test]
fn values_in_another_unit_are_reported() {
    let text = told(&["vehicle.max-thrust-n=22000", "vehicle.rate-lag-ms=50000"], None).join("\n");
    assert!(text.contains("4485 times the weight of 4.91 N"), "{text}");
    assert!(text.contains("vehicle.rate-lag-ms is 50000, unusual in ms"), "{text}");
    assert!(!text.contains("plant."), "the plant follows the vehicle: {text}");
    let text = told(&["plant.max-thrust-n=22000"], None).join("\n");
    assert!(text.starts_with("plant.max-thrust-n is 22000, 4485 times"), "{text}");
}

#[test]
fn seconds_degrees_and_a_wrong_power_of_ten_of_the_inertia_are_reported() {
    for (setting, note) in [
        ("vehicle.command-delay-ms=0.035", "vehicle.command-delay-ms is 0.035, unusual in ms"),
        ("plant.thrust-lag-ms=0.05", "plant.thrust-lag-ms is 0.05, unusual in ms"),
        ("mocap.latency-ms=0.03", "mocap.latency-ms is 0.03, unusual in ms"),
        ("mocap.position-noise-mm=0.0008", "mocap.position-noise-mm is 0.0008, unusual in mm"),
        ("mocap.attitude-noise-deg=0.0035", "mocap.attitude-noise-deg is 0.0035, unusual in deg"),
        ("safety.battery-low-v=10200", "safety.battery-low-v is 10200, unusual in V"),
        ("safety.battery-low-v=9", "below safety.battery-empty-v, 9.6"),
        ("vehicle.rate-authority-rad-s=[115, 115, 115]", "has 115, unusual in rad/s: 6589 deg/s"),
        ("vehicle.inertia-kg-m2=[[3.65,0,0],[0,3.68,0],[0,0,7.03]]", "has 3.65, unusual in kg m^2"),
        ("vehicle.inertia-kg-m2=[[3e-6,0,0],[0,3e-6,0],[0,0,5e-6]]", "gyration of 0.0024 m"),
    ] {
        let text = told(&[setting], None);
        // Such a vehicle may oscillate.
        let others = text[1..].iter().all(|other| other.contains(" oscillates with "));
        assert!(text[0].contains(note) && others, "{setting}: {text:?}");
    }
    for preset in ["crazyflie-2.1", "ardupilot-quad", "px4-quad", "betaflight-quad", "spacecraft"] {
        let preset = format!("vehicle.preset={preset}");
        let text = told(&[&preset, "mocap.preset=ideal", "trajectory.kind=hover"], None);
        assert!(text.iter().all(|note| !note.contains("unusual")), "{text:?}");
    }
}

#[test]
fn a_far_first_waypoint_is_reported() {
    let kind = "trajectory.kind=waypoints";
    let text = told(&[kind], Some("t,x,y,z\n0,3,0,1\n9,3,0,1\n")).join("\n");
    assert!(text.contains("[3.00, 0.00, 1.00] m is 3.00 m from the hover point"), "{text}");
}

#[test]
fn the_smooth_curve_is_a_remedy_only_if_it_can_be_flown() {
    let of = |curve: &str, seconds: f64| {
        let [a, b, c] = [1.0, 2.0, 3.0].map(|times| times * seconds);
        let table = format!("t,x,y,z\n0,0,0,1\n{a},0.8,0,1\n{b},0.8,0.8,1\n{c},0,0,1\n");
        let curve = format!("trajectory.waypoints-curve={curve}");
        let law = ["trajectory.kind=waypoints", "control.controller=oqtal-dt", &curve];
        told(&law, Some(&table)).join("\n")
    };
    let text = of("monotone", 1.0);
    assert!(text.contains("jumps by 6.72 m/s^2"), "{text}");
    assert!(text.contains("path after that; fly it 2.2 times slower"), "{text}");
    assert!(of("monotone", 1.2).contains("set trajectory.waypoints-curve to \"minimum-snap\", or"));
    assert_eq!(of("monotone", 2.2), "");
    assert_eq!(of("minimum-snap", 1.2), "");
}

#[test]
fn a_turn_to_the_first_heading_in_too_little_time_is_reported() {
    let of = |settle: &str| {
        let table = "t,x,y,z,yaw_deg\n0,0,0,1,90\n9,0,0,1,90\n";
        told(&["trajectory.kind=waypoints", settle], Some(table)).join("\n")
    };
    let text = of("trajectory.settle-s=0.5");
    assert!(text.contains("90 deg") && text.ends_with("trajectory.settle-s to 1.9"), "{text}");
    assert_eq!(of("trajectory.settle-s=1.9"), "");
}

#[test]
fn a_prescribed_attitude_that_turns_too_fast_is_reported_with_the_rate_and_remedies() {
    let of = |kind: &str, setting: &str| {
        told(&[&format!("trajectory.kind={kind}"), setting], None).join("\n")
    };
    let text = of("attitude-chirp", "trajectory.attitude-chirp.to-hz=12");
    // A sine of 4 deg at 12 Hz turns at 5.25 rad/s; a lag of 50 ms raises the command by sqrt(1 + (2 pi 12 0.05)^2).
    for part in ["20.26 rad/s", "is 2:", "to-hz in trajectory.attitude-chirp to 3.21"] {
        assert!(text.contains(part), "{text}");
    }
    assert_eq!(of("attitude-chirp", "trajectory.attitude-chirp.to-hz=3.21"), "");
    for amplitude_deg in [7, 8, 10] {
        let told = |to_hz: &str| {
            let own = ["vehicle.rate-authority-rad-s=[4,4,2]", "vehicle.rate-lag-ms=70"];
            let amplitude = format!("trajectory.attitude-chirp.amplitude-deg={amplitude_deg}");
            let to = format!("trajectory.attitude-chirp.to-hz={to_hz}");
            let chirp = ["trajectory.kind=attitude-chirp", &amplitude, &to];
            self::told(&[&own[..], &chirp].concat(), None).join("\n")
        };
        let text = told("4");
        let remedy = text.rsplit(' ').next().unwrap();
        assert_eq!(told(remedy), "", "{text}");
    }
    let text = of("excitation", "trajectory.excitation.tilt-deg=30");
    assert!(text.contains("trajectory.excitation.tilt-deg to 13.3"), "{text}");
    for (kind, setting) in [
        ("excitation", "trajectory.excitation.tilt-deg=13.3"),
        ("attitude-doublet", "trajectory.attitude-doublet.angle-deg=30"),
    ] {
        assert_eq!(of(kind, setting), "", "steps have no rate");
    }
}

#[test]
fn a_rate_that_the_cameras_cannot_deliver_and_a_cover_without_effect_are_reported() {
    let text = told(&["control.rate-hz=80"], None).join("\n");
    assert!(text.contains("60.0000 Hz") || text.contains("60 Hz"), "{text}");
    assert!(told(&["mocap.cameras.covered=[2]"], None)[0].contains("mocap.model=markers"));
}

#[test]
fn poses_expected_at_another_rate_than_that_of_the_emulated_cameras_are_reported() {
    let rates = ["control.rate-hz=100", "safety.pose-rate-hz=100"];
    let text = told(&rates, None).join("\n");
    assert!(text.starts_with("mocap.rate-hz is 60 and safety.pose-rate-hz 100"), "{text}");
    let real = "receiver.link=\"vrpn:127.0.0.1,Tracker0\"";
    for remedy in [text.rsplit("set ").next().unwrap(), real] {
        let told = told(&[&rates[..], &[&remedy.replace(' ', "")]].concat(), None);
        assert!(told.is_empty(), "{remedy}: {told:?}");
    }
}

#[test]
fn rotors_without_effect_or_the_greatest_thrust_are_reported() {
    assert!(told(&["plant.fidelity=rotors"], None).is_empty());
    let other = ["plant.fidelity=rotors", "vehicle.mass-kg=1.35", "vehicle.max-thrust-n=31"];
    let told = told(&other, None);
    assert!(
        told.iter().any(|text| {
            text.contains("saturate below full thrust") && text.contains("max-speed-rad-s = 1180")
        }),
        "{told:?}"
    );
    let torque = ["vehicle.preset=spacecraft", "trajectory.kind=hover"];
    let of = |fidelity| self::told(&[&torque[..], &[fidelity]].concat(), None).join("\n");
    assert!(!of("plant.fidelity=eq61").contains("fidelity"));
    let text = of("plant.fidelity=rotors");
    assert!(text.contains("plant.fidelity=rotors has no effect"), "{text}");
    assert!(!text.contains("max-speed-rad-s"), "{text}");
}

#[test]
fn a_disturbance_or_fault_after_the_end_of_the_flight_is_reported_with_both_times() {
    let of = |key: &str, at: &str| {
        let hover = ["trajectory.kind=hover", "trajectory.duration-s=5"];
        told(&[&hover[..], &[&format!("{key}=[\"{at}\"]")]].concat(), None).join("\n")
    };
    for (key, at) in [("plant.disturb", "mass@60=0.05kg"), ("fault.inject", "pose:off@60+1")] {
        let text = of(key, at);
        for part in [at, "begins 60 s after arming", "planned to end after "] {
            assert!(text.contains(part), "{key}: {text}");
        }
        assert!(of(key, &at.replace("60", "6")).is_empty());
    }
    // The vehicle is on the floor 1.3 s before the end of the reference.
    let hover = |at: &str| told(&["trajectory.kind=hover", at], None).len();
    let told = ["40", "41"].map(|at| hover(&format!("plant.disturb=[\"mass@{at}=0.05kg\"]")));
    assert_eq!(told, [0, 1]);
}

#[test]
fn a_payload_that_the_vehicle_cannot_lift_is_reported_with_its_unit() {
    assert!(
        told(&["plant.disturb=[\"mass@9=0.1kg\"]", "control.controller=oqtal-dt"], None).is_empty()
    );
    let text = told(&["plant.disturb=[\"mass@9=100\"]"], None).join("\n");
    assert!(text.contains("adds 100 kg") && text.contains("masses are in kg"), "{text}");
}

#[test]
fn a_payload_beyond_the_integral_of_the_velocity_loops_is_reported() {
    let payload = |mass: &str| format!("plant.disturb=[\"mass@9={mass}kg\"]");
    let of = |mass: &str, law: &str| told(&[&payload(mass), law], None).join("\n");
    assert!(of("0.05", "control.controller=geometric").is_empty());
    let text = of("0.08", "control.controller=geometric");
    assert!(text.contains("takes 1.57 m/s^2 more") && text.contains("limit to 1.8"), "{text}");
    assert!(of("0.08", "control.controller=oqtal-dt").is_empty());
}

#[test]
fn a_gust_on_a_vehicle_without_drag_is_reported() {
    let gust = "plant.disturb=[\"gust@9+2=3,0,0m/s\"]";
    assert!(told(&[gust], None).is_empty());
    let text = told(&[gust, "plant.drag-per-s=0"], None).join("\n");
    assert!(text.contains("has no effect"), "{text}");
}

#[test]
fn a_law_that_oscillates_with_its_vehicle_is_told_before_the_flight_and_no_other() {
    let told = |settings: &[&str]| {
        let settings: Vec<_> =
            settings.iter().map(|text| Setting::parse("test", text).unwrap()).collect();
        hover::oscillates(&Config::from_settings(&settings).unwrap())
    };
    for law in ControllerName::NAMES {
        for preset in ["hummingbird", "crazyflie-2.1", "px4-quad"] {
            let settings =
                [format!("vehicle.preset={preset}"), format!("control.controller={law}")];
            let told = told(&settings.each_ref().map(String::as_str));
            // In a simulated hover it is half a metre away.
            let oscillates = law == "indi" && preset == "crazyflie-2.1";
            assert_eq!(told.is_some(), oscillates, "{law}, {preset}: {told:?}");
        }
    }
    let slow = [
        "vehicle.mass-kg=1.6",
        "vehicle.max-thrust-n=42.0",
        "vehicle.rate-lag-ms=60.0",
        "vehicle.inertia-kg-m2=[[0.018, 0, 0], [0, 0.018, 0], [0, 0, 0.03]]",
        "vehicle.interface=torque",
        "mocap.latency-ms=35.0",
    ];
    let oscillating = told(&slow).unwrap();
    assert!(oscillating.starts_with("oqtal oscillates with this vehicle"), "{oscillating}");
    assert_eq!(told(&[&slow[..], &["control.controller=oqtal-dt"]].concat()), None);
    // From limit to limit of the sticks, a few centimetres from the place.
    let late = [
        "vehicle.mass-kg=1.15",
        "vehicle.max-thrust-n=28.0",
        "vehicle.rate-authority-rad-s=[3.5, 3.5, 2.0]",
        "vehicle.rate-lag-ms=50.0",
        "vehicle.command-delay-ms=45.0",
    ];
    for (law, oscillates) in [("oqtal", true), ("pid", false), ("oqtal-dt", false)] {
        let law = format!("control.controller={law}");
        assert_eq!(told(&[&late[..], &[&law]].concat()).is_some(), oscillates, "{law}");
    }
}
