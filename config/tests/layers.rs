//! The layers of a configuration: their order, and the setting named by an error.

use oqtal_config::{Config, ConfigError, Interface, Setting};

fn set(settings: &[&str]) -> Result<Config, ConfigError> {
    let parsed: Result<Vec<Setting>, ConfigError> = settings
        .iter()
        .enumerate()
        .map(|(index, text)| Setting::parse(&format!("flag {index}"), text))
        .collect();
    Config::from_settings(&parsed?)
}

fn error(settings: &[&str]) -> String {
    set(settings).unwrap_err().to_string()
}

#[test]
fn the_plant_is_the_model_of_the_controller_unless_configured() {
    let config = set(&["vehicle.mass-kg=0.6"]).unwrap();
    assert_eq!((config.vehicle.mass_kg, config.plant.mass_kg), (0.6, 0.6));
    let config = set(&["plant.mass-kg=0.55", "vehicle.mass-kg=0.6"]).unwrap();
    assert_eq!((config.vehicle.mass_kg, config.plant.mass_kg), (0.6, 0.55));
    let config = set(&["plant.mass-kg=0.55", "plant.mass-kg=vehicle"]).unwrap();
    assert_eq!(config.plant.mass_kg, config.vehicle.mass_kg);
    let config = set(&["vehicle.preset=spacecraft"]).unwrap();
    assert_eq!((config.plant.interface, config.plant.mass_kg), (Interface::Torque, 0.432));
}

#[test]
fn a_table_that_follows_may_differ_in_one_key() {
    let settings =
        ["plant.wire.asctec.command-signs.roll=1", "bridge.asctec.angle-per-count-mdeg=30.0"];
    let Config { plant, bridge, .. } = set(&settings).unwrap();
    let ours = plant.wire.asctec;
    assert_eq!((ours.command_signs.roll, bridge.asctec.command_signs.roll), (1, -1));
    assert_eq!((ours.command_signs.pitch, ours.angle_per_count_mdeg), (1, 30.0));
}

#[test]
fn the_effective_configuration_shows_the_plant_in_numbers_and_is_read_back_as_it_is() {
    let config = set(&["vehicle.mass-kg=0.6", "plant.spread=0.1"]).unwrap();
    let text = config.to_toml();
    let plant = text.split_once("[plant]").unwrap().1;
    assert!(plant.lines().any(|line| line == "mass-kg = 0.6"), "{plant}");
    let table: toml::Table = text.parse().unwrap();
    assert_eq!(table["plant"]["frame-rate-hz"].as_float(), Some(60.0));
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("effective.toml");
    std::fs::write(&file, &text).unwrap();
    assert_eq!(Config::load(std::slice::from_ref(&file), &[]).unwrap(), config);
}

#[test]
fn a_matrix_is_printed_on_one_line() {
    let text = Config::default().to_toml();
    let lines: Vec<&str> = text.lines().filter(|line| line.starts_with("inertia-kg-m2")).collect();
    assert_eq!(lines.len(), 2, "{text}");
    assert!(lines.iter().all(|line| line.starts_with("inertia-kg-m2 = [[0.00365, 0.0, 0.0], [")));
}

#[test]
fn an_error_names_the_setting_that_made_the_value_impossible() {
    let too_light = error(&["vehicle.gravity-m-s2=3.0"]);
    assert!(
        too_light.contains("`position.vertical-acceleration-limit")
            && too_light.starts_with("flag 0: "),
        "{too_light}"
    );
    let too_heavy = error(&["vehicle.max-thrust-n=6.0", "vehicle.mass-kg=0.8"]);
    assert!(
        too_heavy.contains("`vehicle.max-thrust-n` is 6") && too_heavy.starts_with("flag 1: "),
        "{too_heavy}"
    );
    let too_fast = error(&["mocap.rate-hz=60", "control.rate-hz=200"]);
    assert!(
        too_fast.contains("`safety.pose-rate-hz` is 60") && too_fast.starts_with("flag 1: "),
        "{too_fast}"
    );
    assert!(too_fast.contains("lower that to 60, one tick per pose"), "{too_fast}");
    assert!(too_fast.ends_with("; `safety.pose-rate-hz` is of flag 0"), "{too_fast}");
    let awake =
        error(&["safety.pose-rate-hz=240", "realtime.warmup-us=2000", "realtime.awake-us=100"]);
    assert!(awake.contains("`realtime.awake-us` is 100, it must be at most 83"), "{awake}");
    let too_slow = error(&["control.rate-hz=50", "mocap.rate-hz=30"]);
    assert!(too_slow.starts_with("flag 1: ") && too_slow.contains("it follows `mocap.rate-hz`"));
    let too_long = error(&["bridge.motor-sequence-ms=4000"]);
    assert!(
        too_long.contains("`safety.motor-start-ms`") && too_long.starts_with("flag 0: "),
        "{too_long}"
    );
    let wired = error(&["plant.wire.link=asctec:/tmp/x", "clock.kind=lockstep"]);
    assert!(wired.contains("`plant.wire.link`") && wired.starts_with("flag 1: "), "{wired}");
    let firmware = error(&["plant.truth=mavlink:udpin:127.0.0.1:1", "clock.kind=in-process"]);
    assert!(firmware.contains("`plant.truth`") && firmware.starts_with("flag 1: "), "{firmware}");
    let unstable = error(&["plant.rate-lag-ms=2", "plant.rate-lag-ratio=[1, 0.4, 1]"]);
    assert!(unstable.contains("`plant.rate-lag-ratio` is 0.4"), "{unstable}");
    let late = error(&["mocap.latency-ms=1e300"]);
    assert!(late.contains("`mocap.latency-ms`") && late.contains("60000"), "{late}");
    // A value that another one made possible is not the cause, and of a key that is set twice the value in effect is named.
    let replaced = error(&["vehicle.mass-kg=5", "vehicle.max-thrust-n=90", "vehicle.mass-kg=10"]);
    assert!(replaced.starts_with("flag 2: with `vehicle.mass-kg` = 10"), "{replaced}");
    let twice = error(&["vehicle.mass-kg=-1", "vehicle.mass-kg=-2"]);
    assert!(twice.starts_with("flag 1: `vehicle.mass-kg` is -2"), "{twice}");
}

#[test]
fn faults_act_on_a_firmware_executed_as_a_program_but_not_on_a_real_vehicle() {
    let real = ["bridge.link=crtp:udp:127.0.0.1:1", "fault.inject=[\"pose:off@1\"]"];
    assert!(error(&real).contains("fault.with-real-vehicle"));
    let truth = "plant.truth=crazyflie-sitl:udp:127.0.0.1:2";
    assert!(set(&[&real[..], &[truth]].concat()).is_ok());
}

#[test]
fn a_value_that_cannot_be_read_is_refused_although_a_later_one_replaces_it() {
    for later in ["vehicle.mass-kg=0.5", "vehicle={mass-kg = 0.5}"] {
        let message = error(&["clock.seed=7", "vehicle.mass-kg=heavy", later]);
        assert!(message.starts_with("flag 1: `vehicle.mass-kg`"), "{message}");
    }
}

#[test]
fn an_error_of_a_derived_value_names_its_source() {
    let message = error(&["vehicle.rate-lag-ms=0.5"]);
    assert!(message.starts_with("flag 0: `vehicle.rate-lag-ms` is 0.5"), "{message}");
    let own = error(&["plant.rate-lag-ms=0.5"]);
    assert!(own.starts_with("flag 0: `plant.rate-lag-ms` is 0.5"), "{own}");
}

#[test]
fn an_unknown_interface_or_preset_is_refused_with_the_known_ones() {
    let interface = error(&["vehicle.interface=thrust"]);
    assert!(interface.contains("`rate`, `torque`, `attitude`"), "{interface}");
    let preset = error(&["vehicle.preset=boat"]);
    assert!(
        preset
            .contains("`boat`, it must be hummingbird or spacecraft or crazyflie-2.1 or ardupilot-quad or px4-quad or betaflight-quad"),
        "{preset}"
    );
}

#[test]
fn where_a_recording_is_played_the_daemon_only_observes() {
    assert!(!Config::default().safety.observe_only);
    let replay = set(&["mocap.replay=flight.csv", "safety.observe-only=false"]).unwrap();
    assert!(replay.safety.observe_only);
    assert!(set(&["safety.observe-only=true"]).unwrap().safety.observe_only);
}

#[test]
fn a_configuration_is_the_same_wherever_it_is_flown_and_at_both_ends_of_a_wire() {
    let hash = |flags: &[&str]| set(flags).unwrap().hash();
    for same in [
        "instance.name=other",
        "clock.kind=lockstep",
        "log.level=debug",
        "mocap.serve.protocols=qtm",
        "bridge.link=asctec:/dev/ttyUSB0",
        "plant.wire.link=asctec:/tmp/vehicle",
        "receiver.link=vrpn:10.0.0.2,body=quad",
    ] {
        assert_eq!(hash(&[same]), hash(&[]), "{same}");
    }
    for other in
        ["clock.seed=2", "vehicle.mass-kg=0.6", "mocap.rate-hz=100", "plant.wire.latency-ms=9"]
    {
        assert_ne!(hash(&[other]), hash(&[]), "{other}");
    }
}

#[test]
fn a_value_of_another_kind_is_refused_with_what_was_found_and_what_is_expected() {
    for (setting, reason) in [
        ("mocap={}", "`mocap`: a section; set its keys one by one, as `mocap."),
        ("vehicle=[1]", "`vehicle`: a section; set its keys one by one, as `vehicle."),
        ("record.flights=3", "found `3`, expected one of `none`, `processes`, `all`"),
        ("record.flights={}", "found a section, expected one of `none`"),
        ("record.flights=[\"all\"]", "found a list, expected one of `none`"),
        ("fence.x-m=[1,2,3]", "found a list of 3, expected a list of 2"),
        ("fence.x-m=[1]", "found a list of 1, expected a list of 2"),
        ("fence.x-m=3", "found `3`, expected a list of 2"),
    ] {
        let error = error(&[setting]);
        assert!(error.contains(reason), "{setting}: {error}");
    }
}
