//! XBee radios around a vehicle's protocol: what goes out is framed for the radio, what comes in is taken out of its frames.
//!
//! Requests carry the id 0, which asks for no report of their delivery: the vehicle's own acknowledgements say more, and each
//! report would take the line's time.

use oqtal_wire::xbee::{Address, Carrier, Framing, RadioEvent, Side};

use crate::protocol::{FrameSizes, VehicleFrame, VehicleProtocol, VehicleReply};
use crate::safety::VehicleSetpoint;

/// A protocol that goes through a radio.
#[derive(Debug)]
struct XbeeTransport {
    carrier: Carrier,
    inner: Box<dyn VehicleProtocol>,
}

/// `protocol` as it goes through a radio that frames like this, to the radio `peer`.
#[must_use]
pub fn through(
    framing: Framing,
    peer: Address,
    inner: Box<dyn VehicleProtocol>,
) -> Box<dyn VehicleProtocol> {
    match framing {
        Framing::Transparent => inner,
        Framing::Api1 | Framing::Api2 => {
            Box::new(XbeeTransport { carrier: Carrier::new(framing, Side::Host, peer), inner })
        }
    }
}

impl XbeeTransport {
    fn wrap(&self, frame: &VehicleFrame) -> VehicleFrame {
        // Every frame of a vehicle fits into a packet of the radio; one that did not would be none.
        self.carrier
            .wrap(0, frame.bytes())
            .map_or_else(|_| VehicleFrame::default(), |wire| VehicleFrame::of(wire.as_bytes()))
    }
}

impl VehicleProtocol for XbeeTransport {
    fn sizes(&self) -> FrameSizes {
        let (inner, overhead) = (self.inner.sizes(), self.carrier.overhead());
        FrameSizes {
            setpoint: inner.setpoint + overhead,
            acknowledgement: inner.acknowledgement + overhead,
            poll: inner.poll + overhead,
            status: inner.status + overhead,
        }
    }

    fn setpoint(&mut self, setpoint: &VehicleSetpoint) -> VehicleFrame {
        let frame = self.inner.setpoint(setpoint);
        self.wrap(&frame)
    }

    fn poll(&mut self) -> VehicleFrame {
        let frame = self.inner.poll();
        self.wrap(&frame)
    }

    fn emergency_stop(&mut self) -> VehicleFrame {
        let frame = self.inner.emergency_stop();
        self.wrap(&frame)
    }

    fn hear(&mut self, bytes: &[u8], reply: &mut dyn FnMut(VehicleReply)) {
        let Self { carrier, inner } = self;
        for arrival in carrier.push(bytes) {
            if let RadioEvent::Payload { payload, .. } = arrival {
                inner.hear(&payload, reply);
            }
        }
    }

    fn damaged(&self) -> u64 {
        self.carrier.counters().damaged + self.inner.damaged()
    }

    fn forget(&mut self) {
        self.carrier.reset();
        self.inner.forget();
    }
}

#[cfg(test)]
mod tests {
    use oqtal_config::Config;
    use oqtal_wire::asctec::{ControlInput, HostCommand, VehicleDecoder};

    use super::*;
    use crate::asctec::Asctec;

    #[test]
    fn a_vehicle_behind_a_radio_reads_what_was_ordered_and_is_heard() {
        let config = Config::default();
        for framing in [Framing::Transparent, Framing::Api1, Framing::Api2] {
            let peer = Address::BROADCAST;
            let mut near = through(framing, peer, Box::new(Asctec::new(&config).unwrap()));
            let mut far = Carrier::new(framing, Side::Radio, peer);
            let frame = near.setpoint(&VehicleSetpoint::Zero);
            let mut decoder = VehicleDecoder::new();
            let mut read = Vec::new();
            for arrival in far.push(frame.bytes()) {
                let RadioEvent::Payload { payload, .. } = arrival else { panic!("{arrival:?}") };
                read.extend(decoder.push(&payload));
            }
            assert_eq!(read, [HostCommand::Control(ControlInput::ZERO_SETPOINT)], "{framing}");
            let answer = far.wrap(0, b">a\x17a<").unwrap();
            let mut reply = Vec::new();
            near.hear(answer.as_bytes(), &mut |what| reply.push(what));
            assert_eq!(reply, [VehicleReply::Acknowledged], "{framing}");
        }
    }
}
