//! AscTec's vehicle.

use oqtal_bridge::{Asctec, BareTransport, VehicleProtocol, VehicleTransport};
use oqtal_config::Config;
use oqtal_wire::asctec::{
    ControlInput, Descriptor, HostCommand, LlStatus, Scales, VehicleDecoder, write_telemetry,
};

use super::peer::{Heard, LanguagePeer};

#[derive(Debug)]
pub struct AsctecPeer {
    decoder: VehicleDecoder,
    scales: Scales,
}

impl AsctecPeer {
    pub fn new() -> Self {
        let scales = Config::default().bridge.asctec.convert("bridge.asctec").unwrap();
        Self { decoder: VehicleDecoder::new(), scales }
    }
}

impl LanguagePeer for AsctecPeer {
    fn name(&self) -> &'static str {
        "asctec"
    }

    fn ends(&self, config: &Config) -> (Box<dyn VehicleProtocol>, Box<dyn VehicleTransport>) {
        (Box::new(Asctec::new(config).unwrap()), Box::new(BareTransport::serial(57_600)))
    }

    fn reset(&mut self) {
        self.decoder.reset();
    }

    fn tells_control(&self) -> bool {
        false
    }

    fn status(&mut self, running: bool, _: bool) -> Vec<u8> {
        let motors_on = i8::from(running);
        let payload = LlStatus { battery_1_mv: 11_100, motors_on, ..LlStatus::default() }.payload();
        let mut frame = [0; 103];
        let length = write_telemetry(Descriptor::LlStatus, &payload, &mut frame).unwrap();
        frame[..length].to_vec()
    }

    fn hears(&mut self, bytes: &[u8]) -> Vec<Heard> {
        let scales = self.scales.clone();
        let meaning = |command| match command {
            HostCommand::Control(input) if scales.is_motor_switch(&input) => Heard::Toggle,
            HostCommand::Control(input) if input == ControlInput::ZERO_SETPOINT => Heard::Zero,
            HostCommand::Control(input) => Heard::Flight { thrust: scales.decode(&input).thrust },
            HostCommand::EmergencyStop => Heard::Stop,
            HostCommand::Poll(_) => Heard::Word,
        };
        self.decoder.push(bytes).map(meaning).collect()
    }
}
