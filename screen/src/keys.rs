//! Meaning of keys: single keys, and a line in which a request is typed.

use oqtal_bus::time::{Span, Time};

/// Longest request line \[characters\].
const LONGEST: usize = 200;
/// Time between two parts of a pasted text, at most; keys are pressed at greater intervals.
const PASTE_GAP: Span = Span::from_millis(50);

const CTRL_C: u8 = 3;
const CTRL_D: u8 = 4;
const CTRL_S: u8 = 19;
const BACKSPACE: u8 = 8;
const DELETE: u8 = 127;
const ESCAPE: u8 = 0x1b;

/// Operator request by keys.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Key {
    /// End.
    Quit,
    /// Reset latencies and counters.
    Restart,
    /// Stop the motors.
    Stop,
    /// Send a request, as after `oqtal ctl`.
    Request(String),
}

/// Interpreter of keys.
#[derive(Debug, Default)]
pub struct Keyboard {
    /// The request being typed.
    pub line: Option<String>,
    /// Instant of the last keys; unset before them.
    last_at: Time,
}

impl Keyboard {
    /// Takes the bytes of one or more keys received at `now`; no bytes mean the end of the input. Control keys quit and stop even while a
    /// request is typed. S is an ordinary letter in a request and in pasted text, which arrives in long parts, of which the last may be a
    /// single S, and must not stop a flight.
    pub fn take(&mut self, bytes: &[u8], now: Time) -> Option<Key> {
        let is_pasted = now.since(std::mem::replace(&mut self.last_at, now)) < PASTE_GAP;
        if bytes.is_empty() || bytes.iter().any(|key| matches!(*key, CTRL_C | CTRL_D)) {
            return Some(Key::Quit);
        }
        // With the shift key: not pressed by accident.
        let is_letter_alone =
            self.line.is_none() && !is_pasted && bytes.iter().all(|key| *key == b'S');
        if is_letter_alone || bytes.contains(&CTRL_S) {
            self.line = None;
            return Some(Key::Stop);
        }
        match (self.line.is_some(), bytes) {
            (true, [ESCAPE]) => self.line = None,
            (false, [ESCAPE]) => return Some(Key::Quit),
            // A key that sends several bytes, such as an arrow key.
            (_, [ESCAPE, ..]) => {}
            (_, keys) => return keys.iter().find_map(|key| self.press(*key)),
        }
        None
    }

    fn press(&mut self, key: u8) -> Option<Key> {
        let Some(line) = &mut self.line else {
            match key {
                b'q' | b'Q' => return Some(Key::Quit),
                b'r' => return Some(Key::Restart),
                b':' => self.line = Some(String::new()),
                _ => {}
            }
            return None;
        };
        match key {
            b'\r' | b'\n' => {
                return self.line.take().filter(|line| !line.trim().is_empty()).map(Key::Request);
            }
            BACKSPACE | DELETE => drop(line.pop()),
            b' '..=b'~' if line.len() < LONGEST => line.push(char::from(key)),
            _ => {}
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Time = Time::VIRTUAL_START;

    #[test]
    fn keys_that_end_and_keys_that_do_not() {
        let meaning = |bytes: &[u8]| Keyboard::default().take(bytes, NOW);
        for end in [&b"q"[..], b"Q", b"\x03", b"\x04", b"\x1b", b""] {
            assert_eq!(meaning(end), Some(Key::Quit), "{end:?}");
        }
        assert_eq!(meaning(b"c"), None);
        assert_eq!(meaning(b"\x1b[A"), None, "an arrow");
        assert_eq!(meaning(b"r"), Some(Key::Restart));
        assert_eq!(
            (meaning(b"S"), meaning(b"s"), meaning(b"rS")),
            (Some(Key::Stop), None, Some(Key::Restart))
        );
        for stop in [&b"SSS"[..], b"\x13", b"r\x13"] {
            assert_eq!(meaning(stop), Some(Key::Stop), "{stop:?}");
        }
        assert_eq!(meaning(b"/home/Sam/Setup.toml\r"), None, "pasted");
        assert_eq!(meaning(b"\x1bOS"), None, "F4");
    }

    #[test]
    fn the_last_letter_of_a_pasted_text_does_not_stop() {
        let mut keyboard = Keyboard::default();
        let at = |millis| NOW + Span::from_millis(millis);
        assert_eq!(keyboard.take(&[b'x'; 4096], at(0)), None);
        assert_eq!(keyboard.take(b"S", at(20)), None);
        assert_eq!(keyboard.take(b"S", at(70)), Some(Key::Stop), "pressed");
    }

    #[test]
    fn a_request_is_typed_corrected_and_sent() {
        let mut keyboard = Keyboard::default();
        assert_eq!(keyboard.take(b":gotq\x7fo 1 -2", NOW), None);
        assert_eq!(keyboard.take(b"\x1b[A", NOW), None);
        assert_eq!(keyboard.line.as_deref(), Some("goto 1 -2"));
        assert_eq!(keyboard.take(b" 1\r", NOW), Some(Key::Request("goto 1 -2 1".to_owned())));
        assert_eq!((keyboard.take(b":land", NOW), keyboard.take(b"\x1b", NOW)), (None, None));
        assert_eq!(keyboard.line, None);
        assert_eq!(keyboard.take(b":  \r", NOW), None);
        let paths =
            [&b":reload /home/"[..], b"S", b"am/Setup.toml"].map(|keys| keyboard.take(keys, NOW));
        assert_eq!(
            (paths, keyboard.line.as_deref()),
            ([const { None }; 3], Some("reload /home/Sam/Setup.toml"))
        );
        // Neither waits for the end of a line.
        assert_eq!((keyboard.take(b"\x13", NOW), keyboard.line.take()), (Some(Key::Stop), None));
        assert_eq!(
            (keyboard.take(b":go", NOW), keyboard.take(b"\x03", NOW)),
            (None, Some(Key::Quit))
        );
    }
}
