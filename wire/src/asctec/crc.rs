//! CRC of telemetry frames.

use crc::{Algorithm, Crc};

/// Parameters of the firmware's CRC. Its register starts at 0x00FF and is shifted to the right, which is `init` 0xFF00 in the notation of
/// the CRC catalogue; the catalogue has several CRCs of this polynomial, but none with this initial value.
const ASCTEC: Algorithm<u16> = Algorithm {
    width: 16,
    poly: 0x1021,
    init: 0xFF00,
    refin: true,
    refout: true,
    xorout: 0,
    check: 0x9DB8,
    residue: 0,
};

const CRC: Crc<u16> = Crc::<u16>::new(&ASCTEC);

/// CRC of a telemetry payload; head, length and descriptor are not covered.
pub fn crc16(payload: &[u8]) -> u16 {
    CRC.checksum(payload)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The update as AscTec's manual and both drivers write it, byte by byte.
    fn as_published(payload: &[u8]) -> u16 {
        payload.iter().fold(0x00FF_u16, |crc, byte| {
            let mut data = byte ^ crc.to_le_bytes()[0];
            data ^= data << 4;
            let data = u16::from(data);
            ((data << 8) | (crc >> 8)) ^ (data >> 4) ^ (data << 3)
        })
    }

    #[test]
    fn check_value_is_that_of_the_firmware() {
        assert_eq!(crc16(b"123456789"), 0x9DB8);
        assert_eq!(crc16(b"123456789"), ASCTEC.check);
    }

    proptest! {
        #[test]
        fn parameters_describe_the_published_update(payload: Vec<u8>) {
            prop_assert_eq!(crc16(&payload), as_published(&payload));
        }
    }
}
