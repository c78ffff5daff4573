//! Mutations of valid examples.

use crate::random::Random;

/// Numbers at the limits of their types.
const LIMITS: [u64; 8] =
    [0, 1, 0x7f, 0xff, 0x7fff_ffff, 0xffff_ffff, 0x7fff_ffff_ffff_ffff, u64::MAX];
/// Texts with a meaning to the parsers of text.
const TOKENS: [&str; 14] =
    ["0", "-1", "9", "999999999", "1e308", "-1e-320", "nan", "inf", "[", "{", "\"", "\n", ",", "="];

/// `example` with one to eight mutations.
pub fn mutated(random: &mut Random, example: &[u8]) -> Vec<u8> {
    let mut bytes = example.to_vec();
    for _ in 0..=random.below(8) {
        mutate(random, &mut bytes);
    }
    bytes
}

fn mutate(random: &mut Random, bytes: &mut Vec<u8>) {
    let at = random.below(bytes.len() as u64 + 1) as usize;
    let end = bytes.len().min(at + 1 + random.below(64) as usize);
    match random.below(7) {
        0 => bytes.truncate(at),
        1 => drop(bytes.drain(at..end)),
        2 => {
            let copy = bytes[at..end].to_vec();
            let to = random.below(bytes.len() as u64 + 1) as usize;
            bytes.splice(to..to, copy);
        }
        3 => {
            let token = random.pick(&TOKENS).repeat(1 + random.below(4) as usize);
            bytes.splice(at..end.min(at + token.len()), token.into_bytes());
        }
        4 => {
            let limit = random.pick(&LIMITS).to_le_bytes();
            let size = random.pick(&[2, 4, 8]).min(end - at);
            bytes[at..at + size].copy_from_slice(&limit[..size]);
        }
        _ => bytes[at..end].iter_mut().take(1).for_each(|byte| *byte = random.below(256) as u8),
    }
}
