//! Protocol of AscTec's Hummingbird: set-points to frames, telemetry to replies. Bytes, checksums and scales are `oqtal-wire`'s.
//!
//! The zero set-point commands all four axes, centred and without thrust: the remote control is then ignored, except that its
//! channel 5 disables the serial interface (manual, p. 17), which is the pilot's last resort.
//!
//! The status request is the protocol's one periodic frame, sent at `bridge.status-rate-hz`.
//!
//! | `vehicle.interface` | roll and pitch stick | yaw stick |
//! |---|---|---|
//! | `rate`, Eq. (61) | the command's sticks | the command's stick |
//! | `attitude` | roll and pitch of the commanded attitude, as 3-2-1 angles | the rate that the command's stick stands for |
//!
//! A vehicle with its own attitude loop holds the attitude relative to its own heading: the commanded roll and pitch are correct only while
//! the yaw is held.

use oqtal_bus::lease::EncoderState;
use oqtal_bus::message::CommandV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::euler::EulerAngles;
use oqtal_control::options::OptionError;
use oqtal_control::quaternion::Attitude;
use oqtal_wire::asctec::{
    ControlInput, Descriptor, EMERGENCY_STOP, HostDecoder, HostEvent, Poll, Scales, Status,
    StickMeaning, Sticks, acknowledgement_frame, poll_frame,
};

use crate::options;
use crate::protocol::{
    FrameSizes, PeriodicFrame, PeriodicTimer, ReportedMotors, VehicleFrame, VehicleProtocol,
    VehicleReply,
};
use crate::setpoint::VehicleSetpoint;
use crate::timing::millis;

/// Length of head, length, descriptor, checksum and tail around a telemetry payload \[bytes\].
const ENVELOPE: usize = 11;

/// The protocol of AscTec's serial interface.
#[derive(Debug)]
pub struct Asctec {
    scales: Scales,
    /// Yaw rate at full stick \[rad/s\], `K_psi` of Eq. (61).
    yaw_authority: f64,
    decoder: HostDecoder,
    status_timer: PeriodicTimer,
    time_out: Option<Span>,
}

impl Asctec {
    /// Protocol with the scales and the status rate of `config`.
    ///
    /// # Errors
    /// A scale cannot be used.
    pub fn new(config: &Config) -> Result<Self, OptionError> {
        let [_, _, yaw_authority] = config.vehicle.rate_authority_rad_s;
        let status_period = Span::period_of(config.bridge.status_rate_hz);
        let time_out_ms = config.bridge.vehicle_time_out_ms;
        Ok(Self {
            scales: options::scales(config)?,
            yaw_authority,
            decoder: HostDecoder::new(),
            status_timer: PeriodicTimer::new(status_period),
            time_out: (time_out_ms > 0.0).then(|| millis(time_out_ms)),
        })
    }

    /// Converts a command to sticks; `None` if the sticks command an attitude and the command has none.
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
            periodic: poll_frame(Poll::LL_STATUS).len(),
            periodic_reply: Descriptor::LlStatus.payload_len() + ENVELOPE,
        }
    }

    fn setpoint(&mut self, _: Time, setpoint: &VehicleSetpoint) -> VehicleFrame {
        let input = match setpoint {
            VehicleSetpoint::Zero => ControlInput::ZERO_SETPOINT,
            VehicleSetpoint::Fly(command) => self
                .sticks(command)
                .map_or(ControlInput::ZERO_SETPOINT, |sticks| self.scales.encode(&sticks)),
            // One frame, a toggle, for both.
            VehicleSetpoint::StartMotors | VehicleSetpoint::StopMotors => {
                self.scales.motor_switch()
            }
            VehicleSetpoint::Released => return VehicleFrame::EMPTY,
        };
        VehicleFrame::of(&input.frame())
    }

    fn periodic(&mut self, now: Time, is_status_urgent: bool) -> Option<PeriodicFrame> {
        let request = || VehicleFrame::of(&poll_frame(Poll::LL_STATUS));
        let is_due = self.status_timer.is_due(now, is_status_urgent);
        is_due.then(|| PeriodicFrame { frame: request(), is_answered: true })
    }

    fn time_out(&self) -> Option<Span> {
        self.time_out
    }

    fn emergency_stop(&mut self) -> VehicleFrame {
        VehicleFrame::of(&EMERGENCY_STOP)
    }

    fn decode(&mut self, _: Time, bytes: &[u8], reply: &mut dyn FnMut(VehicleReply)) {
        for event in self.decoder.push(bytes) {
            match event {
                HostEvent::Acknowledged(Descriptor::ControlInput) => reply(VehicleReply::Answer),
                HostEvent::LlStatus(status) => {
                    let Status { battery_v, motors_on, .. } = Status::from(status);
                    reply(VehicleReply::Answer);
                    reply(VehicleReply::Battery(battery_v));
                    reply(VehicleReply::Motors(ReportedMotors::of(motors_on)));
                }
                _ => reply(VehicleReply::Other),
            }
        }
    }

    /// The frames of set-points have no state.
    fn encoder_state(&self) -> Option<EncoderState> {
        Some(EncoderState::default())
    }

    fn damaged(&self) -> u64 {
        self.decoder.counters().damaged
    }

    fn reset(&mut self) {
        self.decoder.reset();
        self.status_timer.restart();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_wire::asctec::{HostCommand, VehicleDecoder, write_telemetry};

    fn protocol() -> Asctec {
        Asctec::new(&Config::default()).unwrap()
    }

    /// The control input that the vehicle decodes from the frame of `command`.
    fn read(protocol: &mut Asctec, command: CommandV1) -> ControlInput {
        let frame = protocol.setpoint(Time::VIRTUAL_START, &VehicleSetpoint::Fly(command));
        let reply: Vec<HostCommand> = VehicleDecoder::new().push(frame.bytes()).collect();
        let [HostCommand::Control(input)] = reply[..] else { panic!("{reply:?}") };
        input
    }

    #[test]
    fn frames_have_the_stated_lengths() {
        let mut protocol = protocol();
        let sizes = protocol.sizes();
        for setpoint in [
            VehicleSetpoint::Zero,
            VehicleSetpoint::StartMotors,
            VehicleSetpoint::Fly(CommandV1::default()),
        ] {
            assert_eq!(
                protocol.setpoint(Time::VIRTUAL_START, &setpoint).bytes().len(),
                sizes.setpoint
            );
        }
        let word = protocol.periodic(Time::VIRTUAL_START, false).unwrap();
        assert_eq!(word.frame.bytes().len(), sizes.periodic);
        let mut answer = [0; 64];
        let length = write_telemetry(Descriptor::LlStatus, &[0; 16], &mut answer);
        assert_eq!(length, Some(sizes.periodic_reply));
    }

    #[test]
    fn the_status_is_requested_at_its_rate_and_sooner_if_urgent() {
        let mut protocol = protocol();
        let mut requests = |step: i64, is_urgent: bool| {
            let ticks = (0..60).map(|tick| Span::from_nanos(16_666_667 * (60 * step + tick)));
            ticks
                .filter(|t| protocol.periodic(Time::VIRTUAL_START + *t, is_urgent).is_some())
                .count()
        };
        assert_eq!((requests(0, false), requests(1, true), requests(2, false)), (8, 60, 7));
    }

    #[test]
    fn the_vehicle_decodes_the_command() {
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
    fn a_vehicle_that_holds_attitudes_gets_forty_counts_per_degree() {
        let mut config = Config::default();
        config.vehicle.interface = oqtal_config::Interface::Attitude;
        let mut protocol = Asctec::new(&config).unwrap();
        // 10 degrees about x, independent of the rate sticks; 0.1 of 2 rad/s is 11.46 deg/s, at 120 mdeg/s 95.5 counts.
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
