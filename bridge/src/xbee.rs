//! XBee radio in API mode as a transport: every frame is one packet of the radio, framed for its serial port.
//!
//! Requests carry the id 0, for which a radio reports no delivery: the vehicle's own acknowledgements suffice, and each report
//! would occupy the line.

use oqtal_wire::xbee::{Address, Carrier, Framing, MAX_PAYLOAD, MAX_WIRE, RadioEvent, Side};

use crate::protocol::{MAX_FRAME, VehicleFrame};
use crate::transport::{VehicleTransport, serial_byte_rate};

const _: () = assert!(MAX_WIRE <= MAX_FRAME);

/// Packets of an XBee in API mode over a serial line.
#[derive(Debug)]
pub struct XbeeTransport {
    carrier: Carrier,
    baud: u32,
}

impl XbeeTransport {
    /// Transport to the radio `peer`, through a radio at `baud` whose serial port is framed by `framing`.
    pub fn new(framing: Framing, peer: Address, baud: u32) -> Self {
        Self { carrier: Carrier::new(framing, Side::Host, peer), baud }
    }
}

impl VehicleTransport for XbeeTransport {
    fn max_frame(&self) -> usize {
        MAX_PAYLOAD
    }

    fn overhead(&self) -> usize {
        self.carrier.overhead()
    }

    fn byte_rate(&self) -> Option<f64> {
        Some(serial_byte_rate(self.baud))
    }

    fn wrap(&mut self, frame: &VehicleFrame) -> VehicleFrame {
        let wrapped = self.carrier.wrap(0, frame.bytes());
        wrapped.map_or(VehicleFrame::EMPTY, |wire| VehicleFrame::of(wire.as_bytes()))
    }

    fn unwrap(&mut self, bytes: &[u8], payload: &mut dyn FnMut(&[u8])) {
        for event in self.carrier.push(bytes) {
            if let RadioEvent::Payload { payload: packet, .. } = event {
                payload(&packet);
            }
        }
    }

    fn damaged(&self) -> u64 {
        self.carrier.counters().damaged
    }

    fn reset(&mut self) {
        self.carrier.reset();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: [u8; 17] = [b'>'; 17];

    #[test]
    fn the_radio_at_the_other_end_unwraps_the_frame_and_is_unwrapped() {
        for framing in [Framing::Api1, Framing::Api2] {
            let peer = Address::BROADCAST;
            let mut near = XbeeTransport::new(framing, peer, 57_600);
            let mut far = Carrier::new(framing, Side::Radio, peer);
            let wrapped = near.wrap(&VehicleFrame::of(&FRAME));
            assert_eq!(wrapped.bytes().len(), FRAME.len() + near.overhead());
            let mut sent = Vec::new();
            for event in far.push(wrapped.bytes()) {
                let RadioEvent::Payload { payload, .. } = event else { panic!("{event:?}") };
                sent.extend_from_slice(&payload);
            }
            assert_eq!(sent, FRAME, "{framing}");
            let answer = far.wrap(0, b">a\x17a<").unwrap();
            let mut received = Vec::new();
            near.unwrap(answer.as_bytes(), &mut |packet| received.extend_from_slice(packet));
            assert_eq!(received, b">a\x17a<", "{framing}");
        }
    }

    #[test]
    fn a_frame_longer_than_a_packet_is_not_sent() {
        let mut transport = XbeeTransport::new(Framing::Api1, Address::BROADCAST, 57_600);
        let longest = transport.max_frame();
        assert!(!transport.wrap(&VehicleFrame::of(&vec![0; longest])).bytes().is_empty());
        assert!(transport.wrap(&VehicleFrame::of(&vec![0; longest + 1])).bytes().is_empty());
    }
}
