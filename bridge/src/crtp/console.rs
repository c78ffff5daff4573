//! Text of a vehicle, which arrives in pieces, as lines.

use oqtal_bus::text::ShortText;

/// Longest line that is kept \[bytes\].
const LONGEST: usize = 56;

/// Line that is arriving.
#[derive(Clone, Copy, Debug)]
pub struct ConsoleLine {
    bytes: [u8; LONGEST],
    length: usize,
}

impl ConsoleLine {
    /// Line without text.
    pub fn new() -> Self {
        Self { bytes: [0; LONGEST], length: 0 }
    }

    /// Takes a piece of text, and passes every line that ends in it to `line`. Longer lines are cut.
    pub fn take(&mut self, piece: &[u8], mut line: impl FnMut(ShortText)) {
        for byte in piece {
            match byte {
                b'\n' if self.length > 0 => {
                    line(ShortText::from_ascii(&self.bytes[..self.length]));
                    self.length = 0;
                }
                b'\n' | 0 => {}
                byte => {
                    if let Some(place) = self.bytes.get_mut(self.length) {
                        *place = *byte;
                        self.length += 1;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_come_in_pieces_and_long_ones_are_cut() {
        let (mut console, mut lines) = (ConsoleLine::new(), Vec::new());
        for piece in [&b"SYS: Can"[..], b" not fly\n\nSTAB: R", b"eady\n", &[b'x'; 100], b"\n"] {
            console.take(piece, |line| lines.push(line.to_string()));
        }
        assert_eq!(lines[..2], ["SYS: Can not fly", "STAB: Ready"]);
        assert_eq!(lines[2], "x".repeat(LONGEST));
    }
}
