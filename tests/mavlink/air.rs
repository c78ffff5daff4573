//! Bridge, emulated autopilot, the network between them, and their clock.

use oqtal_bridge::{BareTransport, Bridge, Mavlink, Note};
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_plant_sim::wire::MavlinkVehicle;
use oqtal_wire::link::{AutopilotKind, LinkSpec, MavlinkLink};
use oqtal_wire::mavlink::{MavlinkContent, MavlinkDecoder};

/// Milliseconds between two commands, and between two poses.
const PERIOD_MS: u64 = 17;

pub struct Air {
    pub bridge: Bridge,
    pub vehicle: MavlinkVehicle,
    pub now: Time,
    /// Last report of the bridge.
    pub report: VehicleV1,
    pub notes: Vec<Note>,
    /// Messages that the bridge sent.
    pub sent: Vec<MavlinkContent>,
    decoder: MavlinkDecoder,
    ticks: u64,
    is_cut: bool,
    is_silent: bool,
}

pub fn disarmed() -> CommandV1 {
    CommandV1::default()
}

/// Level attitude with `thrust`, a fraction of the maximum.
pub fn flight(thrust: f64) -> CommandV1 {
    CommandV1 { actuation: Actuation::Sticks.code(), thrust, ..CommandV1::default() }
}

impl Air {
    pub fn new(kind: AutopilotKind, settings: &[&str]) -> Self {
        let parse = |text: &&str| Setting::parse("test", text).unwrap();
        let config =
            Config::from_settings(&settings.iter().map(parse).collect::<Vec<_>>()).unwrap();
        let Ok(LinkSpec::Mavlink(link)) = "mavlink:udpin:127.0.0.1:14550".parse() else {
            panic!("no link")
        };
        let now = Time::VIRTUAL_START;
        let protocol = Box::new(Mavlink::new(&config, &link, 0).unwrap());
        let transport = Box::new(BareTransport::immediate());
        let mut bridge = Bridge::new(&config, protocol, transport, now);
        bridge.open(now);
        let link = MavlinkLink { autopilot: Some(kind), ..link };
        Self {
            bridge,
            vehicle: MavlinkVehicle::new(&config, &link, now).unwrap(),
            now,
            report: VehicleV1::default(),
            notes: Vec::new(),
            sent: Vec::new(),
            decoder: MavlinkDecoder::new(),
            ticks: 0,
            is_cut: false,
            is_silent: false,
        }
    }

    pub fn height(&self) -> f64 {
        self.vehicle.plant().truth().position[2]
    }

    pub fn motors_run(&mut self) -> bool {
        self.vehicle.autopilot().motors_run()
    }

    /// Receives a datagram of another sender.
    pub fn receive(&mut self, datagram: &[u8]) {
        let Self { bridge, notes, now, .. } = self;
        bridge.receive_bytes(*now, datagram, &mut |note| notes.push(note));
    }

    /// Sends `command` for `millis` \[ms\].
    pub fn fly_for(&mut self, millis: u64, command: CommandV1) {
        for _ in 0..millis {
            self.millisecond(Some(command));
        }
    }

    /// Advances the time without a command.
    pub fn wait(&mut self, millis: u64) {
        for _ in 0..millis {
            self.millisecond(None);
        }
    }

    /// Advances the time while no datagram of the bridge arrives.
    pub fn cut_for(&mut self, millis: u64) {
        self.is_cut = true;
        self.wait(millis);
        self.is_cut = false;
    }

    /// Drops every datagram of the vehicle from now on.
    pub fn fall_silent(&mut self) {
        self.is_silent = true;
    }

    fn millisecond(&mut self, command: Option<CommandV1>) {
        self.now = self.now + Span::from_millis(1);
        self.ticks += 1;
        let Self { bridge, vehicle, notes, now, is_silent, .. } = self;
        vehicle.advance(*now, |_| {});
        vehicle.host_reads(*now, |datagram| {
            if *is_silent {
                return;
            }
            bridge.receive_bytes(*now, datagram, &mut |note| notes.push(note));
        });
        if self.ticks.is_multiple_of(PERIOD_MS) {
            self.publish(command);
        }
        let Self { bridge, notes, now, .. } = self;
        if let Some((_, _, report)) = bridge.turn(*now, &mut |note| notes.push(note)) {
            self.report = report;
        }
        self.write();
        while self.bridge.follow_up(self.now) {
            self.write();
        }
    }

    fn publish(&mut self, command: Option<CommandV1>) {
        let truth = self.vehicle.plant().truth();
        let stamps = Stamps {
            captured_at: self.now - Span::from_millis(15),
            pose_published_at: self.now,
            command_published_at: self.now,
            ..Stamps::default()
        };
        let header = Header { sequence: self.ticks, stamps, ..Header::default() };
        let (position, attitude) = (truth.position, truth.attitude);
        let pose = PoseV1 { position, attitude, tracked: 1, ..PoseV1::default() };
        self.bridge.receive_pose(self.now, &header, &pose);
        if let Some(command) = command {
            self.bridge.receive_command(self.now, &header, command, 0);
        }
    }

    fn write(&mut self) {
        let bytes = self.bridge.outbox().to_vec();
        if bytes.is_empty() {
            return;
        }
        self.sent.extend(self.decoder.push(&bytes).map(|packet| packet.content));
        if !self.is_cut {
            self.vehicle.host_writes(self.now, &bytes);
        }
        if let Some((_, _, report)) = self.bridge.handed_over(self.now, bytes.len()) {
            self.report = report;
        }
    }
}
