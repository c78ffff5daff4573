//! XBee radios around a vehicle's language: what goes out is framed for the radio, what comes in is taken out of its frames.
//!
//! Requests carry the id 0, which asks for no report of their delivery: the vehicle's own acknowledgements say more, and each
//! report would take the line's time.

use oqtal_wire::xbee::{Address, Arrival, Carrier, Framing, Side};

use crate::language::{Frame, Heard, Language, Sizes};
use crate::safety::Order;

/// A language that goes through a radio.
#[derive(Debug)]
struct Radio {
    carrier: Carrier,
    inner: Box<dyn Language>,
}

/// `language` as it goes through a radio that frames like this, to the radio `peer`.
#[must_use]
pub fn through(framing: Framing, peer: Address, inner: Box<dyn Language>) -> Box<dyn Language> {
    match framing {
        Framing::Transparent => inner,
        Framing::Api1 | Framing::Api2 => {
            Box::new(Radio { carrier: Carrier::new(framing, Side::Host, peer), inner })
        }
    }
}

impl Radio {
    fn wrap(&self, frame: &Frame) -> Frame {
        // Every frame of a vehicle fits into a packet of the radio; one that did not would be none.
        self.carrier
            .wrap(0, frame.bytes())
            .map_or_else(|_| Frame::default(), |wire| Frame::of(wire.as_bytes()))
    }
}

impl Language for Radio {
    fn sizes(&self) -> Sizes {
        let (inner, overhead) = (self.inner.sizes(), self.carrier.overhead());
        Sizes {
            order: inner.order + overhead,
            acknowledgement: inner.acknowledgement + overhead,
            poll: inner.poll + overhead,
            status: inner.status + overhead,
        }
    }

    fn order(&mut self, order: &Order) -> Frame {
        let frame = self.inner.order(order);
        self.wrap(&frame)
    }

    fn poll(&mut self) -> Frame {
        let frame = self.inner.poll();
        self.wrap(&frame)
    }

    fn emergency_stop(&mut self) -> Frame {
        let frame = self.inner.emergency_stop();
        self.wrap(&frame)
    }

    fn hear(&mut self, bytes: &[u8], heard: &mut dyn FnMut(Heard)) {
        let Self { carrier, inner } = self;
        for arrival in carrier.push(bytes) {
            if let Arrival::Payload { payload, .. } = arrival {
                inner.hear(&payload, heard);
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
    use oqtal_bus::config::Config;
    use oqtal_wire::asctec::{Command, ControlInput, VehicleDecoder};

    use super::*;
    use crate::asctec::Asctec;

    #[test]
    fn a_vehicle_behind_a_radio_reads_what_was_ordered_and_is_heard() {
        let config = Config::default();
        for framing in [Framing::Transparent, Framing::Api1, Framing::Api2] {
            let peer = Address::BROADCAST;
            let mut near = through(framing, peer, Box::new(Asctec::new(&config)));
            let mut far = Carrier::new(framing, Side::Radio, peer);
            let frame = near.order(&Order::Neutral);
            let mut decoder = VehicleDecoder::new();
            let mut read = Vec::new();
            for arrival in far.push(frame.bytes()) {
                let Arrival::Payload { payload, .. } = arrival else { panic!("{arrival:?}") };
                read.extend(decoder.push(&payload));
            }
            assert_eq!(read, [Command::Control(ControlInput::NEUTRAL)], "{framing}");
            let answer = far.wrap(0, b">a\x17a<").unwrap();
            let mut heard = Vec::new();
            near.hear(answer.as_bytes(), &mut |what| heard.push(what));
            assert_eq!(heard, [Heard::Acknowledged], "{framing}");
        }
    }
}
