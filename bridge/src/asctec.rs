//! AscTec's Hummingbird in terms of orders and answers. Bytes, checksums and scales are `oqtal-wire`'s.
//!
//! A neutral frame takes all four axes from here, centred and without thrust: the remote control then has no say in them, but its channel 5
//! takes the serial interface away (manual, p. 17), and so is the pilot's last line.

use oqtal_bus::message::CommandV1;
use oqtal_wire::asctec::{
    ControlInput, Descriptor, EMERGENCY_STOP, HostDecoder, HostEvent, LlStatus, Poll, Scales,
    Status, Sticks, acknowledgement_frame, poll_frame,
};

use crate::language::{Frame, Heard, Language, Sizes};
use crate::safety::Order;

/// Head, length, descriptor, checksum and tail around a telemetry payload \[bytes\].
const ENVELOPE: usize = 11;

/// The language of AscTec's serial interface.
#[derive(Debug)]
pub struct Asctec {
    scales: Scales,
    decoder: HostDecoder,
}

impl Asctec {
    /// With counts that mean what `scales` say.
    #[must_use]
    pub fn new(scales: Scales) -> Self {
        Self { scales, decoder: HostDecoder::new() }
    }
}

impl Language for Asctec {
    fn sizes(&self) -> Sizes {
        Sizes {
            order: ControlInput::FRAME_LEN,
            acknowledgement: acknowledgement_frame(Descriptor::ControlInput).len(),
            poll: poll_frame(Poll::LL_STATUS).len(),
            status: Descriptor::LlStatus.payload_len() + ENVELOPE,
        }
    }

    fn order(&mut self, order: &Order) -> Frame {
        let input = match order {
            Order::Neutral => ControlInput::NEUTRAL,
            Order::Fly(command) => self.scales.encode(&sticks(command)),
            // The same frame: a toggle.
            Order::StartMotors | Order::StopMotors => self.scales.motor_switch(),
        };
        Frame::of(&input.frame())
    }

    fn poll(&mut self) -> Frame {
        Frame::of(&poll_frame(Poll::LL_STATUS))
    }

    fn emergency_stop(&mut self) -> Frame {
        Frame::of(&EMERGENCY_STOP)
    }

    fn hear(&mut self, bytes: &[u8], heard: &mut dyn FnMut(Heard)) {
        for event in self.decoder.push(bytes) {
            heard(match event {
                HostEvent::Acknowledged(Descriptor::ControlInput) => Heard::Acknowledged,
                HostEvent::LlStatus(status) => status_of(status),
                _ => Heard::Other,
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

fn status_of(status: LlStatus) -> Heard {
    let Status { battery_v, motors_on, .. } = Status::from(status);
    Heard::Status { battery_v, motors_run: motors_on }
}

/// What a command asks for, in the vehicle's terms.
fn sticks(command: &CommandV1) -> Sticks {
    let [roll, pitch, yaw] = command.sticks;
    Sticks { roll, pitch, yaw, thrust: command.thrust }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::config::Config;
    use oqtal_wire::asctec::{Command, VehicleDecoder, write_telemetry};

    fn language() -> Asctec {
        Asctec::new(Config::default().bridge.asctec)
    }

    #[test]
    fn frames_are_as_long_as_they_say() {
        let mut language = language();
        let sizes = language.sizes();
        for order in [Order::Neutral, Order::StartMotors, Order::Fly(CommandV1::default())] {
            assert_eq!(language.order(&order).bytes().len(), sizes.order);
        }
        assert_eq!(language.poll().bytes().len(), sizes.poll);
        let mut answer = [0; 64];
        let length = write_telemetry(Descriptor::LlStatus, &[0; 16], &mut answer);
        assert_eq!(length, Some(sizes.status));
    }

    #[test]
    fn the_vehicle_reads_what_was_ordered() {
        let mut language = language();
        let command = CommandV1 { sticks: [0.5, -0.25, 0.1], thrust: 0.25, ..CommandV1::default() };
        let mut decoder = VehicleDecoder::new();
        let frame = language.order(&Order::Fly(command));
        let heard: Vec<Command> = decoder.push(frame.bytes()).collect();
        let [Command::Control(input)] = heard[..] else { panic!("{heard:?}") };
        let read = Config::default().bridge.asctec.decode(&input);
        let resolution = 1.0 / 2047.0;
        for (read, sent) in [read.roll, read.pitch, read.yaw].into_iter().zip(command.sticks) {
            assert!((read - sent).abs() <= resolution);
        }
        assert!((read.thrust - 0.25).abs() <= resolution);
    }
}
