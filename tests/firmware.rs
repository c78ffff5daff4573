//! Flights of real firmware, which runs as programs at the paths in OQTAL_CRAZYFLIE, OQTAL_ARDUCOPTER and OQTAL_PX4; skipped where a
//! variable is not set. One flight after another: each needs a quiet machine, a network of its own and fixed ports.

mod common;
#[path = "firmware/program.rs"]
mod program;

use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::time::Duration;

use serde_json::Value;

use common::Testbed;
use program::Firmware;

/// Greatest root mean square of the position error in hover \[m\].
const HOVER_M: f64 = 0.03;
/// Greatest mean position error on the square \[m\], whose corners are steps of 1.3 m.
const SQUARE_M: f64 = 0.6;

static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Its sensors and motors are those of the simulated vehicle.
const CRAZYFLIE: Firmware = Firmware {
    variable: "OQTAL_CRAZYFLIE",
    preset: "crazyflie-2.1.toml",
    link: "crtp:udp:127.0.0.1:19850",
    truth: "crazyflie-sitl:udp:127.0.0.1:19950",
    boot: Duration::from_secs(0),
    arguments: |_, command| {
        command.args(["19950", "127.0.0.1"]);
    },
    parameters: "",
};

const ARDUCOPTER: Firmware = Firmware {
    variable: "OQTAL_ARDUCOPTER",
    preset: "ardupilot-quad.toml",
    link: "mavlink:udpin:127.0.0.1:14550,autopilot=ardupilot",
    truth: "mavlink:udpin:127.0.0.1:14551",
    boot: Duration::from_secs(30),
    arguments: |_, command| {
        command.args(["--model", "quad", "--home", "-35.363261,149.165230,584,0", "-w"]);
        command.args(["--serial0", "udpclient:127.0.0.1:14550"]);
        command.args(["--serial1", "udpclient:127.0.0.1:14551", "--defaults", "parameters"]);
    },
    parameters: include_str!("firmware/arducopter.parm"),
};

const PX4: Firmware = Firmware {
    variable: "OQTAL_PX4",
    preset: "px4-quad.toml",
    link: "mavlink:udpin:127.0.0.1:14540,autopilot=px4",
    truth: "mavlink:udpin:127.0.0.1:19410",
    boot: Duration::from_secs(12),
    arguments: |path, command| {
        let etc = path.parent().and_then(Path::parent).unwrap().join("etc");
        command.arg(etc).args(["-d", "-s", "etc/init.d-posix/rcS", "-w", "."]);
        command.env("PX4_SIM_MODEL", "sihsim_quadx");
        for setting in include_str!("firmware/px4.parameters").lines() {
            let (name, value) = setting.split_once(' ').unwrap();
            command.env(format!("PX4_PARAM_{name}"), value);
        }
    },
    parameters: "",
};

/// Flies the firmware, which must land; returns the summary, or `None` without the program.
fn fly(firmware: &Firmware, controller: &str, trajectory: &[&str]) -> Option<Value> {
    let path = firmware.path()?;
    let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let testbed = Testbed::new("firmware");
    let process = firmware.start(&path, &testbed.path("firmware"));
    let preset = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/presets").join(firmware.preset);
    let mut words = vec!["fly", "--json", "--controller", controller];
    words.extend(["--config", preset.to_str().unwrap(), "--truth", firmware.truth]);
    let vehicle = format!("link:{}", firmware.link);
    words.extend(["--vehicle", &vehicle]);
    words.extend(trajectory);
    let command: Command = testbed.oqtal(&words);
    let output = process.beside(&command).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{} with {controller}: {said}", firmware.variable);
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["outcome"], "landed", "{said}");
    assert_eq!(summary["error_source"], "truth");
    Some(summary)
}

/// Hover and square with each of the laws that a user would choose.
fn flies_hover_and_square(firmware: &Firmware) {
    for controller in ["pid", "oqtal", "oqtal-dt"] {
        let Some(hover) = fly(firmware, controller, &["--trajectory", "hover", "--duration", "10"])
        else {
            return;
        };
        let rms = hover["position_error_m"]["rms"].as_f64().unwrap();
        assert!(rms <= HOVER_M, "{} hovers with {controller} within {rms} m", firmware.variable);
        let square = fly(firmware, controller, &["--trajectory", "square"]).unwrap();
        let mean = square["position_error_m"]["mean"].as_f64().unwrap();
        assert!(
            mean <= SQUARE_M,
            "{} flies a square with {controller} within {mean} m",
            firmware.variable
        );
    }
}

#[test]
fn the_firmware_of_the_crazyflie_flies_hover_and_square() {
    flies_hover_and_square(&CRAZYFLIE);
}

#[test]
fn arducopter_flies_hover_and_square() {
    flies_hover_and_square(&ARDUCOPTER);
}

#[test]
fn px4_flies_hover_and_square() {
    flies_hover_and_square(&PX4);
}
