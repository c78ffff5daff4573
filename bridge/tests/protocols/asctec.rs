//! AscTec's vehicle, for the rules of the bridge.

use oqtal_bridge::{Asctec, Bridge, transport};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_wire::asctec::{
    Descriptor, HostCommand, LlStatus, Scales, VehicleDecoder, acknowledgement_frame,
    write_telemetry,
};
use oqtal_wire::xbee::Address;

use super::protocol::{Protocol, ProtocolVehicle, Understood};

/// The row of this protocol.
pub const PROTOCOL: Protocol = Protocol { name: "asctec", bridge, vehicle };

/// Time for which the yaw stick must be held.
const HOLD: Span = Span::from_millis(400);

fn bridge(now: Time) -> Bridge {
    let config = Config::default();
    let link = "asctec:/dev/ttyS0".parse().unwrap();
    let protocol = Asctec::new(&config).unwrap();
    Bridge::new(&config, Box::new(protocol), transport(&link, Address::BROADCAST), now)
}

fn vehicle() -> Box<dyn ProtocolVehicle> {
    Box::new(Hummingbird { decoder: VehicleDecoder::new(), motors_on: false, held_since: None })
}

struct Hummingbird {
    decoder: VehicleDecoder,
    motors_on: bool,
    /// Since when the switch is held; unset once it has switched.
    held_since: Option<Time>,
}

impl ProtocolVehicle for Hummingbird {
    fn take(&mut self, now: Time, frame: &[u8], answers: &mut Vec<Vec<u8>>) -> Understood {
        let scales = Scales::default();
        let mut understood = Understood::Word;
        let commands: Vec<HostCommand> = self.decoder.push(frame).collect();
        for command in commands {
            match command {
                HostCommand::Control(input) => {
                    let holds = scales.is_motor_switch(&input);
                    let since = *self.held_since.get_or_insert(now);
                    if !holds {
                        self.held_since = None;
                    } else if since.is_set() && now.since(since) >= HOLD {
                        self.motors_on = !self.motors_on;
                        self.held_since = Some(Time::UNSET);
                    }
                    answers.push(acknowledgement_frame(Descriptor::ControlInput).to_vec());
                    understood = match input.thrust > 0 {
                        _ if holds => Understood::Motors,
                        true => Understood::Flight(scales.decode(&input).roll),
                        false => Understood::Zero,
                    };
                }
                HostCommand::Poll(_) => answers.push(self.status()),
                HostCommand::EmergencyStop => {
                    self.motors_on = false;
                    understood = Understood::Motors;
                }
            }
        }
        understood
    }

    fn tick(&mut self, _: Time, _: &mut Vec<Vec<u8>>) {}

    fn manual_override(&mut self, motors_on: bool, _: bool) {
        self.motors_on = motors_on;
    }

    fn motors_on(&self) -> bool {
        self.motors_on
    }

    fn told_piloted(&self) -> bool {
        false
    }
}

impl Hummingbird {
    fn status(&self) -> Vec<u8> {
        let motors_on = i8::from(self.motors_on);
        let status = LlStatus { battery_1_mv: 11_100, motors_on, ..LlStatus::default() };
        let mut frame = [0; 103];
        let length = write_telemetry(Descriptor::LlStatus, &status.payload(), &mut frame).unwrap();
        frame[..length].to_vec()
    }
}
