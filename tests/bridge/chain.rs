//! `oqtal chain` beside a bridge: flights, and the end or hang of either process in flight. What reaches the vehicle is counted there.

use oqtal_bus::message::Header;
use oqtal_bus::topic::{COMMAND, TELEMETRY};
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;

use super::flight::{BridgeFlight, TIME_OUT, is_zero};
use super::vehicle::Manner;
use crate::common::network::{Server, free_port};
use crate::common::{Running, Testbed, assert_refused, number, stderr, wait_for};

/// Most set-points after the last command that are not zero: one on its way, and those of the bridge until the command times out.
const LAST_SETPOINTS: usize = 3;

/// A bridge and a chain in flight.
struct ChainFlight {
    flight: BridgeFlight,
    chain: Running,
    cameras: Server,
}

impl ChainFlight {
    fn new(name: &str) -> Self {
        let flight = BridgeFlight::new(name, Manner::Answering);
        let words = ["--scene", "hover", "--body", "quad", "--rate", "60"];
        let cameras = Server::start("qtm", free_port(), &words);
        let chain = start_chain(&flight.testbed, &cameras);
        let mut flying = Self { flight, chain, cameras };
        flying.take_off();
        flying
    }

    /// Arms, and waits until the chain transmits commands.
    fn take_off(&mut self) {
        let Self { flight, .. } = self;
        wait_for("the daemon to arm", || {
            flight.testbed.oqtal(&["ctl", "arm"]).output().unwrap().status.success().then_some(())
        });
        wait_for("a command of the chain", || {
            flight.reports.receive().unwrap().filter(|(header, _)| is_of_chain(header))
        });
    }

    fn setpoints_are_zero_soon(&self) {
        self.flight.vehicle.clear_log();
        let setpoints = self.flight.setpoints(150);
        let others = setpoints.iter().filter(|setpoint| !is_zero(setpoint)).count();
        assert!(others <= LAST_SETPOINTS, "{others} set-points were not zero");
        assert!(setpoints[LAST_SETPOINTS..].iter().all(is_zero));
    }

    /// Number of set-points that reach the vehicle while the daemon makes thirty ticks.
    fn setpoints_of_thirty_ticks(&self) -> usize {
        let mut ticks = self.flight.bus.observer(&TELEMETRY).unwrap();
        self.flight.vehicle.clear_log();
        for _ in 0..30 {
            wait_for("a tick", || ticks.receive().unwrap());
        }
        self.flight.vehicle.log().setpoints.len()
    }
}

fn start_chain(testbed: &Testbed, cameras: &Server) -> Running {
    let link = cameras.link(",body=quad");
    testbed.start(&[&["chain", "run", "--link", &link], &TIME_OUT[..]].concat())
}

/// Whether the chain transmitted the command of a report.
fn is_of_chain(Header { stamps, .. }: &Header) -> bool {
    stamps.applied_at.is_set() && stamps.received_at == stamps.applied_at
}

#[test]
fn f14_after_a_killed_chain_the_set_point_is_zero_and_another_chain_flies() {
    let mut flying = ChainFlight::new("chain-killed");
    flying.chain.signal(Signal::KILL);
    flying.setpoints_are_zero_soon();
    flying.chain = start_chain(&flying.flight.testbed, &flying.cameras);
    flying.take_off();
    assert_eq!(flying.flight.vehicle.log().damaged, 0);
}

#[test]
fn f15_after_a_stopped_chain_the_set_point_is_zero_also_when_it_continues() {
    let flying = ChainFlight::new("chain-stopped");
    flying.chain.signal(Signal::STOP);
    flying.setpoints_are_zero_soon();
    flying.chain.signal(Signal::CONT);
    let setpoints = flying.flight.setpoints(60);
    assert!(setpoints.iter().all(is_zero), "the daemon has stopped the flight");
}

#[test]
fn f18_without_its_bridge_a_chain_sends_nothing_and_flies_with_the_next_bridge() {
    let mut flying = ChainFlight::new("chain-alone");
    flying.flight.bridge.signal(Signal::STOP);
    let sent = flying.setpoints_of_thirty_ticks();
    assert!(sent <= LAST_SETPOINTS + 1, "{sent} set-points past a stopped bridge");
    flying.flight.bridge.signal(Signal::CONT);
    flying.flight.bridge.signal(Signal::KILL);
    let sent = flying.setpoints_of_thirty_ticks();
    assert!(sent <= LAST_SETPOINTS, "{sent} set-points after the bridge");
    let vehicle = &flying.flight.vehicle;
    vehicle.release_port();
    let link = vehicle.link();
    let words = [&["bridge", "run", "--link", &link], &TIME_OUT[..]].concat();
    flying.flight.bridge = flying.flight.testbed.start(&words);
    assert!(flying.flight.setpoints(60).iter().all(is_zero));
    let log = flying.flight.vehicle.log();
    assert_eq!((log.damaged, log.emergency_stops), (0, 0));
    // The new bridge leaves the motors of the flight before alone: until they are stopped, no other flight begins.
    let told = |words: &[&str]| flying.flight.testbed.oqtal(words).output().unwrap();
    let arm = stderr(&told(&["ctl", "arm"]));
    assert!(arm.contains("run although none are commanded"), "{arm}");
    assert!(told(&["ctl", "stop"]).status.success());
    flying.take_off();
}

#[test]
fn f25_a_chain_without_a_bridge_or_beside_a_daemon_is_refused_with_a_remedy() {
    let testbed = Testbed::new("chain-refused");
    let cameras = Server::start("qtm", free_port(), &["--body", "quad"]);
    let words = ["chain", "run", "--link", &cameras.link(",body=quad")];
    let refused = |parts: &[&str]| {
        assert_refused(&testbed.oqtal(&words).output().unwrap(), 75, parts);
    };
    refused(&["oqtal chain: no bridge", "start `oqtal bridge run --instance"]);
    let plant = testbed.start(&["plant-sim", "run"]);
    wait_for("the simulator", || {
        let status = testbed.oqtal(&words).output().unwrap().stderr;
        String::from_utf8_lossy(&status).contains("plant-sim` (").then_some(())
    });
    refused(&["takes commands from the bus", "`oqtal daemon run --instance"]);
    drop((plant, testbed));
    let flight = BridgeFlight::new("chain-beside", Manner::Answering);
    let testbed = &flight.testbed;
    let _daemon = testbed.start(&[&["daemon", "run"], &TIME_OUT[..]].concat());
    wait_for("the daemon", || flight.bus.holder(&COMMAND).unwrap());
    assert_refused(&testbed.oqtal(&words).output().unwrap(), 75, &["topic `command`"]);
}

#[test]
fn a_hover_through_a_chain_and_mavlink_lands() {
    let testbed = Testbed::new("chain-hover");
    let words = ["--mocap", "qtm", "--vehicle", "bridge:mavlink", "--chain"];
    let flight = ["--trajectory", "hover", "--duration", "2"];
    let summary = testbed.lands(&[&words[..], &flight].concat());
    // No process between: most commands are applied as they are published.
    assert_eq!(number(&summary, "/hops/vehicle_to_applied/p50_ns"), 0.0);
}
