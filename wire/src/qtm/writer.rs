//! Writer of packets.

use std::fmt::Display;

use super::event::QtmEvent;
use crate::bytes::{ByteOrder, ByteWriter, count_u32};

/// Appends packets to a buffer.
#[derive(Debug)]
pub struct QtmWriter<'a> {
    out: &'a mut Vec<u8>,
    order: ByteOrder,
}

impl<'a> QtmWriter<'a> {
    /// Writer to the end of `out`.
    pub fn new(out: &'a mut Vec<u8>, order: ByteOrder) -> Self {
        Self { out, order }
    }

    /// Writes an error.
    pub fn error(&mut self, reason: &str) {
        self.content(0, |writer| {
            writer.text(reason);
        });
    }

    /// Writes a command or its answer.
    pub fn command(&mut self, text: impl Display) {
        self.content(1, |writer| {
            writer.display(text);
        });
    }

    /// Writes parameters.
    pub fn xml(&mut self, text: &str) {
        self.content(2, |writer| {
            writer.text(text);
        });
    }

    /// Writes the packet for missing data.
    pub fn no_more_data(&mut self) {
        self.content(4, |_| ());
    }

    /// Writes an event.
    pub fn event(&mut self, event: QtmEvent) {
        self.content(6, |writer| {
            writer.bytes(&[event.number()]);
        });
    }

    /// Writes a packet of type `kind`; `write` writes its content.
    pub(super) fn content(&mut self, kind: u32, write: impl FnOnce(&mut ByteWriter<'_>)) {
        let start = self.out.len();
        let mut writer = ByteWriter::new(self.out, self.order);
        writer.u32(0).u32(kind);
        write(&mut writer);
        let size = count_u32(writer.len() - start);
        writer.set_u32(start, size);
    }
}
