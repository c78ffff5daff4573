//! A flight in one process without a bus, in which each tick of the daemon is passed to a callback.

use oqtal_bus::code::{Mode, OperatorCommand};
use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps, TruthV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_config::{Config, Setting};
use oqtal_daemon::{Cycle, trajectory};
use oqtal_mocap_emu::{Cameras, is_frame};
use oqtal_plant_sim::{Output, Plant};
use oqtal_runtime::virtual_clock::{TurnResult, VirtualClock};

/// Longer than take-off, square and landing together.
const LENGTH_S: f64 = 40.0;

/// Flies the square under `law` and passes each tick of the daemon, telemetry included, to `count`; returns the armed ticks.
pub fn fly(law: &str, resolve: &str, mut count: impl FnMut(&mut dyn FnMut())) -> u64 {
    let mut settings = vec![Setting::flag("test", "control.controller", law)];
    if law != "pid" {
        settings.push(Setting::flag("test", &format!("control.{law}.resolve"), resolve));
    }
    let start = Time::VIRTUAL_START;
    let mut flight = Flight::new(&Config::from_settings(&settings).unwrap(), start);
    let mut virtual_clock = VirtualClock::new(start, &Role::ALL[..3]);
    while let Some((role, now)) = virtual_clock.turn() {
        if now > start + Span::from_seconds(LENGTH_S) {
            break;
        }
        let done = match role {
            Role::Plant => flight.plant(now),
            Role::Mocap => flight.cameras(now),
            Role::Daemon => flight.daemon(now, &mut count),
            Role::Recorder | Role::Bridge => TurnResult::default(),
        };
        virtual_clock.done(role, done);
    }
    flight.flown
}

struct Flight {
    plant: Plant,
    cameras: Cameras,
    cycle: Cycle,
    frames: Vec<TruthV1>,
    pose: Option<(Header, PoseV1)>,
    command: Option<(Header, CommandV1)>,
    vehicle: Option<(Header, VehicleV1)>,
    commands: u64,
    flown: u64,
}

impl Flight {
    fn new(config: &Config, start: Time) -> Self {
        let mut cycle = Cycle::new(config, trajectory(config).unwrap(), start).unwrap();
        cycle.request(start, OperatorCommand::Fly);
        Self {
            plant: Plant::new(config, start),
            cameras: Cameras::new(&config.mocap, config.clock.seed),
            cycle,
            frames: Vec::new(),
            pose: None,
            command: None,
            vehicle: None,
            commands: 0,
            flown: 0,
        }
    }

    fn plant(&mut self, now: Time) -> TurnResult {
        let Self { frames, vehicle: newest, .. } = self;
        self.plant.advance(now, |output| match output {
            Output::Truth(truth) if is_frame(&truth) => frames.push(truth),
            Output::Truth(_) => {}
            Output::Applied(_, stamps, vehicle) => {
                *newest = Some((Header { stamps, ..Header::default() }, vehicle));
            }
        });
        if let Some((header, command)) = self.command.take() {
            self.plant.receive(now, header, command, 0);
        }
        TurnResult { next: Some(self.plant.next_event()), published: !self.frames.is_empty() }
    }

    fn cameras(&mut self, now: Time) -> TurnResult {
        for truth in self.frames.drain(..) {
            self.cameras.capture(&truth);
        }
        while let Some(delivery) = self.cameras.deliver(now) {
            let stamps = delivery.stamps_at(now);
            let header = Header { pose_sequence: delivery.frame, stamps, ..Header::default() };
            self.pose = Some((header, delivery.pose));
        }
        TurnResult { next: self.cameras.next_event(), published: self.pose.is_some() }
    }

    fn daemon(&mut self, now: Time, count: &mut impl FnMut(&mut dyn FnMut())) -> TurnResult {
        let (arrival, vehicle) = (self.pose.take(), self.vehicle.take());
        count(&mut || {
            if let Some((header, vehicle)) = &vehicle {
                self.cycle.hear(now, header, vehicle);
            }
            let Some(tick) = self.cycle.step(now, arrival.as_ref()) else { return };
            let stamps = Stamps { computed_at: now, command_published_at: now, ..tick.stamps };
            self.commands += 1;
            let telemetry = self.cycle.report(&stamps, self.commands);
            self.flown += u64::from(telemetry.mode != Mode::Disarmed.code());
            let header = Header { sequence: self.commands, stamps, ..Header::default() };
            self.command = Some((header, tick.command));
        });
        TurnResult { next: Some(self.cycle.next_event()), published: self.command.is_some() }
    }
}
