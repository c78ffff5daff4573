//! One turn of the bridge over its ports: read the vehicle's bytes, take the command, write what is due, report. No call blocks,
//! logs or allocates.

use std::time::Duration;

use oqtal_bus::code::Cause;
use oqtal_bus::error::BusError;
use oqtal_bus::lease::ClosedPort;
use oqtal_bus::message::{CommandV1, HealthV1, PoseV1, VehicleV1};
use oqtal_bus::stop::VehicleStop;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, POSE, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_runtime::health::{Health, MotorActivity};
use oqtal_runtime::turn::{Turn, TurnClock};

use crate::background::BridgeHandle;
use crate::bridge::{Bridge, VehicleReport};
use crate::link::VehicleLink;
use crate::note::Note;
use crate::protocol::MAX_FRAME;
use crate::tenant::{PortPart, PortTenant};

/// Size of the read buffer \[bytes\]: more than a longest datagram of a vehicle, or a period of a serial line at 921600 baud.
const READ_BUFFER: usize = 2048;
const _: () = assert!(READ_BUFFER >= MAX_FRAME);
/// Maximum number of reads in one turn \[-\], however many bytes arrive.
const MAX_READS: usize = 16;
/// Number of zero set-points sent at the end.
const FINAL_FRAMES: usize = 3;
/// Time that the final frames have to leave the port before they are discarded.
const SHUTDOWN_TIMEOUT: Span = Span::from_millis(60);

/// The bridge's ports on the bus.
#[derive(Debug)]
pub struct BridgePorts<T: Transport> {
    commands: T::Reader<CommandV1>,
    /// Reader of poses; `None` for a vehicle that receives none.
    poses: Option<T::Reader<PoseV1>>,
    vehicles: T::Writer<VehicleV1>,
    stop: VehicleStop,
}

impl<T: Transport> BridgePorts<T> {
    /// Opens the ports, the vehicle topic first: its single writer is the lock against a second bridge, and a plant. Poses are read for a
    /// vehicle that `takes_poses`.
    ///
    /// # Errors
    /// Another bridge or a plant holds the vehicle topic, or the transport failed.
    pub fn open(bus: &T, takes_poses: bool) -> Result<Self, BusError> {
        let vehicles = bus.writer(&VEHICLE)?;
        let stop = VehicleStop::new(bus.stop_switch()?);
        let poses = takes_poses.then(|| bus.reader(&POSE)).transpose()?;
        Ok(Self { vehicles, commands: bus.reader(&COMMAND)?, poses, stop })
    }

    fn report(&mut self, report: VehicleReport) -> Result<(), BusError> {
        let (pose_sequence, stamps, vehicle) = report;
        self.vehicles.send(pose_sequence, stamps, vehicle).map(drop)
    }
}

/// The turn of the bridge.
#[derive(Debug)]
pub struct BridgeTurn<T: Transport> {
    /// The ports on the bus.
    pub ports: BridgePorts<T>,
    /// The bridge.
    pub bridge: Bridge,
    /// The port to the vehicle; `None` while it is lost.
    pub link: Option<Box<dyn VehicleLink>>,
    /// The process to which the port is lent.
    pub tenant: Option<Box<PortTenant>>,
    /// The hand-off to the background thread.
    pub handle: BridgeHandle,
    /// Counts the commands received and the reports published.
    pub health: Health,
}

impl<T: Transport> Turn for BridgeTurn<T> {
    fn next_event(&self, now: Time) -> Option<Time> {
        let event = self.bridge.next_event(now);
        Some(self.tenant.as_ref().map_or(event, |tenant| tenant.next_turn(now, event)))
    }

    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        self.take_part(clock.now());
        self.read_link(clock);
        self.read_command(clock)?;
        if let Some(poses) = &mut self.ports.poses
            && let Some((header, pose)) = poses.latest()?
        {
            self.bridge.receive_pose(clock.now(), &header, &pose);
        }
        self.write_due(clock)?;
        self.confirm_stop(clock.now());
        Ok(())
    }

    /// Sends zero set-points, and the emergency stop if motors run; waits until they have left. Errors cannot be reported any
    /// more.
    fn shut_down<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        self.evict_tenant(clock);
        for _ in 0..FINAL_FRAMES {
            self.bridge.begin_final_zero_setpoint(clock.now());
            let _ = self.write_outbox(clock);
        }
        if self.bridge.begin_final_emergency_stop(clock.now()) {
            let _ = self.write_outbox(clock);
        }
        self.drain_link(clock);
        self.bridge.close(clock.now());
        let last = self.bridge.report(clock.now(), None, Span::ZERO);
        let _ = self.ports.report(last);
        Ok(())
    }

    fn motors(&self) -> MotorActivity {
        if self.bridge.motors_may_run() { MotorActivity::MayRun } else { MotorActivity::Off }
    }

    fn health(&self, now: Time) -> HealthV1 {
        let cause = if self.bridge.is_answering(now) { Cause::None } else { Cause::NoVehicle };
        let unlogged = self.handle.dropped_notes();
        HealthV1 { cause: cause.code(), unlogged, ..HealthV1::default() }
    }
}

impl<T: Transport> BridgeTurn<T> {
    /// Takes what the background thread has opened.
    fn take_part(&mut self, now: Time) {
        match self.handle.request() {
            Some(PortPart::Link(link)) => {
                self.link = Some(link);
                self.bridge.open(now);
            }
            Some(PortPart::Tenant(tenant)) => self.tenant = Some(tenant),
            Some(PortPart::NoTenant) => self.tenant.iter_mut().for_each(|it| it.has_left = true),
            None => {}
        }
    }

    /// Takes the newest command, and the operator's stop.
    fn read_command(&mut self, clock: &impl TurnClock) -> Result<(), BusError> {
        let BridgePorts { commands, stop, .. } = &mut self.ports;
        let arrival = commands.latest()?;
        if stop.is_in_force(clock.now())
            && let Some((header, command)) = &arrival
        {
            stop.receive_command(header, command);
        }
        self.bridge.keep_stopped(stop.since());
        if let Some((header, command)) = arrival {
            self.health.count_input();
            // Read after the command was taken, so that it is not received before it was sent.
            let (now, lost) = (clock.now(), self.ports.commands.lost());
            self.bridge.receive_command(now, &header, command, lost);
        }
        Ok(())
    }

    /// Whether the bridge may write now. Closes the port to the tenant if a frame is due, or if flight commands must not be sent.
    fn claim_port(&mut self, clock: &impl TurnClock) -> Result<bool, BusError> {
        let Some(tenant) = &mut self.tenant else { return Ok(true) };
        let now = clock.now();
        let may_fly = self.bridge.flight_window(now).is_some() && !tenant.has_left;
        if may_fly && !self.bridge.is_due(now) {
            return Ok(false);
        }
        let handle = &mut self.handle;
        let Some(closed) = tenant.close(now, !may_fly, &mut |note| handle.note(note)) else {
            return Ok(false);
        };
        if closed != ClosedPort::Before {
            self.bridge.resume(tenant.lease.last_written(clock.now()));
            // Each command is published before it is written.
            self.read_command(clock)?;
        }
        if closed == ClosedPort::Spoilt {
            self.discard(clock.now());
        }
        if let Some(tenant) = self.tenant.take_if(|tenant| tenant.has_left) {
            self.handle.reply(PortPart::Tenant(tenant));
        }
        Ok(true)
    }

    /// Offers the port to the tenant while the next flight command would be written as it comes.
    fn offer_port(&mut self, now: Time) {
        let Some(tenant) = &self.tenant else { return };
        if let Some(window) = self.bridge.flight_window(now)
            && let Some(encoder) = self.bridge.encoder_state()
        {
            tenant.lease.offer(window, self.bridge.newest_executed(), &encoder);
        }
    }

    /// Takes the port back for good.
    fn evict_tenant(&mut self, clock: &impl TurnClock) {
        let Some(mut tenant) = self.tenant.take() else { return };
        let give_up = clock.now() + SHUTDOWN_TIMEOUT;
        while clock.now() < give_up {
            let handle = &mut self.handle;
            match tenant.close(clock.now(), true, &mut |note| handle.note(note)) {
                Some(ClosedPort::Before) => return,
                Some(ClosedPort::Whole) => {
                    return self.bridge.resume(tenant.lease.last_written(clock.now()));
                }
                Some(ClosedPort::Spoilt) => {
                    self.bridge.resume(tenant.lease.last_written(clock.now()));
                    return self.discard(clock.now());
                }
                None => std::thread::sleep(Duration::from_millis(1)),
            }
        }
    }

    /// Confirms a stop once a set-point without flight has left for the vehicle; withholds it while another has control.
    fn confirm_stop(&mut self, now: Time) {
        if self.bridge.is_released() {
            self.ports.stop.withhold();
        } else if let Some(motors) = self.bridge.stopped_motors() {
            self.ports.stop.confirm(now, motors);
        }
    }

    /// Reads what the vehicle sent.
    fn read_link(&mut self, clock: &impl TurnClock) {
        let mut buffer = [0; READ_BUFFER];
        for _ in 0..MAX_READS {
            let answers = self.bridge.begin_read(clock.now());
            let read = self.link.as_mut().map(|link| {
                link.keep_peer(answers);
                link.read(&mut buffer)
            });
            match read {
                Some(Ok(count)) if count > 0 => {
                    let handle = &mut self.handle;
                    let mut note = |note| handle.note(note);
                    self.bridge.receive_bytes(clock.now(), &buffer[..count], &mut note);
                }
                Some(Err(_)) => return self.close_link(clock.now()),
                Some(Ok(_)) | None => return,
            }
        }
    }

    /// Writes what is due: the rest of a frame, a set-point, and the frame behind it. Counts an output if it reports, or discards what
    /// the port does not send.
    fn write_due(&mut self, clock: &impl TurnClock) -> Result<(), BusError> {
        if !self.claim_port(clock)? {
            return Ok(());
        }
        self.discard_if_stuck(clock);
        self.write_outbox(clock)?;
        let handle = &mut self.handle;
        let unsent = self.bridge.turn(clock.now(), &mut |note| handle.note(note));
        if let Some(report) = unsent {
            self.health.count_output();
            self.ports.report(report)?;
        }
        self.write_outbox(clock)?;
        while self.bridge.follow_up(clock.now()) {
            self.write_outbox(clock)?;
        }
        self.offer_port(clock.now());
        Ok(())
    }

    /// Discards what the port holds back for too long.
    fn discard_if_stuck(&mut self, clock: &impl TurnClock) {
        let Some(link) = &mut self.link else { return };
        match link.queued().map(|queued| self.bridge.is_stuck(clock.now(), queued)) {
            Ok(false) => {}
            Ok(true) => {
                self.handle.note(Note::Stuck);
                self.discard(clock.now());
            }
            Err(_) => self.close_link(clock.now()),
        }
    }

    /// Discards what the port has not sent: the next frame is a zero set-point.
    fn discard(&mut self, now: Time) {
        let Some(link) = &mut self.link else { return };
        match link.discard() {
            Ok(()) => {
                self.bridge.discard_outgoing();
                self.health.count_output();
            }
            Err(_) => self.close_link(now),
        }
    }

    /// Writes the outbox to the port, as far as the port takes it.
    fn write_outbox(&mut self, clock: &impl TurnClock) -> Result<(), BusError> {
        while let (Some(link), bytes @ [_, ..]) = (&mut self.link, self.bridge.outbox()) {
            match link.write(bytes) {
                Ok(0) => return Ok(()),
                Ok(count) => {
                    // Read after the bytes were taken: the instant at which they were handed over.
                    if let Some(report) = self.bridge.handed_over(clock.now(), count) {
                        self.health.count_output();
                        self.ports.report(report)?;
                    }
                }
                Err(_) => {
                    self.close_link(clock.now());
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// Hands a lost port to the background thread, which closes it and opens it again.
    fn close_link(&mut self, now: Time) {
        if let Some(link) = self.link.take() {
            self.handle.reply(PortPart::Link(link));
        }
        self.bridge.close(now);
    }

    /// Waits at most [`SHUTDOWN_TIMEOUT`] until the port is empty; the rest is discarded, because closing a port waits for its
    /// remaining bytes.
    fn drain_link(&mut self, clock: &impl TurnClock) {
        let Some(link) = &mut self.link else { return };
        let give_up = clock.now() + SHUTDOWN_TIMEOUT;
        while self.bridge.ahead(clock.now()) > Span::ZERO || !link.queued().is_ok_and(|n| n == 0) {
            if clock.now() >= give_up {
                let _ = link.discard();
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}
