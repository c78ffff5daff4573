//! Attitude in 32 bits: the index of the largest component, and the others by sign and nine bits.

use std::f64::consts::FRAC_1_SQRT_2;

/// Greatest magnitude of a component \[-\].
const FULL: u32 = (1 << 9) - 1;

/// Compresses the unit quaternion `[x, y, z, w]` \[-\]; the attitude is kept to 0.28 degrees. If all components are equal and three of them
/// have an error of half a step with the same sign, the largest one has an error of three halves of a step.
pub fn compress(quaternion: [f64; 4]) -> u32 {
    let magnitude = |index: &usize| quaternion[*index].abs();
    // The first of equal ones, as every other implementation has it.
    let largest = (0..4).rev().max_by(|a, b| magnitude(a).total_cmp(&magnitude(b))).unwrap_or(3);
    let negate = quaternion[largest] < 0.0;
    let others = (0..4).filter(|index| *index != largest);
    others.fold(largest as u32, |compressed, index| {
        let counts = f64::from(FULL) * (magnitude(&index) / FRAC_1_SQRT_2) + 0.5;
        let sign = u32::from((quaternion[index] < 0.0) != negate);
        compressed << 10 | sign << 9 | (counts as u32).min(FULL)
    })
}

/// Returns the unit quaternion `[x, y, z, w]` \[-\] for `compressed`.
pub fn decompress(compressed: u32) -> [f64; 4] {
    let largest = (compressed >> 30) as usize;
    let (mut quaternion, mut rest, mut squares) = ([0.0; 4], compressed, 0.0);
    for index in (0..4).rev().filter(|index| *index != largest) {
        let magnitude = f64::from(rest & FULL) / f64::from(FULL) * FRAC_1_SQRT_2;
        let sign = if rest >> 9 & 1 == 1 { -1.0 } else { 1.0 };
        quaternion[index] = sign * magnitude;
        squares += magnitude * magnitude;
        rest >>= 10;
    }
    // Damaged bits can encode three components whose squares exceed one.
    quaternion[largest] = (1.0_f64 - squares).max(0.0).sqrt();
    let norm = squares.max(1.0).sqrt();
    quaternion.map(|component| component / norm)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn an_attitude_is_kept_within_half_a_step_of_each_component(components in prop::array::uniform4(-1.0..1.0_f64)) {
            let norm = components.iter().map(|c| c * c).sum::<f64>().sqrt();
            prop_assume!(norm > 0.1);
            let quaternion = components.map(|c| c / norm);
            let read = decompress(compress(quaternion));
            let cosine: f64 = quaternion.iter().zip(read).map(|(a, b)| a * b).sum();
            let half_step = 0.5 * FRAC_1_SQRT_2 / f64::from(FULL);
            let bound = 2.0 * half_step * (3.0_f64 + 9.0).sqrt();
            let error = 2.0 * cosine.abs().min(1.0).acos();
            prop_assert!(error < 1.01 * bound && bound < 0.28_f64.to_radians(), "{error} rad, {bound} rad");
        }

        #[test]
        fn every_decoded_quaternion_has_unit_norm(compressed: u32) {
            let norm: f64 = decompress(compressed).iter().map(|c| c * c).sum();
            prop_assert!((norm - 1.0).abs() < 1e-9);
        }
    }
}
