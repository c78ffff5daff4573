//! The firmware under test, and the start of each program.

use std::path::Path;
use std::time::Duration;

use super::program::Firmware;
use super::relay::RelayPorts;

/// Uses the sensors and motors of the simulated vehicle. Without real-time priority its tasks for radio and reports starve, on several
/// processors it may hang in its start.
pub const CRAZYFLIE: Firmware = Firmware {
    name: "Crazyflie",
    variable: "OQTAL_CRAZYFLIE",
    preset: "crazyflie-2.1",
    link: "crtp:udp:127.0.0.1:19850",
    relayed_link: "crtp:udp:127.0.0.1:19851",
    ports: RelayPorts {
        near: "127.0.0.1:19851",
        near_peer: None,
        far: "127.0.0.1:0",
        far_peer: Some("127.0.0.1:19850"),
    },
    truth: "crazyflie-sitl:udp:127.0.0.1:19950",
    boot: Duration::from_secs(0),
    before: &["chrt", "-f", "10", "taskset", "-c", "0"],
    is_set_up: false,
    arguments: |_, command| {
        command.args(["19950", "127.0.0.1"]);
    },
    parameters: "",
    battery: &[],
};

pub const ARDUCOPTER: Firmware = Firmware {
    name: "ArduCopter",
    variable: "OQTAL_ARDUCOPTER",
    preset: "ardupilot-quad",
    link: "mavlink:udpin:127.0.0.1:14550,autopilot=ardupilot",
    relayed_link: "mavlink:udpin:127.0.0.1:14650,autopilot=ardupilot",
    ports: RelayPorts {
        near: "127.0.0.1:0",
        near_peer: Some("127.0.0.1:14650"),
        far: "127.0.0.1:14550",
        far_peer: None,
    },
    truth: "mavlink:udpin:127.0.0.1:14551",
    boot: Duration::from_secs(30),
    before: &[],
    is_set_up: false,
    arguments: |_, command| {
        command.args(["--model", "quad", "--home", "-35.363261,149.165230,584,0", "-w"]);
        command.args(["--serial0", "udpclient:127.0.0.1:14550"]);
        command.args(["--serial1", "udpclient:127.0.0.1:14551", "--defaults", "parameters"]);
    },
    parameters: include_str!("arducopter.parm"),
    battery: &["safety.battery-low-v = 11.6", "safety.battery-empty-v = 11.5"],
};

pub const PX4: Firmware = Firmware {
    name: "PX4",
    variable: "OQTAL_PX4",
    preset: "px4-quad",
    link: "mavlink:udpin:127.0.0.1:14540,autopilot=px4",
    relayed_link: "mavlink:udpin:127.0.0.1:14640,autopilot=px4",
    ports: RelayPorts {
        near: "127.0.0.1:0",
        near_peer: Some("127.0.0.1:14640"),
        far: "127.0.0.1:14540",
        far_peer: None,
    },
    truth: "mavlink:udpin:127.0.0.1:19410",
    boot: Duration::from_secs(12),
    before: &[],
    is_set_up: false,
    arguments: |path, command| {
        let etc = path.parent().and_then(Path::parent).unwrap().join("etc");
        command.arg(etc).args(["-d", "-s", "etc/init.d-posix/rcS", "-w", "."]);
        command.env("PX4_SIM_MODEL", "sihsim_quadx");
        for setting in include_str!("px4.parameters").lines() {
            let (name, value) = setting.split_once(' ').unwrap();
            command.env(format!("PX4_PARAM_{name}"), value);
        }
    },
    parameters: "",
    battery: &["safety.battery-low-v = 15.1", "safety.battery-empty-v = 14.9"],
};

/// Uses the sensors and motors of the simulated vehicle. Without real-time priority its task that reads MSP starves.
pub const BETAFLIGHT: Firmware = Firmware {
    name: "Betaflight",
    variable: "OQTAL_BETAFLIGHT",
    preset: "betaflight-quad",
    link: "msp:tcp:127.0.0.1:5761",
    relayed_link: "msp:tcp:127.0.0.1:5861",
    ports: RelayPorts {
        near: "tcp:127.0.0.1:5861",
        near_peer: None,
        far: "127.0.0.1:0",
        far_peer: Some("127.0.0.1:5761"),
    },
    truth: "betaflight-sitl:udp:127.0.0.1:9002",
    boot: Duration::from_secs(5),
    before: &["chrt", "-f", "10"],
    is_set_up: true,
    arguments: |_, _| {},
    parameters: "",
    battery: &[],
};

pub const ALL: [&Firmware; 4] = [&CRAZYFLIE, &ARDUCOPTER, &PX4, &BETAFLIGHT];
