//! One turn of the daemon over its ports: take the pose, compute, publish the command; telemetry and status afterwards.

use oqtal_bus::code::{Actuation, Answer, Cause, Mode, OperatorCommand};
use oqtal_bus::error::BusError;
use oqtal_bus::message::{
    CommandV1, ControlResponseV1, ExternalV1, Header, InputV1, PoseV1, ReferenceV1, Stamps,
    StateV1, TelemetryV1, VehicleV1,
};
use oqtal_bus::stop::ControllerStop;
use oqtal_bus::time::Time;
use oqtal_bus::topic::{
    COMMAND, EXTERNAL, INPUT, LAW_STATE, POSE, POSE_READ, REFERENCE, TELEMETRY, VEHICLE,
    VEHICLE_READ,
};
use oqtal_bus::transport::{DirectPath, Publish, Subscribe, Transport};
use oqtal_runtime::health::MotorActivity;
use oqtal_runtime::turn::{Turn, TurnClock};

use crate::cycle::Cycle;
use crate::external::LawPort;
use crate::input_record;
use crate::live::FlightChange;
use crate::operator::{LoopHandle, LoopRequest};
use crate::warmup::CacheWarmup;

/// The daemon's ports in the loop.
#[derive(Debug)]
pub struct DaemonPorts<T: Transport> {
    poses: T::Reader<PoseV1>,
    vehicles: T::Reader<VehicleV1>,
    references: T::Reader<ReferenceV1>,
    commands: T::Writer<CommandV1>,
    telemetry: T::Writer<TelemetryV1>,
    stop: ControllerStop,
    inputs: T::Writer<InputV1>,
    /// Questions to an external law and its answers; `None` for a built-in law.
    exchange: Option<(T::Writer<StateV1>, T::Writer<ExternalV1>)>,
    /// Path of the commands besides the bus.
    direct: Option<Box<dyn DirectPath>>,
    /// Copies of the samples read by the daemon, if injected faults alter them; `None` for samples that are read as sent.
    poses_read: Option<T::Writer<PoseV1>>,
    vehicles_read: Option<T::Writer<VehicleV1>>,
}

impl<T: Transport> DaemonPorts<T> {
    /// Opens the ports, the command topic first: its single writer is the lock against a second controller.
    ///
    /// # Errors
    /// Another controller holds the command topic, or the transport failed.
    pub fn open(bus: &T) -> Result<Self, BusError> {
        let commands = bus.writer(&COMMAND)?;
        Ok(Self {
            commands,
            poses: bus.reader(&POSE)?,
            vehicles: bus.reader(&VEHICLE)?,
            references: bus.reader(&REFERENCE)?,
            telemetry: bus.writer(&TELEMETRY)?,
            stop: ControllerStop::new(bus.stop_switch()?),
            inputs: bus.writer(&INPUT)?,
            exchange: None,
            direct: None,
            poses_read: bus.alters(&POSE).then(|| bus.writer(&POSE_READ)).transpose()?,
            vehicles_read: bus.alters(&VEHICLE).then(|| bus.writer(&VEHICLE_READ)).transpose()?,
        })
    }

    /// Opens the topics of questions to an external law and of its answers.
    ///
    /// # Errors
    /// The transport failed.
    pub fn open_exchange(&mut self, bus: &T) -> Result<(), BusError> {
        self.exchange = Some((bus.writer(&LAW_STATE)?, bus.writer(&EXTERNAL)?));
        Ok(())
    }

    /// Transmits commands by `path`, too.
    pub fn transmit_by(&mut self, path: Option<Box<dyn DirectPath>>) {
        self.direct = path;
    }

    /// Publishes a command, and transmits it by its other path; returns its number.
    fn command(
        &mut self,
        pose_sequence: u64,
        stamps: Stamps,
        command: CommandV1,
    ) -> Result<u64, BusError> {
        let sequence = self.commands.send(pose_sequence, stamps, command)?;
        self.direct.iter_mut().for_each(|path| path.transmit(sequence, &command));
        Ok(sequence)
    }

    /// Publishes question and answer of a tick; returns the number of the answer, 0 if no external law was asked.
    fn publish_exchange(
        &mut self,
        exchange: Option<(&StateV1, &ExternalV1)>,
    ) -> Result<u64, BusError> {
        let (Some((state, answer)), Some((states, answers))) = (exchange, &mut self.exchange)
        else {
            return Ok(0);
        };
        states.send(0, Stamps::default(), *state)?;
        answers.send(0, Stamps::default(), *answer)
    }

    /// Publishes the record of a turn's inputs if it is worth it.
    fn record(
        &mut self,
        pose: Option<&(Header, PoseV1)>,
        vehicle: Option<&(Header, VehicleV1)>,
        mut input: InputV1,
    ) -> Result<(), BusError> {
        if input_record::is_worth_recording(&input) {
            self.publish_copies(pose, vehicle, &mut input)?;
            self.record_input(input)?;
        }
        Ok(())
    }

    fn record_input(&mut self, input: InputV1) -> Result<(), BusError> {
        self.inputs.send(0, Stamps::default(), input).map(drop)
    }

    /// Publishes copies of the samples taken in a turn if they may have been altered, and names the copies in `input`.
    fn publish_copies(
        &mut self,
        pose: Option<&(Header, PoseV1)>,
        vehicle: Option<&(Header, VehicleV1)>,
        input: &mut InputV1,
    ) -> Result<(), BusError> {
        if let (Some((header, pose)), Some(copies)) = (pose, &mut self.poses_read) {
            input.pose_read = copies.send(header.pose_sequence, header.stamps, *pose)?;
        }
        if let (Some((header, vehicle)), Some(copies)) = (vehicle, &mut self.vehicles_read) {
            input.vehicle_read = copies.send(header.pose_sequence, header.stamps, *vehicle)?;
        }
        Ok(())
    }

    /// Publishes that the daemon starts at `now`; `stays` if the automatic flight at start-up was cancelled, with the cause of the Stop in
    /// which the daemon begins, `expects_flight` if the command that started the daemon will request one.
    ///
    /// # Errors
    /// The transport failed.
    pub fn announce_start(
        &mut self,
        now: Time,
        stays: bool,
        cause: Cause,
        expects_flight: bool,
    ) -> Result<(), BusError> {
        self.record_input(input_record::start(now, stays, cause, expects_flight))
    }
}

/// The turn of the daemon.
#[derive(Debug)]
pub struct DaemonTurn<'l, T: Transport> {
    /// The ports.
    pub ports: DaemonPorts<T>,
    /// The controller.
    pub cycle: Cycle,
    /// The cache warm-up before each expected pose.
    pub warmup: CacheWarmup,
    /// The hand-off to the background thread.
    pub handle: LoopHandle,
    /// The external law, if `control.controller` is one.
    pub law: LawPort<'l>,
}

impl<T: Transport> DaemonTurn<'_, T> {
    /// Executes the operators' requests that wait, and the landing after a loss of files, and records them.
    fn execute_requests(&mut self, now: Time, configs_differ: bool) -> Result<(), BusError> {
        // By signal: does not pass through the background thread.
        if self.ports.stop.is_landing_requested() {
            self.handle.call_off(Time::now());
            let landing = self.request(now, OperatorCommand::Land)?;
            self.handle.note_landing(Time::now(), &landing);
        }
        let Self { ports, cycle, handle, .. } = self;
        if ports.stop.are_files_lost() {
            cycle.lose_files(now);
            ports.record_input(input_record::lost_files(now))?;
        }
        while let Some((command, event, response)) =
            handle.poll_request(|request| execute(cycle, now, request))
        {
            let request = input_record::request(now, command, &response);
            let is_refused = response.answer == Answer::Refused.code();
            // A refused request without a content has no event.
            let event = if is_refused && !command.changes_flight() { 0 } else { event };
            let configs_differ = u8::from(configs_differ);
            ports.record_input(InputV1 { configs_differ, event, ..request })?;
        }
        Ok(())
    }

    /// Whether the last tick commanded motors.
    pub fn is_flying(&self) -> bool {
        Mode::from_code(self.cycle.telemetry().mode).is_some_and(Mode::commands_motors)
    }

    /// Whether only an operator's `arm` may begin the next flight: after a stop, also one that no turn has read, and after a flight at
    /// start-up that was called off.
    pub fn awaits_arm(&mut self) -> bool {
        self.ports.stop.is_newly_raised() || self.cycle.awaits_arm()
    }

    /// Executes a change of the flight that arrived between two turns, from the request with the number `event`, and records it.
    ///
    /// # Errors
    /// The transport failed.
    pub fn change(
        &mut self,
        now: Time,
        (command, event): (OperatorCommand, u64),
        change: &mut FlightChange,
    ) -> Result<ControlResponseV1, BusError> {
        let response = self.cycle.change(now, change);
        let input = InputV1 { event, ..input_record::request(now, command, &response) };
        self.ports.record_input(input)?;
        Ok(response)
    }

    /// Executes an operator's request that came between two turns and records it.
    ///
    /// # Errors
    /// The transport failed.
    pub fn request(
        &mut self,
        now: Time,
        command: OperatorCommand,
    ) -> Result<ControlResponseV1, BusError> {
        let response = self.cycle.request(now, command);
        self.ports.record_input(input_record::request(now, command, &response))?;
        Ok(response)
    }
}

/// Executes a request of the background thread.
fn execute(cycle: &mut Cycle, now: Time, request: &mut LoopRequest) -> ControlResponseV1 {
    match request {
        LoopRequest::Operator { command, .. } => cycle.request(now, *command),
        LoopRequest::Change { change, .. } => cycle.change(now, change),
    }
}

impl<T: Transport> Turn for DaemonTurn<'_, T> {
    fn next_event(&self, _now: Time) -> Option<Time> {
        Some(self.warmup.or(self.cycle.next_event()))
    }

    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        let Self { ports, cycle, warmup, handle, law } = self;
        let configs_differ = handle.configs_differ();
        cycle.notice_configurations(configs_differ);
        let arrival = ports.poses.latest()?;
        // Read after the pose was taken, so that no later stamp is earlier than the pose.
        let now = clock.now();
        let vehicle = ports.vehicles.latest()?;
        if let Some((header, vehicle)) = &vehicle {
            cycle.receive_vehicle(now, header, vehicle);
        }
        let reference = ports.references.latest()?;
        if let Some((header, message)) = &reference {
            cycle.receive_reference(now, header, message);
        }
        let input = input_record::of(now, arrival.as_ref(), vehicle.as_ref(), reference.as_ref());
        let mut input = InputV1 { configs_differ: u8::from(configs_differ), ..input };
        if ports.stop.is_newly_raised() {
            cycle.request(now, OperatorCommand::Stop);
            handle.call_off(Time::now());
            input.stop = 1;
        }
        if let Some(tick) = cycle.step_with(now, arrival.as_ref(), law) {
            let computed_at = clock.now();
            let stamps = Stamps { computed_at, command_published_at: clock.now(), ..tick.stamps };
            let sequence = ports.command(tick.pose_sequence, stamps, tick.command)?;
            clock.announce(&ports.commands)?;
            if tick.command.actuation == Actuation::Disarmed.code() {
                ports.stop.confirm();
            }
            let telemetry = cycle.report(&stamps, sequence);
            ports.telemetry.send(tick.pose_sequence, stamps, *telemetry)?;
            input.command_sequence = sequence;
            input.external_number = ports.publish_exchange(cycle.exchange())?;
            handle.publish_status(cycle.condition(now));
        } else if warmup.perform(now, cycle) {
            ports.commands.warm_up();
        }
        arrival.iter().for_each(|arrival| warmup.expect(now, arrival));
        vehicle.iter().for_each(|vehicle| warmup.receive_vehicle(vehicle));
        ports.record(arrival.as_ref(), vehicle.as_ref(), input)?;
        self.execute_requests(now, configs_differ)
    }

    fn motors(&self) -> MotorActivity {
        if self.is_flying() { MotorActivity::MayRun } else { MotorActivity::Off }
    }

    /// Motors off.
    fn shut_down<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        self.ports.commands.send(0, Stamps::default(), CommandV1::default())?;
        clock.announce(&self.ports.commands)
    }
}
