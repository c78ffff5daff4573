//! Texts in messages.

use std::fmt;

/// Text of up to `N` bytes of UTF-8; longer text is cut.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(transparent)]
pub struct Text<const N: usize>([u8; N]);

/// Text of up to 56 bytes.
pub type ShortText = Text<56>;
/// Text of up to 1000 bytes: settings, or the reason of a refusal.
pub type LongText = Text<1000>;

impl<const N: usize> Text<N> {
    /// No text.
    pub const EMPTY: Self = Self([0; N]);

    /// Text of `lines`, one under another; `None` if they are longer than the text may be.
    pub fn of_lines<'a>(lines: impl IntoIterator<Item = &'a str>) -> Option<Self> {
        let mut bytes = [0; N];
        let mut length = 0;
        for line in lines {
            let separator = if length == 0 { "" } else { "\n" };
            for part in [separator, line] {
                bytes.get_mut(length..length + part.len())?.copy_from_slice(part.as_bytes());
                length += part.len();
            }
        }
        Some(Self(bytes))
    }

    /// As many of the first `lines` as the text can have, one under another, then the number of the others.
    pub fn of_first_lines(lines: &[&str]) -> Self {
        let first = |count: usize| {
            let others = lines.len() - count;
            let others = (others > 0).then(|| format!("and {others} more"));
            Self::of_lines(lines[..count].iter().copied().chain(others.as_deref()))
        };
        (0..=lines.len()).rev().find_map(first).unwrap_or_default()
    }

    /// Message text from `text`, without control characters.
    pub fn new(text: &str) -> Self {
        let mut bytes = [0; N];
        let mut length = 0;
        for character in text.chars().filter(|character| !character.is_control()) {
            let width = character.len_utf8();
            let Some(place) = bytes.get_mut(length..length + width) else { break };
            character.encode_utf8(place);
            length += width;
        }
        Self(bytes)
    }

    /// Message text from arbitrary bytes up to the first zero; bytes other than printable ASCII become `?`.
    pub fn from_ascii(bytes: &[u8]) -> Self {
        let mut text = Self::EMPTY;
        let ends = bytes.iter().take_while(|byte| **byte != 0);
        for (place, byte) in text.0.iter_mut().zip(ends) {
            *place = if (b' '..=b'~').contains(byte) { *byte } else { b'?' };
        }
        text
    }

    /// The text; empty for received bytes that are not UTF-8.
    pub fn as_str(&self) -> &str {
        let length = self.0.iter().position(|byte| *byte == 0).unwrap_or(N);
        str::from_utf8(&self.0[..length]).unwrap_or_default()
    }

    /// Whether the text is empty.
    pub fn is_empty(&self) -> bool {
        self.as_str().is_empty()
    }

    /// The bytes, padded with zeros.
    pub(crate) const fn bytes(self) -> [u8; N] {
        self.0
    }

    /// Text of the bytes of a message.
    pub(crate) const fn from_bytes(bytes: [u8; N]) -> Self {
        Self(bytes)
    }
}

impl<const N: usize> Default for Text<N> {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl<const N: usize> fmt::Display for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl<const N: usize> fmt::Debug for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_cut_between_characters_and_invalid_bytes_are_empty_text() {
        assert_eq!(ShortText::new("PreArm: \nGyros").as_str(), "PreArm: Gyros");
        let long = ShortText::new(&"\u{e9}".repeat(40));
        assert_eq!(long.as_str().chars().count(), 28);
        assert_eq!(ShortText::from_ascii(b"a\xffb\0c").as_str(), "a?b");
        assert_eq!(ShortText::from_ascii(&[b'x'; 200]).as_str().len(), 56);
        assert_eq!(Text::<5>::of_lines(["a=1", "b"]).unwrap().as_str(), "a=1\nb");
        assert_eq!(Text::<4>::of_lines(["a=1", "b"]), None);
        let first =
            |count| Text::<20>::of_first_lines(&["a=1", "b=22", "c=333", "d=4444"][..count]);
        assert_eq!(first(3).as_str(), "a=1\nb=22\nc=333");
        assert_eq!(first(4).as_str(), "a=1\nb=22\nand 2 more");
        assert!(ShortText::from_bytes([0xff; 56]).is_empty() && ShortText::EMPTY.is_empty());
    }
}
