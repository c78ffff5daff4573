//! The common data representation (CDR) of ROS 2, little-endian: four bytes of encapsulation, then the fields, each aligned to
//! its size.

use oqtal_bus::message::{AnyMessage, Field, FieldType, Header, Message, Stamps};

/// Encapsulation of plain little-endian CDR.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Words of a header and its stamps \[-\].
const HEADER_WORDS: usize = Header::FIELDS.len() + Stamps::FIELDS.len();

/// Writer of an encoded message.
#[derive(Debug)]
pub struct CdrWriter<'a>(&'a mut Vec<u8>);

impl<'a> CdrWriter<'a> {
    /// Begins a message in `bytes`; clears `bytes` first.
    pub fn begin(bytes: &'a mut Vec<u8>) -> Self {
        bytes.clear();
        bytes.extend_from_slice(&ENCAPSULATION);
        Self(bytes)
    }

    /// Pads to a multiple of `size` bytes after the encapsulation.
    fn align(&mut self, size: usize) {
        let length = (self.0.len() - ENCAPSULATION.len()).next_multiple_of(size);
        self.0.resize(length + ENCAPSULATION.len(), 0);
    }

    /// Appends an element, given by its little-endian bytes.
    fn element(&mut self, bytes: &[u8]) {
        self.align(bytes.len());
        self.0.extend_from_slice(bytes);
    }

    /// Appends a byte.
    pub fn u8(&mut self, value: u8) {
        self.0.push(value);
    }

    /// Appends an unsigned integer of 32 bits.
    pub fn u32(&mut self, value: u32) {
        self.element(&value.to_le_bytes());
    }

    /// Appends an unsigned integer of 64 bits.
    pub fn u64(&mut self, value: u64) {
        self.element(&value.to_le_bytes());
    }

    /// Appends numbers one after another.
    pub fn numbers(&mut self, values: &[f64]) {
        for value in values {
            self.element(&value.to_le_bytes());
        }
    }

    /// Appends a text: its length including the final zero, its bytes, the zero.
    pub fn text(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.0.extend_from_slice(text.as_bytes());
        self.0.push(0);
    }

    /// Appends an instant as seconds and nanoseconds \[ns since the epoch\].
    pub fn instant(&mut self, nanos: u64) {
        self.u32((nanos / 1_000_000_000) as u32);
        self.u32((nanos % 1_000_000_000) as u32);
    }
}

/// Encodes a message with its header into `bytes`; clears `bytes` first.
pub fn encode(header: &Header, body: &dyn AnyMessage, bytes: &mut Vec<u8>) {
    let mut writer = CdrWriter::begin(bytes);
    let Header { sequence, pose_sequence, schema, source, stamps } = header;
    for word in [*sequence, *pose_sequence, *schema, *source].into_iter().chain(stamps.to_words()) {
        writer.u64(word);
    }
    let packed = body.packed();
    let mut rest = packed.as_slice();
    for size in elements(body.fields()) {
        let (element, behind) = rest.split_at(size);
        writer.element(element);
        rest = behind;
    }
}

/// Decodes a message encoded by [`encode`]; `None` if the length or encapsulation of `bytes` is wrong.
pub fn decode<M: Message>(bytes: &[u8]) -> Option<(Header, M)> {
    let bytes = bytes.strip_prefix(&ENCAPSULATION)?;
    let (words, _) = bytes.get(..8 * HEADER_WORDS)?.as_chunks::<8>();
    let mut words = words.iter().map(|word| u64::from_le_bytes(*word));
    let mut word = || words.next().unwrap_or_default();
    let header = Header {
        sequence: word(),
        pose_sequence: word(),
        schema: word(),
        source: word(),
        stamps: Stamps::from_words(std::array::from_fn(|_| word())),
    };
    let mut packed = Vec::with_capacity(M::SIZE);
    let mut at = 8 * HEADER_WORDS;
    for size in elements(M::FIELDS) {
        at = at.next_multiple_of(size);
        packed.extend_from_slice(bytes.get(at..at + size)?);
        at += size;
    }
    (at == bytes.len()).then(|| (header, M::decode(&packed)))
}

/// Sizes of the elements of `fields`, in order \[bytes\].
fn elements(fields: &[Field]) -> impl Iterator<Item = usize> {
    fields
        .iter()
        .flat_map(|field| std::iter::repeat_n(FieldType::size(field.element), field.length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::message::{InputV1, PoseV1, TelemetryV1};
    use oqtal_bus::time::Time;

    fn header() -> Header {
        let stamps = Stamps::from_words([1, 2, 3, 4, 5, 6, 7, u64::MAX]);
        Header { sequence: 11, pose_sequence: 12, schema: 13, source: 14, stamps }
    }

    #[test]
    fn a_message_survives_bit_for_bit_nan_included() {
        let signalling = f64::from_bits(0x7ff0_0000_0000_0001);
        let telemetry = TelemetryV1 {
            time: Time::from_nanos(7),
            mission_s: signalling,
            position: [-0.0, f64::INFINITY, 5e-324],
            saturated: 1,
            ..TelemetryV1::default()
        };
        let mut bytes = Vec::new();
        encode(&header(), &telemetry, &mut bytes);
        let (read, back) = decode::<TelemetryV1>(&bytes).unwrap();
        assert_eq!(read, header());
        let (mut before, mut after) = ([0; TelemetryV1::SIZE], [0; TelemetryV1::SIZE]);
        telemetry.encode(&mut before);
        back.encode(&mut after);
        assert_eq!(before, after);
    }

    #[test]
    fn fields_are_aligned_behind_the_encapsulation() {
        let mut bytes = Vec::new();
        CdrWriter::begin(&mut bytes).u8(1);
        let mut writer = CdrWriter(&mut bytes);
        writer.u32(2);
        writer.text("ab");
        writer.numbers(&[1.0]);
        assert_eq!(bytes[..8], [0, 1, 0, 0, 1, 0, 0, 0]);
        assert_eq!(bytes[8..19], [2, 0, 0, 0, 3, 0, 0, 0, b'a', b'b', 0]);
        assert_eq!(bytes[20..], 1.0_f64.to_le_bytes());
    }

    #[test]
    fn other_bytes_are_not_a_message() {
        let mut bytes = Vec::new();
        encode(&header(), &PoseV1::default(), &mut bytes);
        assert!(decode::<InputV1>(&bytes).is_none());
        for length in 0..bytes.len() {
            assert!(decode::<PoseV1>(&bytes[..length]).is_none());
        }
    }
}
