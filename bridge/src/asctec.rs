//! AscTec's Hummingbird in terms of orders and answers. Bytes, checksums and scales are `oqtal-wire`'s.
//!
//! A neutral frame takes all four axes from here, centred and without thrust: the remote control then has no say in them, but
//! its channel 5 takes the serial interface away (manual, p. 17), and so is the pilot's last line.
//!
//! | sticks mean | roll and pitch stick | yaw stick |
//! |---|---|---|
//! | a body rate, Eq. (61) | the command's sticks | the command's stick |
//! | an attitude | roll and pitch of the commanded attitude, by 3-2-1 angles | the rate that the command's stick asks for |
//!
//! A vehicle that holds an attitude does so relative to its own heading, so the commanded attitude's roll and pitch are right
//! as far as its yaw is held.

use oqtal_bus::message::CommandV1;
use oqtal_config::Config;
use oqtal_control::euler::EulerAngles;
use oqtal_control::options::OptionError;
use oqtal_control::quaternion::Attitude;
use oqtal_wire::asctec::{
    ControlInput, Descriptor, EMERGENCY_STOP, HostDecoder, HostEvent, LlStatus, Poll, Scales,
    Status, StickMeaning, Sticks, acknowledgement_frame, poll_frame,
};

use crate::options;
use crate::protocol::{FrameSizes, VehicleFrame, VehicleProtocol, VehicleReply};
use crate::safety::VehicleSetpoint;

/// Head, length, descriptor, checksum and tail around a telemetry payload \[bytes\].
const ENVELOPE: usize = 11;

/// The protocol of AscTec's serial interface.
#[derive(Debug)]
pub struct Asctec {
    scales: Scales,
    /// Yaw rate at full stick \[rad/s\], `K_psi` of Eq. (61).
    yaw_authority: f64,
    decoder: HostDecoder,
}

impl Asctec {
    /// The protocol with the scales of `config`.
    ///
    /// # Errors
    /// A scale cannot be used.
    pub fn new(config: &Config) -> Result<Self, OptionError> {
        let [_, _, yaw_authority] = config.vehicle.rate_authority_rad_s;
        let scales = options::scales(config)?;
        Ok(Self { scales, yaw_authority, decoder: HostDecoder::new() })
    }

    /// What a command asks for, in the vehicle's terms; `None` if it does not say.
    fn sticks(&self, command: &CommandV1) -> Option<Sticks> {
        let CommandV1 { sticks: [roll, pitch, yaw], thrust, .. } = *command;
        match self.scales.sticks {
            StickMeaning::BodyRate => Some(Sticks { roll, pitch, yaw, thrust }),
            StickMeaning::Attitude => {
                let angles = EulerAngles::from_attitude(&Attitude::from_xyzw(command.attitude)?);
                let (roll, pitch) = (angles.roll, angles.pitch);
                Some(Sticks { roll, pitch, yaw: yaw * self.yaw_authority, thrust })
            }
        }
    }
}

impl VehicleProtocol for Asctec {
    fn sizes(&self) -> FrameSizes {
        FrameSizes {
            setpoint: ControlInput::FRAME_LEN,
            acknowledgement: acknowledgement_frame(Descriptor::ControlInput).len(),
            poll: poll_frame(Poll::LL_STATUS).len(),
            status: Descriptor::LlStatus.payload_len() + ENVELOPE,
        }
    }

    fn setpoint(&mut self, setpoint: &VehicleSetpoint) -> VehicleFrame {
        let input = match setpoint {
            VehicleSetpoint::Zero => ControlInput::ZERO_SETPOINT,
            VehicleSetpoint::Fly(command) => self
                .sticks(command)
                .map_or(ControlInput::ZERO_SETPOINT, |sticks| self.scales.encode(&sticks)),
            // The same frame: a toggle.
            VehicleSetpoint::StartMotors | VehicleSetpoint::StopMotors => {
                self.scales.motor_switch()
            }
        };
        VehicleFrame::of(&input.frame())
    }

    fn poll(&mut self) -> VehicleFrame {
        VehicleFrame::of(&poll_frame(Poll::LL_STATUS))
    }

    fn emergency_stop(&mut self) -> VehicleFrame {
        VehicleFrame::of(&EMERGENCY_STOP)
    }

    fn hear(&mut self, bytes: &[u8], reply: &mut dyn FnMut(VehicleReply)) {
        for event in self.decoder.push(bytes) {
            reply(match event {
                HostEvent::Acknowledged(Descriptor::ControlInput) => VehicleReply::Acknowledged,
                HostEvent::LlStatus(status) => status_of(status),
                _ => VehicleReply::Other,
            });
        }
    }

    fn damaged(&self) -> u64 {
        self.decoder.counters().damaged
    }

    fn forget(&mut self) {
        self.decoder.reset();
    }
}

fn status_of(status: LlStatus) -> VehicleReply {
    let Status { battery_v, motors_on, .. } = Status::from(status);
    VehicleReply::Status { battery_v, motors_run: motors_on }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_wire::asctec::{HostCommand, VehicleDecoder, write_telemetry};

    fn protocol() -> Asctec {
        Asctec::new(&Config::default()).unwrap()
    }

    /// What the vehicle reads of `command`.
    fn read(protocol: &mut Asctec, command: CommandV1) -> ControlInput {
        let frame = protocol.setpoint(&VehicleSetpoint::Fly(command));
        let reply: Vec<HostCommand> = VehicleDecoder::new().push(frame.bytes()).collect();
        let [HostCommand::Control(input)] = reply[..] else { panic!("{reply:?}") };
        input
    }

    #[test]
    fn frames_are_as_long_as_they_say() {
        let mut protocol = protocol();
        let sizes = protocol.sizes();
        for setpoint in [
            VehicleSetpoint::Zero,
            VehicleSetpoint::StartMotors,
            VehicleSetpoint::Fly(CommandV1::default()),
        ] {
            assert_eq!(protocol.setpoint(&setpoint).bytes().len(), sizes.setpoint);
        }
        assert_eq!(protocol.poll().bytes().len(), sizes.poll);
        let mut answer = [0; 64];
        let length = write_telemetry(Descriptor::LlStatus, &[0; 16], &mut answer);
        assert_eq!(length, Some(sizes.status));
    }

    #[test]
    fn the_vehicle_reads_what_was_ordered() {
        let mut protocol = protocol();
        let command = CommandV1 { sticks: [0.5, -0.25, 0.1], thrust: 0.25, ..CommandV1::default() };
        let input = read(&mut protocol, command);
        let read = Scales::default().decode(&input);
        let resolution = 1.0 / 2047.0;
        for (read, sent) in [read.roll, read.pitch, read.yaw].into_iter().zip(command.sticks) {
            assert!((read - sent).abs() <= resolution);
        }
        assert!((read.thrust - 0.25).abs() <= resolution);
    }

    #[test]
    fn a_vehicle_that_holds_attitudes_is_told_the_commanded_one_at_forty_counts_a_degree() {
        let mut config = Config::default();
        config.bridge.asctec.sticks = oqtal_config::AsctecSticks::Attitude;
        let mut protocol = Asctec::new(&config).unwrap();
        // 10 degrees about x, whatever the rate sticks ask for; 0.1 of 2 rad/s is 11.46 deg/s, at 120 mdeg/s 95.5 counts.
        let half = 5.0_f64.to_radians();
        let attitude = [half.sin(), 0.0, 0.0, half.cos()];
        let command =
            CommandV1 { attitude, sticks: [0.7, 0.7, 0.1], thrust: 0.25, ..CommandV1::default() };
        let input = read(&mut protocol, command);
        let signs = config.bridge.asctec.command_signs;
        assert_eq!((input.roll, input.pitch), (400 * i16::from(signs.roll), 0));
        assert_eq!(input.yaw.abs(), 95);
        let nothing = read(&mut protocol, CommandV1 { attitude: [0.0; 4], ..command });
        assert_eq!(nothing, ControlInput::ZERO_SETPOINT);
    }
}
