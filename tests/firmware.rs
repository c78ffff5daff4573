//! Flights of real firmware, executed as the programs named by OQTAL_CRAZYFLIE, OQTAL_ARDUCOPTER, OQTAL_PX4 and
//! OQTAL_BETAFLIGHT; skipped for variables that are not set. The flights are sequential: each needs an otherwise idle machine, a separate network and fixed
//! ports.

mod faults;
mod flight;
mod program;
mod relay;
mod vehicles;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard};
use std::time::Duration;

use oqtal_bus::code::{OperatorCommand, SafetyState};
use oqtal_bus::time::Span;
use serde_json::Value;

use crate::common::random::length;
use crate::common::{Testbed, number};
use faults::{BATTERY, FAULTS, Fault, HEAD, TAKEN_OVER, observe, refuses_to_arm};
use flight::FirmwareFlight;
use program::Firmware;
use vehicles::{ALL, ARDUCOPTER, BETAFLIGHT, CRAZYFLIE, PX4};

/// Greatest root mean square of the position error in hover \[m\].
const HOVER_M: f64 = 0.03;
/// Greatest mean position error on the square \[m\], whose corners are steps of 1.3 m.
const SQUARE_M: f64 = 0.6;
/// Greatest mean attitude error \[deg\]; a vehicle that oscillates exceeds it.
const ATTITUDE_DEG: f64 = 5.0;
/// Age of a command, since its publication, above which the bridge does not send it.
const OLD: Span = Span::from_millis(51);

static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Flies the firmware at `path`; the flight must land. Returns the summary.
fn fly(firmware: &Firmware, path: &Path, controller: &str, trajectory: &[&str]) -> Value {
    let testbed = Testbed::new("firmware");
    let process = firmware.start(path, &testbed.path("firmware"));
    let mut words = vec!["fly", "--json", "--controller", controller, "--truth", firmware.truth];
    let (vehicle, preset) =
        (format!("link:{}", firmware.link), format!("vehicle.preset={}", firmware.preset));
    words.extend(["--set", &preset, "--vehicle", &vehicle]);
    words.extend(trajectory);
    let command: Command = testbed.oqtal(&words);
    let output = process.beside(&command).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{} with {controller}: {said}", firmware.name);
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["outcome"], "landed", "{said}");
    assert_eq!(summary["error_source"], "truth");
    let number = |path: &str| number(&summary, path);
    eprintln!(
        "| {}, `{controller}` | {trajectory:?} | position RMS {:.1} mm, mean {:.3} m | velocity {:.3} m/s | attitude {:.2} deg | {:.1}, {:.1} ms |",
        firmware.name,
        number("/position_error_m/rms") * 1e3,
        number("/position_error_m/mean"),
        number("/velocity_error_m_s/mean"),
        number("/attitude_error_deg/mean"),
        number("/hops/sensor_to_actuator/p50_ns") * 1e-6,
        number("/hops/sensor_to_actuator/p99_ns") * 1e-6,
    );
    summary
}

/// Flies hover and square with each law that a user would choose.
fn flies_hover_and_square(firmware: &Firmware) {
    let Some(path) = firmware.path() else { return };
    let _alone = alone();
    for controller in ["pid", "oqtal", "oqtal-dt"] {
        let hover =
            fly(firmware, &path, controller, &["--trajectory", "hover", "--duration", "10"]);
        let rms = number(&hover, "/position_error_m/rms");
        assert!(rms <= HOVER_M, "{} hovers with {controller} within {rms} m", firmware.name);
        let square = fly(firmware, &path, controller, &["--trajectory", "square"]);
        let mean = number(&square, "/position_error_m/mean");
        assert!(mean <= SQUARE_M, "{}: a square with {controller} within {mean} m", firmware.name);
        for flight in [hover, square] {
            let degrees = number(&flight, "/attitude_error_deg/mean");
            assert!(degrees <= ATTITUDE_DEG, "{} with {controller}: {degrees} deg", firmware.name);
        }
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

#[test]
fn betaflight_flies_hover_and_square() {
    flies_hover_and_square(&BETAFLIGHT);
}

/// Firmware whose programs are installed.
fn present() -> Vec<(&'static Firmware, PathBuf)> {
    ALL.into_iter().filter_map(|firmware| firmware.path().map(|path| (firmware, path))).collect()
}

/// Flies each of `faults` with every firmware for which `takes_part` is true.
fn shows(faults: &[Fault], takes_part: impl Fn(&Firmware) -> bool) {
    let _alone = alone();
    for (firmware, path) in present().iter().filter(|(firmware, _)| takes_part(firmware)) {
        eprintln!("{HEAD}");
        for fault in faults {
            observe(firmware, path, fault);
        }
    }
}

/// Whether a pilot can select modes of the firmware.
fn has_modes(firmware: &Firmware) -> bool {
    firmware.link.starts_with("mavlink")
}

#[test]
fn each_fault_in_a_hover_of_real_firmware_is_detected_and_no_old_command_is_sent() {
    shows(&FAULTS, |_| true);
}

#[test]
fn f57_real_firmware_gets_no_set_point_after_a_pilot_takes_over() {
    shows(&[TAKEN_OVER], has_modes);
}

/// The simulated battery of the Crazyflie does not become empty.
#[test]
fn f45_an_empty_battery_of_real_firmware_ends_in_a_landing() {
    shows(&[BATTERY], has_modes);
}

/// PX4 does not refuse to arm once it has a position, for which the daemon waits; the Crazyflie arms without a request.
#[test]
fn a_refusal_to_arm_of_arducopter_is_reported_in_its_words() {
    let _alone = alone();
    if let Some(path) = ARDUCOPTER.path() {
        refuses_to_arm(&ARDUCOPTER, &path);
    }
}

/// 1 % of the datagrams are lost and each takes up to 5 ms longer, in both directions; OQTAL_TEST_LOSS_S sets the duration in
/// seconds.
#[test]
fn losses_and_jitter_are_flown_through_by_real_firmware_without_old_commands() {
    let seconds = length("OQTAL_TEST_LOSS_S", 10);
    let _alone = alone();
    for (firmware, path) in present() {
        let mut flight = FirmwareFlight::start(firmware, &path, &[]);
        flight.take_off();
        {
            let mut relay = flight.relay.state();
            (relay.loss, relay.jitter_ms) = (0.01, 5.0);
            (relay.lost, relay.setpoints) = (0, Vec::new());
        }
        let seen = flight.watch(Duration::from_secs(seconds));
        assert!(seen.state(SafetyState::Hold).is_none(), "{} flies on", firmware.name);
        let high = seen.truths.iter().map(|truth| (truth.position[2] - 1.0).abs());
        let farthest = high.fold(0.0, f64::max);
        assert!(farthest < 0.3, "{} is {farthest} m off its height", firmware.name);
        let relay = flight.relay.state();
        let (count, lost) = (relay.setpoints.len(), relay.lost);
        eprintln!(
            "| {} | {seconds} s | {count} set-points, {lost} datagrams lost | {farthest:.3} m |",
            firmware.name
        );
        assert!(
            relay.setpoints.iter().all(|setpoint| setpoint.flies),
            "a set-point without thrust"
        );
        drop(relay);
        // Stamps of every command: publication, and hand-over to the port.
        for stamps in &seen.stamps {
            let age = stamps.applied_at.since(stamps.command_published_at);
            assert!(age <= OLD, "{}: a command of {} ms", firmware.name, age.seconds() * 1e3);
        }
        assert!(seen.stamps.len() as u64 > 50 * seconds, "{} commands", seen.stamps.len());
        flight.ask(OperatorCommand::Land);
        let landing = flight.watch(Duration::from_secs(6));
        assert!(landing.floor().is_some(), "{} lands", firmware.name);
    }
}
