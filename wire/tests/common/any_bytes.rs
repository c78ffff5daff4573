//! Properties of the decoders for arbitrary bytes, shared by the property tests and the fuzz targets.

use std::cell::Cell;
use std::fmt::Debug;
use std::marker::PhantomData;

use oqtal_wire::stream::{Decoder, Grammar, Verdict};
use oqtal_wire::xbee::{Address, Api1Grammar, Api2Grammar, Carrier, Framing, RadioEvent, Side};

/// Greatest number of inspections per byte; each inspection reads the bytes of at most one frame.
const LOOKS_PER_BYTE: usize = 10;

thread_local! {
    static LOOKS: Cell<usize> = const { Cell::new(0) };
}

/// Grammar that counts its inspections.
struct CountedInspections<G>(PhantomData<G>);

impl<G: Grammar> Grammar for CountedInspections<G> {
    type Event = G::Event;

    const START: u8 = G::START;

    fn inspect(bytes: &[u8]) -> Verdict<G::Event> {
        LOOKS.set(LOOKS.get() + 1);
        assert_eq!(bytes[0], G::START);
        G::inspect(bytes)
    }
}

/// Checks: no panic, bounded work, every byte counted, and the same events whether the bytes arrive at once or one by one.
pub fn any_bytes<G: Grammar>(bytes: &[u8])
where
    G::Event: PartialEq + Debug,
{
    LOOKS.set(0);
    let mut at_once = Decoder::<CountedInspections<G>>::new();
    let events: Vec<G::Event> = at_once.push(bytes).collect();
    let looks = LOOKS.get();
    assert!(looks <= LOOKS_PER_BYTE * bytes.len(), "{looks} looks at {} bytes", bytes.len());

    let counters = at_once.counters();
    let outside = counters.skipped as usize + at_once.pending();
    assert!(outside <= bytes.len() && counters.frames as usize >= events.len());
    assert!(counters.frames as usize <= bytes.len() - outside, "frames without bytes");

    let mut one_by_one = Decoder::<CountedInspections<G>>::new();
    let mut others = Vec::new();
    bytes.chunks(1).for_each(|byte| others.extend(one_by_one.push(byte)));
    assert_eq!((events, counters), (others, one_by_one.counters()));

    at_once.reset();
    assert_eq!((at_once.pending(), at_once.counters().skipped as usize), (0, outside));
}

/// Checks as [`any_bytes`] for both API modes, and carriers of every framing.
pub fn any_radio_bytes(bytes: &[u8]) {
    any_bytes::<Api1Grammar>(bytes);
    any_bytes::<Api2Grammar>(bytes);
    for framing in [Framing::Transparent, Framing::Api1, Framing::Api2] {
        for side in [Side::Host, Side::Radio] {
            let mut carrier = Carrier::new(framing, side, Address::BROADCAST);
            let payload: usize = carrier
                .push(bytes)
                .map(|arrival| match arrival {
                    RadioEvent::Payload { payload, .. } => payload.len(),
                    RadioEvent::Delivery { .. } | RadioEvent::Modem(_) => 0,
                })
                .sum();
            let whole = payload == bytes.len();
            assert!(if framing == Framing::Transparent { whole } else { payload <= bytes.len() });
        }
    }
}
