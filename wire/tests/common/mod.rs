//! Helpers of the tests of this crate.

pub mod any_bytes;
pub mod any_camera_bytes;
pub mod any_crtp_bytes;
pub mod crtp_examples;
pub mod scene;

use oqtal_wire::stream::{Decoder, DecoderCounters, Grammar};
use proptest::prelude::*;

/// Bytes of hexadecimal digits; spaces are ignored.
pub fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u32> = text.chars().filter_map(|digit| digit.to_digit(16)).collect();
    digits.chunks_exact(2).map(|pair| (pair[0] * 16 + pair[1]) as u8).collect()
}

/// Events of a stream that arrives at once.
pub fn decode<G: Grammar>(stream: &[u8]) -> (Vec<G::Event>, DecoderCounters) {
    let mut decoder = Decoder::<G>::new();
    let events = decoder.push(stream).collect();
    (events, decoder.counters())
}

/// Events of a stream that arrives in pieces of these lengths, and then the rest.
pub fn decode_in_pieces<G: Grammar>(
    stream: &[u8],
    pieces: &[usize],
) -> (Vec<G::Event>, DecoderCounters) {
    let mut decoder = Decoder::<G>::new();
    let (mut events, mut rest) = (Vec::new(), stream);
    for length in pieces {
        let (piece, after) = rest.split_at((*length).min(rest.len()));
        events.extend(decoder.push(piece));
        rest = after;
    }
    events.extend(decoder.push(rest));
    (events, decoder.counters())
}

/// Whether `wanted` occur in `found`, in this order.
pub fn in_order<E: PartialEq>(wanted: &[E], found: &[E]) -> bool {
    let mut found = found.iter();
    wanted.iter().all(|event| found.any(|other| other == event))
}

/// Noise of random bytes and of bytes with a meaning to the decoders, in any order.
pub fn noise() -> impl Strategy<Value = Vec<u8>> {
    let telling = b">*adipme<#\x00\x02\x03\x10\x11\x13\x17\x5c\x5d\x5e\x7d\x7e\x81\x90".to_vec();
    prop::collection::vec(prop_oneof![any::<u8>(), prop::sample::select(telling)], 0..150)
}
