//! Records as bytes.

use std::collections::BTreeMap;

use super::Opcode;

/// Fields of a record, appended to bytes.
pub trait Fields {
    /// Appends 64-bit numbers.
    fn u64s(&mut self, values: &[u64]);
    /// Appends a text preceded by its length.
    fn text(&mut self, text: &str);
    /// Appends the fields written by `write`, preceded by their total length \[bytes\] as a 32-bit number.
    fn sized(&mut self, write: impl FnOnce(&mut Vec<u8>));
    /// Appends a table of texts.
    fn map(&mut self, entries: &BTreeMap<String, String>);
    /// Appends a record; `write` appends its body.
    fn record(&mut self, opcode: Opcode, write: impl FnOnce(&mut Vec<u8>));
}

impl Fields for Vec<u8> {
    fn u64s(&mut self, values: &[u64]) {
        self.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    }

    fn text(&mut self, text: &str) {
        self.sized(|bytes| bytes.extend_from_slice(text.as_bytes()));
    }

    fn sized(&mut self, write: impl FnOnce(&mut Vec<u8>)) {
        let begin = self.len() + 4;
        self.extend([0; 4]);
        write(self);
        let length = (self.len() - begin) as u32;
        self[begin - 4..begin].copy_from_slice(&length.to_le_bytes());
    }

    fn map(&mut self, entries: &BTreeMap<String, String>) {
        self.sized(|bytes| {
            for (key, value) in entries {
                bytes.text(key);
                bytes.text(value);
            }
        });
    }

    fn record(&mut self, opcode: Opcode, write: impl FnOnce(&mut Vec<u8>)) {
        self.push(opcode as u8);
        let begin = self.len() + 8;
        self.extend([0; 8]);
        write(self);
        let length = (self.len() - begin) as u64;
        self[begin - 8..begin].copy_from_slice(&length.to_le_bytes());
    }
}
