//! Grammars of API frames.

use super::frame::{ApiFrame, ApiFrameError};
use super::packet::{ApiPacket, MAX_DATA, START, Unescaped};
use crate::stream::{Decoder, Grammar, Verdict};

/// Length of start byte and length field \[bytes\].
const HEAD: usize = 3;

/// Grammar of API mode 1.
#[derive(Clone, Copy, Debug)]
pub struct Api1Grammar;

/// Decoder of API mode 1.
pub type Api1Decoder = Decoder<Api1Grammar>;

/// Grammar of API mode 2.
#[derive(Clone, Copy, Debug)]
pub struct Api2Grammar;

/// Decoder of API mode 2.
pub type Api2Decoder = Decoder<Api2Grammar>;

impl Grammar for Api1Grammar {
    type Event = ApiFrame;

    const START: u8 = START;

    fn inspect(bytes: &[u8]) -> Verdict<ApiFrame> {
        let Some(&[_, high, low]) = bytes.first_chunk::<HEAD>() else {
            return Verdict::Wait(HEAD);
        };
        let Some(total) = total(high, low) else { return Verdict::Noise };
        match bytes.get(..total) {
            None => Verdict::Wait(total),
            Some(frame) => check(frame, total),
        }
    }
}

impl Grammar for Api2Grammar {
    type Event = ApiFrame;

    const START: u8 = START;

    fn inspect(bytes: &[u8]) -> Verdict<ApiFrame> {
        let Ok(head) = Unescaped::read(bytes, HEAD) else { return Verdict::Noise };
        let &[_, high, low] = head.as_bytes() else {
            return Verdict::Wait(bytes.len() + HEAD - head.as_bytes().len());
        };
        let Some(total) = total(high, low) else { return Verdict::Noise };
        let Ok(frame) = Unescaped::read(bytes, total) else { return Verdict::Damaged };
        // Every missing byte takes at least one byte on the wire, so the wait is never too long; each inspection leaves at most
        // half.
        match total - frame.as_bytes().len() {
            0 => check(frame.as_bytes(), frame.read),
            missing => Verdict::Wait(bytes.len() + missing),
        }
    }
}

/// Length of a frame without escapes by its length field \[bytes\]; `None` if no known frame has such a length.
fn total(high: u8, low: u8) -> Option<usize> {
    let length = usize::from(u16::from_be_bytes([high, low]));
    (1..=MAX_DATA).contains(&length).then_some(HEAD + length + 1)
}

/// Checks a frame without escapes that took `taken` bytes on the wire.
fn check(frame: &[u8], taken: usize) -> Verdict<ApiFrame> {
    let Ok(packet) = ApiPacket::new_checked(frame) else { return Verdict::Damaged };
    match ApiFrame::parse(&packet) {
        Ok(frame) => Verdict::Accept(taken, Some(frame)),
        Err(ApiFrameError::Kind(_)) => Verdict::Accept(taken, None),
        Err(ApiFrameError::Length { .. }) => Verdict::Damaged,
    }
}
