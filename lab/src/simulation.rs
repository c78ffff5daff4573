//! A flight in one process: the same pure objects, conducted by the same virtual_clock, with mailboxes in place of topics.

use oqtal_bus::code::{Answer, OperatorCommand};
use oqtal_bus::message::{
    CommandV1, Header, Message, PoseV1, Stamps, TelemetryV1, TruthV1, VehicleV1,
};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_config::Config;
use oqtal_daemon::Cycle;
use oqtal_mocap_emu::{Cameras, Delivery, Replay, is_frame};
use oqtal_plant_sim::{Output, Plant};
use oqtal_runtime::process::{Exit, Failure, roles};
use oqtal_runtime::virtual_clock::{TurnResult, VirtualClock};

use crate::mission::Mission;
use oqtal_observe::flight::Flight;
use oqtal_observe::recorder::Recorder;

/// How often a flight looks whether it is over.
pub const REVIEW: Span = Span::from_millis(250);

/// Where poses come from.
enum PoseSource {
    Cameras(Box<Cameras>),
    Replay(Replay),
}

/// All roles of a flight, with what lies between them.
struct Simulation {
    plant: Plant,
    pose_source: PoseSource,
    cycle: Cycle,
    recorder: Recorder,
    frames: Vec<TruthV1>,
    pose: Option<(Header, PoseV1)>,
    command: Option<(Header, CommandV1)>,
    vehicle: Option<(Header, VehicleV1)>,
    poses_sent: u64,
    commands_sent: u64,
}

/// Flies `mission` at the speed of this thread. Depends on nothing but the mission: the same configuration and seed give the
/// same flight, bit for bit, here and over the bus.
///
/// # Errors
/// An option of the law has no meaning.
pub fn fly(mission: &Mission) -> Result<Flight, Failure> {
    fly_watched(mission, |_| None)
}

/// Flies, and shows the recorder to `watch` from time to time, which may have an operator's request.
///
/// # Errors
/// An option of the law has no meaning, or an operator interrupted a flight that had not begun.
pub fn fly_watched(
    mission: &Mission,
    mut watch: impl FnMut(&Recorder) -> Option<OperatorCommand>,
) -> Result<Flight, Failure> {
    let start = Time::VIRTUAL_START;
    let mut simulation = Simulation::new(mission, start)?;
    let mut virtual_clock = VirtualClock::new(start, roles(&mission.config));
    if mission.recording.is_none() {
        simulation.cycle.request(start, OperatorCommand::Fly);
    }
    let began = Time::now();
    let mut now = start;
    while let Some((role, at)) = virtual_clock.turn() {
        now = at;
        let done = match role {
            Role::Plant => simulation.plant_turn(now),
            Role::Mocap => simulation.mocap_turn(now),
            Role::Daemon => simulation.daemon_turn(now),
            Role::Recorder => {
                if let Some(command) = watch(&simulation.recorder)
                    && simulation.cycle.request(now, command).answer == Answer::Refused.code()
                {
                    return Err(Failure::new(Exit::Flight, "interrupted"));
                }
                let end = start + mission.patience();
                if simulation.recorder.outcome().is_some() || now >= end {
                    break;
                }
                TurnResult { next: Some(end.min(now + REVIEW)), published: false }
            }
            // Takes no part in virtual time.
            Role::Bridge => TurnResult::default(),
        };
        virtual_clock.done(role, done);
    }
    let speed = now.since(start).seconds() / Time::now().since(began).seconds().max(1e-9);
    Ok(simulation.recorder.finish(mission.otherwise(), speed))
}

impl Simulation {
    fn new(mission: &Mission, start: Time) -> Result<Self, Failure> {
        let config = &mission.config;
        let vehicle = mission.plant.clone().unwrap_or_else(|| config.vehicle.clone());
        let world = Config { vehicle, ..config.clone() };
        let pose_source = match &mission.recording {
            Some(recording) => PoseSource::Replay(Replay::new(recording.clone(), start)),
            None => PoseSource::Cameras(Box::new(Cameras::new(&config.mocap, config.clock.seed))),
        };
        Ok(Self {
            plant: Plant::new(&world, start),
            pose_source,
            cycle: Cycle::new(config, mission.trajectory.clone(), start)
                .map_err(|reason| Failure::new(Exit::Config, reason))?,
            recorder: Recorder::new(config),
            frames: Vec::with_capacity(4),
            pose: None,
            command: None,
            vehicle: None,
            poses_sent: 0,
            commands_sent: 0,
        })
    }

    fn plant_turn(&mut self, now: Time) -> TurnResult {
        let Self { plant, recorder, frames, vehicle: newest, .. } = self;
        plant.advance(now, |output| match output {
            Output::Truth(truth) => {
                recorder.truth(&truth);
                if is_frame(&truth) {
                    frames.push(truth);
                }
            }
            Output::Applied(pose_sequence, stamps, vehicle) => {
                let header = header::<VehicleV1>(0, pose_sequence, stamps);
                recorder.vehicle(&header, &vehicle);
                *newest = Some((header, vehicle));
            }
        });
        if let Some((header, command)) = self.command.take() {
            self.plant.receive(now, header, command, 0);
            self.recorder.truth(&self.plant.truth());
        }
        TurnResult { next: Some(self.plant.next_event()), published: !self.frames.is_empty() }
    }

    fn mocap_turn(&mut self, now: Time) -> TurnResult {
        let mut published = false;
        while let Some(delivery) = self.look(now) {
            self.poses_sent += 1;
            let header = header::<PoseV1>(self.poses_sent, delivery.frame, delivery.stamps_at(now));
            self.recorder.pose(&header, &delivery.pose);
            // The newest wins, as on the bus.
            self.pose = Some((header, delivery.pose));
            published = true;
        }
        let next = match &self.pose_source {
            PoseSource::Cameras(cameras) => cameras.next_event(),
            PoseSource::Replay(replay) => replay.next_event(),
        };
        TurnResult { next, published }
    }

    fn look(&mut self, now: Time) -> Option<Delivery> {
        match &mut self.pose_source {
            PoseSource::Cameras(cameras) => {
                for truth in self.frames.drain(..) {
                    cameras.capture(&truth);
                }
                cameras.deliver(now)
            }
            PoseSource::Replay(replay) => replay.deliver(now),
        }
    }

    fn daemon_turn(&mut self, now: Time) -> TurnResult {
        let pose = self.pose.take();
        if let Some((header, vehicle)) = self.vehicle.take() {
            self.cycle.hear(now, &header, &vehicle);
        }
        let tick = self.cycle.step(now, pose.as_ref());
        if let Some(tick) = &tick {
            let stamps = Stamps { computed_at: now, command_published_at: now, ..tick.stamps };
            self.commands_sent += 1;
            let header = header::<CommandV1>(self.commands_sent, tick.pose_sequence, stamps);
            self.command = Some((header, tick.command));
            let telemetry: TelemetryV1 = self.cycle.report(&stamps, self.commands_sent);
            self.recorder.telemetry(&telemetry);
        }
        TurnResult { next: Some(self.cycle.next_event()), published: tick.is_some() }
    }
}

fn header<M: Message>(sequence: u64, pose_sequence: u64, stamps: Stamps) -> Header {
    Header { sequence, pose_sequence, schema: M::SCHEMA, source: 0, stamps }
}
