//! Camera systems behind a cable that is pulled, in a network namespace that only root may create.

use std::process::Command;
use std::time::Duration;

use crate::common::network::{Network, ip};
use crate::common::{Running, Testbed, json, wait_for};
use oqtal_bus::code::{Mode, SafetyState};
use oqtal_bus::message::TelemetryV1;
use oqtal_bus::port::Reader;
use oqtal_bus::time::Time;
use oqtal_bus::topic::{POSE, TELEMETRY};
use oqtal_bus::transport::{Subscribe, Transport};

/// Waits for a tick for which `holds` is true.
fn wait_for_tick(
    what: &str,
    telemetry: &mut Reader<TelemetryV1>,
    mut holds: impl FnMut(&TelemetryV1) -> bool,
) {
    wait_for(what, || {
        while let Some((_, tick)) = telemetry.receive().unwrap() {
            if holds(&tick) {
                return Some(());
            }
        }
        None
    });
}

fn is_in(state: SafetyState) -> impl Fn(&TelemetryV1) -> bool {
    move |tick| tick.state == state.code()
}

#[test]
fn f56_a_flight_survives_a_short_cable_fault_and_is_stopped_by_a_long_one() {
    let Some(network) = Network::alone() else { return };
    let testbed = Testbed::new("cable-flight");
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let flight = ["fly", "--mocap", "qtm", "--trajectory", "hover", "--duration", "60", "--json"];
    let inner = testbed.oqtal(&flight);
    let mut command = Command::new("ip");
    command.args(["netns", "exec", network.name()]).arg(inner.get_program());
    command.args(inner.get_args()).current_dir(testbed.path("."));
    let flight = Running::start(&mut command);
    let flying = |tick: &TelemetryV1| {
        tick.mode == Mode::Flying.code() && tick.tick > 180 && is_in(SafetyState::Nominal)(tick)
    };
    wait_for_tick("a flight", &mut telemetry, flying);
    let cable = |state: &str| assert!(ip(&["-n", network.name(), "link", "set", "lo", state]));
    cable("down");
    std::thread::sleep(Duration::from_millis(60));
    cable("up");
    // A second of flight.
    let mut ticks = 0;
    wait_for_tick("a flight that continues", &mut telemetry, |tick| {
        assert_ne!(tick.state, SafetyState::Stop.code(), "{tick:?}");
        ticks += u32::from(tick.state == SafetyState::Nominal.code());
        ticks == 60
    });
    cable("down");
    wait_for_tick("the Stop", &mut telemetry, is_in(SafetyState::Stop));
    assert_eq!(json(&flight.wait())["outcome"], "stopped");
}

#[test]
fn f56_a_pulled_cable_is_survived() {
    let Some(network) = Network::new() else { return };
    let testbed = Testbed::new("cable");
    let bus = testbed.bus();
    let mut poses = bus.observer(&POSE).unwrap();
    let server = network.server(22223);
    let link = format!("qtm:{},body=quad", Network::THERE);
    let log = testbed.path("receiver.log");
    let mut command = testbed.oqtal(&["receiver", "run", "--link", &link]);
    let stderr = std::fs::File::create(&log).unwrap();
    let _receiver = Running::start_with_stderr(&mut command, stderr.into());
    wait_for("poses", || poses.receive().unwrap());
    assert!(ip(&["link", "set", &network.cable, "down"]));
    wait_for("the message of silence", || {
        let text = std::fs::read_to_string(&log).unwrap();
        text.contains("no frames come").then_some(())
    });
    while poses.receive().unwrap().is_some() {}
    let plugged_at = Time::now();
    assert!(ip(&["link", "set", &network.cable, "up"]));
    let (header, _) = wait_for("poses after the cable is back", || poses.receive().unwrap());
    assert!(header.stamps.captured_at > plugged_at, "an old pose");
    drop(server);
}
