//! An autopilot of MAVLink.

use oqtal_bridge::{BareTransport, Mavlink, VehicleProtocol, VehicleTransport};
use oqtal_config::Config;
use oqtal_wire::link::{AutopilotKind, LinkSpec};
use oqtal_wire::mavlink::{
    AckResult, ArduPilotMode, AutopilotFirmware, CommandKind, MavlinkAddress, MavlinkContent,
    MavlinkDecoder, MavlinkEncoder, MavlinkHeartbeat, Px4Mode,
};

use super::peer::{Heard, LanguagePeer};

#[derive(Debug)]
pub struct MavlinkPeer {
    kind: AutopilotKind,
    encoder: MavlinkEncoder,
    decoder: MavlinkDecoder,
    follows: bool,
    answers: Vec<MavlinkContent>,
}

impl MavlinkPeer {
    pub fn new(kind: AutopilotKind) -> Self {
        let own = MavlinkAddress { system: 1, component: MavlinkAddress::AUTOPILOT };
        let (encoder, decoder) = (MavlinkEncoder::new(own), MavlinkDecoder::new());
        Self { kind, encoder, decoder, follows: false, answers: Vec::new() }
    }

    fn mode(&self, piloted: bool) -> u32 {
        match (self.kind, piloted || !self.follows) {
            (kind, false) => kind.setpoint_mode(),
            (AutopilotKind::ArduPilot, true) => ArduPilotMode::STABILIZE.0,
            (AutopilotKind::Px4, true) => Px4Mode::POSITION.0,
        }
    }

    fn meaning(&mut self, content: &MavlinkContent) -> Heard {
        match content {
            MavlinkContent::AttitudeTarget(target) if target.thrust > 0.0 => {
                Heard::Flight { thrust: target.thrust }
            }
            MavlinkContent::AttitudeTarget(_) => Heard::Zero,
            MavlinkContent::Odometry(pose) | MavlinkContent::VisionPosition(pose) => {
                Heard::Pose { captured_us: Some(pose.time_us) }
            }
            MavlinkContent::Command(command) => {
                let result = AckResult::Accepted;
                let number = command.kind.number();
                self.answers.push(MavlinkContent::Acknowledged { command: number, result });
                match command.kind {
                    CommandKind::SetMode { .. } => {
                        self.follows = true;
                        Heard::Word
                    }
                    CommandKind::Arm { run: true, .. } if self.follows => Heard::Start,
                    CommandKind::Arm { run: true, .. } => Heard::Toggle,
                    CommandKind::Arm { run: false, .. } => Heard::Stop,
                    _ => Heard::Word,
                }
            }
            _ => Heard::Word,
        }
    }
}

impl LanguagePeer for MavlinkPeer {
    fn name(&self) -> &'static str {
        self.kind.name()
    }

    fn ends(&self, config: &Config) -> (Box<dyn VehicleProtocol>, Box<dyn VehicleTransport>) {
        let Ok(LinkSpec::Mavlink(link)) = "mavlink:udpin:127.0.0.1:14550".parse() else {
            panic!("no link")
        };
        let protocol = Mavlink::new(config, &link, 0).unwrap();
        (Box::new(protocol), Box::new(BareTransport::immediate()))
    }

    fn reset(&mut self) {
        self.decoder.reset();
        self.follows = false;
        self.answers.clear();
    }

    fn tells_control(&self) -> bool {
        true
    }

    fn status(&mut self, running: bool, piloted: bool) -> Vec<u8> {
        // Motors run in the mode for set-points, unless a pilot flies.
        self.follows |= running && !piloted;
        let heartbeat = MavlinkHeartbeat {
            autopilot: AutopilotFirmware::Known(self.kind),
            custom_mode: self.mode(piloted),
            is_armed: running,
            is_simulated: false,
        };
        let said = std::mem::take(&mut self.answers);
        let said = said.into_iter().chain([MavlinkContent::Heartbeat(heartbeat)]);
        said.flat_map(|content| self.encoder.encode(&content).unwrap().as_bytes().to_vec())
            .collect()
    }

    fn hears(&mut self, bytes: &[u8]) -> Vec<Heard> {
        let packets: Vec<_> = self.decoder.push(bytes).collect();
        packets.iter().map(|packet| self.meaning(&packet.content)).collect()
    }
}
