//! The loop: waits, listens, decides, hands over, reports. Nothing in it waits for the port, logs, or allocates.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::Cause;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{CommandV1, HealthV1, VehicleV1};
use oqtal_bus::port::{Reader, Writer};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_runtime::health::Health;
use oqtal_runtime::health::Heartbeat;
use oqtal_runtime::loop_clock::LoopClock;
use oqtal_runtime::process::{Failure, ProcessContext};
use oqtal_wire::link::LinkSpec;

use crate::background::{Note, RtHandle, rt_handle};
use crate::bridge::Bridge;
use crate::link::Link;
use crate::protocol::VehicleProtocol;
use crate::serial::Port;

/// Bytes read at once: at 57600 baud a period brings less than a hundred.
const READ: usize = 512;
/// Reads in one turn at most, however much comes.
const READS: usize = 4;
/// Neutral frames with which the bridge leaves.
const FINAL_FRAMES: usize = 3;
/// The last words may take so long to go out before they are dropped.
const SHUTDOWN_TIMEOUT: Span = Span::from_millis(60);

/// Opens bus and port, and passes commands on until asked to stop.
///
/// # Errors
/// The port cannot be opened; the bus refuses or breaks.
pub fn run(
    context: &ProcessContext,
    spec: &LinkSpec,
    protocol: Box<dyn VehicleProtocol>,
) -> Result<(), Failure> {
    let bus = context.bus()?;
    let ports = Ports::open(context, &bus)?;
    let pace = context.loop_clock(&bus, &COMMAND)?;
    let port = Port {
        path: spec.path().into(),
        baud: spec.baud(),
        hardware_flow_control: context.config.bridge.hardware_flow_control,
    };
    let link: Box<dyn Link> = Box::new(port.open()?);
    tracing::info!(link = spec.to_string(), "the port is open");
    let now = pace.now();
    let mut bridge = Bridge::new(&context.config, protocol, spec.baud(), now);
    bridge.open(now);
    let (rt_handle, background) = rt_handle();
    std::thread::scope(|threads| {
        // The background thread ends with the loop, however that ends.
        let _stop = context.stop.set_on_drop();
        threads.spawn(|| background.run(&context.stop, || port.open()));
        context.enter_realtime();
        let health = context.health.clone();
        Ok(Pump { ports, pace, bridge, link: Some(link), rt_handle, health }.work()?)
    })
}

/// The bridge's ports on the bus.
struct Ports {
    commands: Reader<CommandV1>,
    vehicles: Writer<VehicleV1>,
    heartbeat: Heartbeat,
}

impl Ports {
    /// Opens them, the vehicle's topic first: it is the lock against a second bridge, and a plant.
    fn open(context: &ProcessContext, bus: &Bus) -> Result<Self, BusError> {
        let vehicles = bus.writer(&VEHICLE)?;
        Ok(Self { vehicles, commands: bus.reader(&COMMAND)?, heartbeat: context.heartbeat(bus)? })
    }
}

/// The loop's all.
struct Pump {
    ports: Ports,
    pace: LoopClock,
    bridge: Bridge,
    link: Option<Box<dyn Link>>,
    rt_handle: RtHandle,
    health: Health,
}

impl Pump {
    /// Works until asked to stop or the bus breaks, and leaves the vehicle neutral either way, even by a panic.
    fn work(&mut self) -> Result<(), BusError> {
        let result = catch_unwind(AssertUnwindSafe(|| self.turns()));
        self.shut_down();
        result.unwrap_or_else(|panic| resume_unwind(panic))
    }

    fn turns(&mut self) -> Result<(), BusError> {
        while self.pace.wait(Some(self.bridge.next_event(self.pace.now())))?.is_some() {
            self.beat()?;
            if let Some(link) = self.rt_handle.opened() {
                self.link = Some(link);
                self.bridge.open(self.pace.now());
            }
            self.listen();
            if let Some((header, command)) = self.ports.commands.latest()? {
                self.health.count_input();
                // After the command was taken: it must not look as if it had come before it was sent.
                let (now, lost) = (self.pace.now(), self.ports.commands.lost());
                self.bridge.receive(now, &header, command, lost);
            }
            self.speak()?;
        }
        Ok(())
    }

    /// Says that this process is well, and whether the vehicle is there.
    fn beat(&mut self) -> Result<(), BusError> {
        let answers = self.bridge.answers(self.pace.now());
        let cause = if answers { Cause::None } else { Cause::NoVehicle };
        let unlogged = self.rt_handle.unlogged();
        self.ports.heartbeat.beat(HealthV1 { cause: cause.code(), unlogged, ..HealthV1::default() })
    }

    /// Takes what the port has.
    fn listen(&mut self) {
        let mut buffer = [0; READ];
        for _ in 0..READS {
            match self.link.as_mut().map(|link| link.read(&mut buffer)) {
                Some(Ok(count)) if count > 0 => {
                    self.bridge.hear(self.pace.now(), &buffer[..count]);
                }
                Some(Err(_)) => return self.lose(),
                Some(Ok(_)) | None => return,
            }
        }
    }

    /// Hands over what is due: what is left of a frame, an setpoint, and what goes behind it.
    fn speak(&mut self) -> Result<(), BusError> {
        self.unblock();
        self.hand_over()?;
        let rt_handle = &mut self.rt_handle;
        let silent = self.bridge.turn(self.pace.now(), &mut |note| rt_handle.note(note));
        if let Some(report) = silent {
            self.report(report)?;
        }
        if !self.bridge.outbox().is_empty() {
            self.hand_over()?;
            self.bridge.follow_up(self.pace.now());
            self.hand_over()?;
        }
        Ok(())
    }

    /// Drops what does not go out.
    fn unblock(&mut self) {
        let Some(link) = &mut self.link else { return };
        let stuck = link.queued().map(|queued| self.bridge.is_stuck(self.pace.now(), queued));
        let dropped = match stuck {
            Ok(false) => return,
            Ok(true) => link.discard(),
            Err(error) => Err(error),
        };
        match dropped {
            Ok(()) => {
                self.bridge.drop_outgoing();
                self.rt_handle.note(Note::Stuck);
            }
            Err(_) => self.lose(),
        }
    }

    /// Hands the outbox to the port, as far as that takes it.
    fn hand_over(&mut self) -> Result<(), BusError> {
        while let (Some(link), bytes @ [_, ..]) = (&mut self.link, self.bridge.outbox()) {
            match link.write(bytes) {
                Ok(0) => return Ok(()),
                Ok(count) => {
                    // After the bytes were taken: when they were handed over.
                    if let Some(report) = self.bridge.handed_over(self.pace.now(), count) {
                        self.report(report)?;
                    }
                }
                Err(_) => {
                    self.lose();
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    fn report(&mut self, report: crate::bridge::Report) -> Result<(), BusError> {
        let (pose_sequence, stamps, vehicle) = report;
        self.ports.vehicles.send(pose_sequence, stamps, vehicle).map(drop)
    }

    /// The port is gone: it is closed and searched for elsewhere, and the daemon is told in the next turn.
    fn lose(&mut self) {
        if let Some(link) = self.link.take() {
            self.rt_handle.lost(link);
        }
        self.bridge.close(self.pace.now());
    }

    /// Leaves the vehicle neutral: nothing that was handed over may act after this. Errors have nobody left to go to.
    fn shut_down(&mut self) {
        for _ in 0..FINAL_FRAMES {
            self.bridge.say_neutral(self.pace.now());
            let _ = self.hand_over();
        }
        if self.bridge.say_emergency_stop(self.pace.now()) {
            let _ = self.hand_over();
        }
        if let Some(link) = &mut self.link {
            let give_up = self.pace.now() + SHUTDOWN_TIMEOUT;
            let is_out = |link: &dyn Link, now: Time| {
                self.bridge.ahead(now) == Span::ZERO && link.queued().is_ok_and(|left| left == 0)
            };
            while !is_out(link.as_ref(), self.pace.now()) {
                if self.pace.now() >= give_up {
                    // A port that holds bytes back would keep its closing waiting for them.
                    let _ = link.discard();
                    break;
                }
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        self.bridge.close(self.pace.now());
        let last = self.bridge.report(self.pace.now(), None, Span::ZERO);
        let _ = self.report(last);
    }
}
