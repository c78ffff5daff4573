//! Autopilots of MAVLink, for the rules of the bridge.

use oqtal_bridge::{Bridge, Mavlink, transport};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_wire::link::{AutopilotKind, LinkSpec};
use oqtal_wire::mavlink::{
    AckResult, ArduPilotMode, AttitudeTarget, AutopilotFirmware, CommandKind, MavlinkAddress,
    MavlinkContent, MavlinkDecoder, MavlinkEncoder, MavlinkHeartbeat, Px4Mode, SetpointKind,
};
use oqtal_wire::xbee::Address;

use super::protocol::{Protocol, ProtocolVehicle, Understood};

/// The rows of this protocol.
pub const ARDUPILOT: Protocol = Protocol {
    name: "mavlink, ardupilot",
    bridge: |now| bridge(now, "ardupilot-quad"),
    vehicle: || Box::new(Autopilot::new(AutopilotKind::ArduPilot)),
};
pub const PX4: Protocol = Protocol {
    name: "mavlink, px4",
    bridge: |now| bridge(now, "px4-quad"),
    vehicle: || Box::new(Autopilot::new(AutopilotKind::Px4)),
};

/// Heartbeats arrive at the rate that the bridge requests.
const HEARTBEAT: Span = Span::from_millis(50);

fn config(preset: &str) -> Config {
    Config::load(&[], &[Setting::flag("test", "vehicle.preset", preset)]).unwrap()
}

fn bridge(now: Time, preset: &str) -> Bridge {
    let config = config(preset);
    let link: LinkSpec = "mavlink:udpin:127.0.0.1:14550".parse().unwrap();
    let LinkSpec::Mavlink(mavlink) = &link else { panic!("{link} is another protocol") };
    let protocol = Mavlink::new(&config, mavlink, 0).unwrap();
    Bridge::new(&config, Box::new(protocol), transport(&link, Address::BROADCAST), now)
}

struct Autopilot {
    kind: AutopilotKind,
    /// Roll rate at full stick \[rad/s\].
    authority: f64,
    encoder: MavlinkEncoder,
    decoder: MavlinkDecoder,
    is_armed: bool,
    /// The mode is that for set-points.
    follows: bool,
    told_piloted: bool,
    told_at: Option<Time>,
}

impl Autopilot {
    fn new(kind: AutopilotKind) -> Self {
        let own = MavlinkAddress { system: 1, component: MavlinkAddress::AUTOPILOT };
        let preset = match kind {
            AutopilotKind::ArduPilot => "ardupilot-quad",
            AutopilotKind::Px4 => "px4-quad",
        };
        Self {
            kind,
            authority: config(preset).vehicle.rate_authority_rad_s[0],
            encoder: MavlinkEncoder::new(own),
            decoder: MavlinkDecoder::new(),
            is_armed: false,
            follows: false,
            told_piloted: false,
            told_at: None,
        }
    }

    fn understand(
        &mut self,
        content: &MavlinkContent,
        answers: &mut Vec<MavlinkContent>,
    ) -> Understood {
        match content {
            MavlinkContent::AttitudeTarget(target) => self.setpoint(target),
            MavlinkContent::Odometry(pose) | MavlinkContent::VisionPosition(pose) => {
                Understood::Pose(Some(pose.time_us))
            }
            MavlinkContent::Command(command) => {
                let (number, result) = (command.kind.number(), AckResult::Accepted);
                let target = MavlinkAddress::ALL;
                answers.push(MavlinkContent::Acknowledged { command: number, result, target });
                match command.kind {
                    CommandKind::SetMode { .. } => self.follows = true,
                    CommandKind::Arm { run, .. } => self.is_armed = run,
                    _ => return Understood::Word,
                }
                Understood::Motors
            }
            _ => Understood::Word,
        }
    }

    fn setpoint(&self, target: &AttitudeTarget) -> Understood {
        let SetpointKind::Rates(rates) = target.kind else { panic!("{target:?}: no rates") };
        match target.thrust > 0.0 {
            true => Understood::Flight(rates[0] / self.authority),
            false => Understood::Zero,
        }
    }

    fn encode(&mut self, content: &MavlinkContent) -> Vec<u8> {
        self.encoder.encode(content).unwrap().as_bytes().to_vec()
    }
}

impl ProtocolVehicle for Autopilot {
    fn take(&mut self, _: Time, frame: &[u8], answers: &mut Vec<Vec<u8>>) -> Understood {
        let packets: Vec<_> = self.decoder.push(frame).collect();
        let [packet] = packets[..] else { panic!("{packets:?}: one packet was sent") };
        let mut replies = Vec::new();
        let understood = self.understand(&packet.content, &mut replies);
        answers.extend(replies.iter().map(|content| self.encode(content)));
        understood
    }

    fn tick(&mut self, now: Time, answers: &mut Vec<Vec<u8>>) {
        if self.told_at.is_some_and(|at| now.since(at) < HEARTBEAT) {
            return;
        }
        self.told_at = Some(now);
        self.told_piloted = self.is_armed && !self.follows;
        let custom_mode = match self.kind {
            kind if self.follows => kind.setpoint_mode(),
            AutopilotKind::ArduPilot => ArduPilotMode::STABILIZE.0,
            AutopilotKind::Px4 => Px4Mode::POSITION.0,
        };
        let heartbeat = MavlinkHeartbeat {
            autopilot: AutopilotFirmware::Known(self.kind),
            custom_mode,
            is_armed: self.is_armed,
            is_simulated: false,
        };
        answers.push(self.encode(&MavlinkContent::Heartbeat(heartbeat)));
    }

    fn manual_override(&mut self, motors_on: bool, is_piloted: bool) {
        (self.is_armed, self.follows) = (motors_on, motors_on && !is_piloted);
    }

    fn motors_on(&self) -> bool {
        self.is_armed
    }

    fn told_piloted(&self) -> bool {
        self.told_piloted
    }
}
