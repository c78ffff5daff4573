//! The port of a bridge and its tenant, in virtual time: whatever the order of their steps, every command is written once, and none after
//! a newer set-point.

use std::collections::VecDeque;
use std::io;
use std::os::unix::process::ExitStatusExt;
use std::process::Command;
use std::sync::{Arc, Mutex};

use oqtal_bridge::{
    Asctec, BridgePorts, BridgeTurn, Note, PortPart, PortTenant, VehicleLink, VehicleProtocol,
    VehicleSetpoint,
};
use oqtal_bus::lease::PortLease;
use oqtal_bus::memory::{MemoryBus, MemoryWriter};
use oqtal_bus::message::{CommandV1, Stamps};
use oqtal_bus::stop::StopSwitch;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::COMMAND;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_config::Config;
use oqtal_runtime::handoff::{BackgroundHandle, handoff};
use oqtal_runtime::turn::step;
use oqtal_wire::asctec::{ControlInput, HostCommand, VehicleDecoder};
use proptest::prelude::*;
use rustix::process::{Pid, PidfdFlags, Signal, getpid, pidfd_open};

use crate::common::{START, bridge, flight, status};

/// Time that a byte takes on the line at 57600 baud.
const BYTE: Span = Span::from_nanos(173_611);

/// Both directions of a serial port.
#[derive(Clone, Debug)]
struct TestLink {
    sent: Arc<Mutex<VecDeque<u8>>>,
    replies: Arc<Mutex<VecDeque<u8>>>,
    /// The present, and the instant at which the last byte has left.
    line: Arc<Mutex<[Time; 2]>>,
}

impl TestLink {
    fn new() -> Self {
        let line = Arc::new(Mutex::new([START; 2]));
        Self { sent: Arc::default(), replies: Arc::default(), line }
    }

    fn add(&self, bytes: &[u8]) {
        self.sent.lock().unwrap().extend(bytes);
        let mut line = self.line.lock().unwrap();
        line[1] = line[0].max(line[1]) + BYTE.scaled(bytes.len() as f64);
    }
}

impl VehicleLink for TestLink {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut replies = self.replies.lock().unwrap();
        let count = replies.len().min(buffer.len());
        replies.drain(..count).zip(buffer).for_each(|(byte, place)| *place = byte);
        Ok(count)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.add(bytes);
        Ok(bytes.len())
    }

    fn queued(&self) -> io::Result<usize> {
        let [now, free_at] = *self.line.lock().unwrap();
        Ok((free_at.since(now).nanos().max(0) as u64).div_ceil(BYTE.nanos() as u64) as usize)
    }

    fn discard(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A bridge, its vehicle, and a tenant beside a daemon.
struct Tenancy {
    turn: BridgeTurn<MemoryBus>,
    _background: BackgroundHandle<Note, PortPart, PortPart>,
    commands: MemoryWriter<CommandV1>,
    stop: StopSwitch,
    link: TestLink,
    lease: PortLease,
    protocol: Asctec,
    decoder: VehicleDecoder,
    now: Time,
    next: Time,
    sequence: u64,
    /// Number of set-points that the tenant wrote.
    written: usize,
    /// Every set-point, in order: of a command, its number.
    setpoints: Vec<Option<u64>>,
}

/// Flight command whose roll stick tells its number.
fn numbered(sequence: u64) -> CommandV1 {
    CommandV1 { sticks: [(sequence % 1000) as f64 * 1e-3, 0.0, 0.0], ..flight() }
}

impl Tenancy {
    /// In flight: the bridge has forwarded commands, and has lent its port.
    fn airborne() -> Self {
        Self::airborne_with(getpid())
    }

    /// The same with a tenant in the process `pid`.
    fn airborne_with(pid: Pid) -> Self {
        let bus = MemoryBus::new();
        let lease = PortLease::create().unwrap();
        let file = lease.descriptor().try_clone_to_owned().unwrap().into();
        let process = pidfd_open(pid, PidfdFlags::empty()).unwrap();
        let tenant = PortTenant::new(lease, process);
        let (link, (handle, background)) = (TestLink::new(), handoff());
        let turn = BridgeTurn {
            ports: BridgePorts::open(&bus, false).unwrap(),
            bridge: bridge(),
            link: Some(Box::new(link.clone())),
            tenant: Some(Box::new(tenant)),
            handle,
            health: Default::default(),
        };
        let mut tenancy = Self {
            turn,
            _background: background,
            commands: bus.writer(&COMMAND).unwrap(),
            stop: bus.stop_switch().unwrap(),
            link,
            lease: PortLease::of_file(file).unwrap(),
            protocol: Asctec::new(&Config::default()).unwrap(),
            decoder: VehicleDecoder::new(),
            now: START,
            next: START,
            sequence: 0,
            written: 0,
            setpoints: Vec::new(),
        };
        for _ in 0..100 {
            tenancy.millisecond(true);
        }
        for _ in 0..10 {
            tenancy.publish(numbered);
            (0..16).for_each(|_| tenancy.millisecond(true));
        }
        assert_eq!(tenancy.setpoints.last(), Some(&Some(10)), "it flies");
        tenancy
    }

    /// A millisecond, in which the bridge makes its turns if it `runs`.
    fn millisecond(&mut self, runs: bool) {
        self.now = self.now + Span::from_millis(1);
        self.link.line.lock().unwrap()[0] = self.now;
        let mut replies = self.link.replies.lock().unwrap();
        replies.clear();
        replies.extend(status(i8::from(self.sequence > 0)));
        drop(replies);
        if runs && self.now >= self.next {
            self.turn_bridge();
        }
    }

    fn turn_bridge(&mut self) {
        self.next = step(&mut self.turn, self.now).unwrap().next.unwrap();
        self.read_wire();
    }

    fn read_wire(&mut self) {
        let bytes: Vec<u8> = self.link.sent.lock().unwrap().drain(..).collect();
        for command in self.decoder.push(&bytes) {
            let HostCommand::Control(input) = command else { continue };
            let number = |sequence: &u64| encoded(&mut self.protocol, *sequence) == input;
            let number = (1..=self.sequence).rev().take(9).find(number);
            assert!(number.is_some() || input.thrust == 0, "an old command");
            self.setpoints.push(number);
        }
    }

    /// Publishes the next command, as `command` makes it from its number.
    fn publish(&mut self, command: impl Fn(u64) -> CommandV1) {
        self.sequence += 1;
        let stamps = Stamps { command_published_at: self.now, ..Stamps::default() };
        self.commands.send(1, stamps, command(self.sequence)).unwrap();
    }

    /// The tenant's step behind it.
    fn transmit(&mut self) {
        let Some(encoder) = self.lease.take(|| self.now, self.sequence) else { return };
        let command = VehicleSetpoint::Fly(numbered(self.sequence));
        let frame = self.protocol.setpoint(self.now, &command);
        self.lease.begin(self.sequence, frame.bytes().len(), &encoder);
        self.link.add(frame.bytes());
        self.lease.end(self.now, true);
        self.written += 1;
        self.read_wire();
    }

    fn assert_in_order(&self) {
        let (mut newest, mut least) = (0, 0);
        for setpoint in &self.setpoints {
            // An old command must not follow a zero set-point.
            match setpoint {
                None => least = newest + 1,
                Some(number) => {
                    assert!(*number >= least.max(newest), "{:?}", self.setpoints);
                    newest = *number;
                }
            }
        }
    }
}

fn encoded(protocol: &mut Asctec, sequence: u64) -> ControlInput {
    let frame = protocol.setpoint(START, &VehicleSetpoint::Fly(numbered(sequence)));
    let mut decoder = VehicleDecoder::new();
    let mut commands = decoder.push(frame.bytes());
    let Some(HostCommand::Control(input)) = commands.next() else { panic!("a frame") };
    input
}

#[test]
fn a_tenant_writes_each_command_once_and_the_bridge_reports_it() {
    let mut tenancy = Tenancy::airborne();
    for _ in 0..100 {
        tenancy.publish(numbered);
        tenancy.transmit();
        tenancy.turn_bridge();
        (0..16).for_each(|_| tenancy.millisecond(true));
    }
    assert_eq!(tenancy.written, 100);
    let flown: Vec<u64> = tenancy.setpoints.iter().flatten().copied().collect();
    assert_eq!(flown[flown.len() - 100..], (11..=110).collect::<Vec<_>>()[..]);
}

#[test]
fn a_late_tick_of_a_tenant_at_a_serial_port_is_not_taken_for_a_port_that_is_stuck() {
    let mut tenancy = Tenancy::airborne();
    let sent = tenancy.setpoints.len();
    for late_ms in [4, 6, 0, 8].into_iter().cycle().take(100) {
        tenancy.publish(numbered);
        tenancy.transmit();
        tenancy.turn_bridge();
        (0..16 + late_ms).for_each(|_| tenancy.millisecond(true));
    }
    assert!(tenancy.setpoints[sent..].iter().all(Option::is_some), "{:?}", tenancy.setpoints);
    assert!(tenancy.written > 90, "{}", tenancy.written);
}

#[test]
fn f14_f15_after_the_last_command_of_a_chain_the_set_point_is_zero_within_three_periods() {
    let mut tenancy = Tenancy::airborne();
    tenancy.publish(numbered);
    tenancy.transmit();
    assert_eq!(tenancy.written, 1);
    tenancy.turn_bridge();
    let sent = tenancy.setpoints.len();
    (0..51).for_each(|_| tenancy.millisecond(true));
    assert_eq!(tenancy.setpoints.last(), Some(&None), "{:?}", &tenancy.setpoints[sent..]);
    // The chain was suspended before it transmitted its next command.
    tenancy.sequence += 1;
    tenancy.transmit();
    (0..100).for_each(|_| tenancy.millisecond(true));
    assert!(tenancy.setpoints[sent + 3..].iter().all(Option::is_none), "{:?}", tenancy.setpoints);
}

#[test]
fn f15_a_tenant_that_hangs_in_a_frame_is_killed_and_the_set_point_is_zero() {
    let mut hung = Command::new("sleep").arg("600").spawn().unwrap();
    let mut tenancy = Tenancy::airborne_with(Pid::from_child(&hung));
    tenancy.publish(numbered);
    tenancy.lease.take(|| tenancy.now, tenancy.sequence).expect("the port is offered");
    let sent = tenancy.setpoints.len();
    (0..200).for_each(|_| tenancy.millisecond(true));
    assert_eq!(hung.wait().unwrap().signal(), Some(Signal::KILL.as_raw()));
    (0..20).for_each(|_| tenancy.millisecond(true));
    let after = &tenancy.setpoints[sent..];
    assert!(!after.is_empty() && after.iter().all(Option::is_none), "{after:?}");
}

#[test]
fn f18_without_a_running_bridge_the_tenant_soon_has_no_port() {
    let mut tenancy = Tenancy::airborne();
    for _ in 0..10 {
        tenancy.publish(numbered);
        tenancy.transmit();
        (0..17).for_each(|_| tenancy.millisecond(false));
    }
    assert!((1..=3).contains(&tenancy.written), "{}", tenancy.written);
}

proptest! {
    #[test]
    fn in_any_order_of_steps_commands_are_written_in_order_and_not_after_a_zero_set_point(
        steps in prop::collection::vec((0..12_u8, 1..40_u8), 50..200),
    ) {
        let mut tenancy = Tenancy::airborne();
        for (step, millis) in steps {
            match step {
                0..=4 => {
                    tenancy.publish(numbered);
                    tenancy.transmit();
                    tenancy.turn_bridge();
                }
                5 => tenancy.publish(numbered),
                6 => tenancy.turn_bridge(),
                7 => tenancy.transmit(),
                8 => {
                    tenancy.publish(|_| CommandV1::default());
                    tenancy.turn_bridge();
                }
                9 if millis < 10 => drop(tenancy.stop.raise()),
                10 => (0..millis).for_each(|_| tenancy.millisecond(false)),
                _ => (0..millis / 2).for_each(|_| tenancy.millisecond(true)),
            }
            tenancy.millisecond(true);
        }
        tenancy.assert_in_order();
    }
}
