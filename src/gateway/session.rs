//! Protection against replayed datagrams: each sequence number is accepted once in a session.

use std::collections::BTreeSet;
use std::sync::Mutex;

use oqtal_runtime::process::Failure;

use super::protocol::GatewayReply;
use crate::token::random_token;

/// First word of a datagram to the gateway. Only such a datagram has a reply: replies would be replied to without end.
pub const FROM_PROGRAM: &str = "program";
/// First word of a reply.
pub const FROM_GATEWAY: &str = "gateway";
/// Distance below the highest number within which a number counts \[ns\]: datagrams overtake each other, and clocks of senders differ.
const BEHIND: u64 = 2_000_000_000;
/// Distance above the highest number, or above the clock, within which a number counts \[ns\]: one far above them would exclude all
/// senders from then on.
const AHEAD: u64 = 3600 * 1_000_000_000;
/// Number of sequence numbers that are kept: those of 2 s at 2 kHz.
const KEPT: usize = 4096;

/// A run of the gateway.
pub struct Session {
    name: String,
    window: Mutex<SequenceWindow>,
}

impl Session {
    /// A session with a random name.
    ///
    /// # Errors
    /// The operating system gives no random numbers (exit code 71).
    pub fn begin() -> Result<Self, Failure> {
        Ok(Self { name: random_token()?, window: Mutex::default() })
    }

    /// First line of the reply to the datagram with this sequence number.
    pub fn reply_line(&self, sequence: u64) -> String {
        format!("{FROM_GATEWAY} {} {sequence}", self.name)
    }

    /// Takes the first line of a datagram, `program SESSION SEQUENCE`, at `clock_ns` of the wall clock; `None` for a datagram without a
    /// reply, or the sequence number.
    ///
    /// # Errors
    /// The datagram is of another session, or its number does not count; the number, and the refusal.
    pub fn admit(&self, line: &str, clock_ns: u64) -> Option<Result<u64, (u64, GatewayReply)>> {
        let rest = line.strip_prefix(FROM_PROGRAM)?.strip_prefix(' ')?;
        let refused = |text: &str| GatewayReply::refused(text.to_owned());
        let number = |text: &str| text.parse::<u64>().ok();
        let Some((session, sequence)) =
            rest.split_once(' ').and_then(|(name, text)| Some((name, number(text)?)))
        else {
            return Some(Err((0, refused("the first line is not `program SESSION SEQUENCE`"))));
        };
        if session != self.name {
            return Some(Err((sequence, refused("another session: use that of this reply"))));
        }
        let mut window = self.window.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        Some(window.admit(sequence, clock_ns).map(|()| sequence).map_err(|reply| (sequence, reply)))
    }
}

/// Sequence numbers that were received.
#[derive(Debug, Default)]
struct SequenceWindow {
    /// Numbers above `floor` that were received.
    received: BTreeSet<u64>,
    /// Highest number that was dropped from them; numbers up to it are refused.
    floor: u64,
}

impl SequenceWindow {
    /// Takes `sequence` at `clock_ns` of the wall clock.
    ///
    /// # Errors
    /// The number was received before, or is far from those of the others.
    fn admit(&mut self, sequence: u64, clock_ns: u64) -> Result<(), GatewayReply> {
        let last = self.received.last().copied().unwrap_or_default();
        let refused = |reason| Err(GatewayReply::out_of_sequence(reason, last));
        if sequence > last.max(clock_ns).saturating_add(AHEAD) {
            return refused("an hour above the gateway's clock and the highest number");
        }
        if sequence <= self.floor.max(last.saturating_sub(BEHIND)) {
            return refused("2 s or 4096 numbers below the highest number");
        }
        if !self.received.insert(sequence) {
            return Err(GatewayReply::refused(format!("sequence {sequence} was received before")));
        }
        let oldest = last.max(sequence).saturating_sub(BEHIND);
        while let Some(&first) = self.received.first()
            && (self.received.len() > KEPT || first <= oldest)
        {
            self.received.pop_first();
            self.floor = first;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLOCK: u64 = 1_800_000_000_000_000_000;

    #[test]
    fn only_datagrams_of_programs_have_a_reply() {
        let session = Session { name: "ab".to_owned(), window: Mutex::default() };
        let admit = |line: &str| {
            session.admit(line, CLOCK).map(|result| result.map_err(|(sequence, _)| sequence))
        };
        assert_eq!(admit("program ab 5"), Some(Ok(5)));
        assert_eq!(admit("program cd 6"), Some(Err(6)), "another session");
        for line in ["program ", "program ab", "program ab x"] {
            assert_eq!(admit(line), Some(Err(0)), "{line}");
        }
        let reply = session.reply_line(5);
        assert_eq!(reply, "gateway ab 5");
        for line in [reply.as_str(), "ab 7", "", "program", "programs ab 7"] {
            assert_eq!(admit(line), None, "{line}");
        }
    }

    #[test]
    fn a_sequence_number_counts_once_and_two_seconds_below_the_highest() {
        let mut window = SequenceWindow::default();
        let mut admit = |number: u64| window.admit(number, CLOCK).map_err(|reply| reply.to_json());
        assert_eq!(admit(CLOCK), Ok(()));
        // A sender whose clock is 1.9 s behind.
        assert_eq!(admit(CLOCK - 1_900_000_000), Ok(()));
        for number in [CLOCK, CLOCK - 1_900_000_000] {
            let refusal = admit(number).unwrap_err();
            assert!(refusal.contains("was received before"), "{refusal}");
            assert!(!refusal.contains("continue_after"), "{refusal}");
        }
        let refusal = admit(CLOCK - BEHIND).unwrap_err();
        assert!(refusal.contains(&format!(r#""continue_after":{CLOCK}"#)), "{refusal}");
        assert_eq!(admit(CLOCK + BEHIND), Ok(()));
        assert!(admit(CLOCK - 1).unwrap_err().contains("below the highest"));
    }

    #[test]
    fn no_number_excludes_the_other_senders() {
        let mut window = SequenceWindow::default();
        let refusal = window.admit(u64::MAX, CLOCK).unwrap_err().to_json();
        assert!(refusal.contains(r#""continue_after":0"#), "{refusal}");
        assert!(window.admit(CLOCK, CLOCK).is_ok());
        assert!(window.admit(CLOCK + AHEAD, CLOCK).is_ok());
        // Also with the clock set back.
        assert!(window.admit(CLOCK + AHEAD + 1, CLOCK / 2).is_ok());
    }

    #[test]
    fn memory_is_bounded_and_no_forgotten_number_counts_again() {
        let mut window = SequenceWindow::default();
        let numbers = 1..=2 * KEPT as u64;
        assert!(numbers.clone().all(|number| window.admit(number, CLOCK).is_ok()));
        assert_eq!(window.received.len(), KEPT);
        assert!(numbers.clone().all(|number| window.admit(number, CLOCK).is_err()));
    }
}
