//! One turn of the daemon over its ports: take the pose, compute, publish the command; telemetry and status afterwards.

use oqtal_bus::code::{Actuation, OperatorCommand};
use oqtal_bus::error::BusError;
use oqtal_bus::message::{CommandV1, PoseV1, Stamps, TelemetryV1, VehicleV1};
use oqtal_bus::stop::ControllerStop;
use oqtal_bus::time::Time;
use oqtal_bus::topic::{COMMAND, POSE, TELEMETRY, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_runtime::turn::{Turn, TurnClock};

use crate::background::{Condition, LoopHandle};
use crate::cycle::Cycle;
use crate::warmup::CacheWarmup;

/// The daemon's ports in the loop.
#[derive(Debug)]
pub struct DaemonPorts<T: Transport> {
    poses: T::Reader<PoseV1>,
    vehicles: T::Reader<VehicleV1>,
    commands: T::Writer<CommandV1>,
    telemetry: T::Writer<TelemetryV1>,
    stop: ControllerStop,
}

impl<T: Transport> DaemonPorts<T> {
    /// Opens them, the command topic first: its single writer is the lock against a second controller.
    ///
    /// # Errors
    /// Another controller holds the command topic, or the transport failed.
    pub fn open(bus: &T) -> Result<Self, BusError> {
        let commands = bus.writer(&COMMAND)?;
        Ok(Self {
            commands,
            poses: bus.reader(&POSE)?,
            vehicles: bus.reader(&VEHICLE)?,
            telemetry: bus.writer(&TELEMETRY)?,
            stop: ControllerStop::new(bus.stop_switch()?),
        })
    }
}

/// The turn of the daemon.
#[derive(Debug)]
pub struct DaemonTurn<T: Transport> {
    /// The ports.
    pub ports: DaemonPorts<T>,
    /// The controller.
    pub cycle: Cycle,
    /// The cache warm-up before each expected pose.
    pub warmup: CacheWarmup,
    /// The hand-off to the background thread.
    pub handle: LoopHandle,
}

impl<T: Transport> Turn for DaemonTurn<T> {
    fn next_event(&self, _now: Time) -> Option<Time> {
        Some(self.warmup.or(self.cycle.next_event()))
    }

    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        let Self { ports, cycle, warmup, handle } = self;
        cycle.notice_configurations(handle.configs_differ());
        let arrival = ports.poses.latest()?;
        // Read after the pose was taken, so that no later stamp is earlier than the pose.
        let now = clock.now();
        if let Some((header, vehicle)) = ports.vehicles.latest()? {
            cycle.hear(now, &header, &vehicle);
        }
        if ports.stop.is_newly_raised() {
            cycle.request(now, OperatorCommand::Stop);
        }
        if let Some(tick) = cycle.step(now, arrival.as_ref()) {
            let computed_at = clock.now();
            let stamps = Stamps { computed_at, command_published_at: clock.now(), ..tick.stamps };
            let sequence = ports.commands.send(tick.pose_sequence, stamps, tick.command)?;
            clock.announce(&ports.commands)?;
            if tick.command.actuation == Actuation::Disarmed.code() {
                ports.stop.confirm();
            }
            let telemetry = cycle.report(&stamps, sequence);
            ports.telemetry.send(tick.pose_sequence, stamps, telemetry)?;
            handle.publish_status(Condition::of(&telemetry, cycle.at_start()));
        } else if warmup.perform(now, cycle) {
            ports.commands.warm_up();
        }
        if let Some(arrival) = &arrival {
            warmup.expect(now, arrival);
        }
        while handle.poll_request(|command| cycle.request(now, command)) {}
        Ok(())
    }

    /// Motors off.
    fn shut_down<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        self.ports.commands.send(0, Stamps::default(), CommandV1::default())?;
        clock.announce(&self.ports.commands)
    }
}
