//! Program whose references are followed: of two at a time the second one is refused.

use oqtal_bus::time::{Span, Time};

use super::socket::Sender;

/// Program whose references are followed.
#[derive(Debug, Default)]
pub struct StreamHolder {
    /// Process; 0 for a program of the network or of another container.
    process: u32,
    /// Name of the program; of process 0 its address.
    program: String,
    /// Sequence number of its newest reference; 0 on this machine.
    sequence: u64,
    /// Latest end of the validity of its references: the daemon may have refused the newest one.
    until: Time,
    /// Longest time for which one reference keeps other programs out.
    pub longest: Span,
}

impl StreamHolder {
    /// Whether references are in force at `now`.
    pub fn is_busy(&self, now: Time) -> bool {
        now < self.until
    }

    /// Admits a reference of `sender` that is valid until `valid_until`; false for one that a newer one has overtaken on the network.
    ///
    /// # Errors
    /// References of another program are in force, or the program cannot be told from others.
    pub fn admit(&mut self, sender: &Sender, valid_until: Time, now: Time) -> Result<bool, String> {
        if sender.process == 0 && sender.program.is_empty() {
            return Err(
                "the process of the sender cannot be seen from here, as in another container: bind its socket to a path"
                    .to_owned(),
            );
        }
        let Self { process, program, .. } = &*self;
        let is_same = *process == sender.process && (*process != 0 || *program == sender.program);
        let is_busy = self.is_busy(now);
        if !is_same && is_busy {
            let place = if *process == 0 { String::new() } else { format!(", process {process}") };
            return Err(format!(
                "`{program}`{place} sends references already; end it, or wait until its last reference expires"
            ));
        }
        let sequence = sender.sequence();
        if is_busy && sequence < self.sequence {
            return Ok(false);
        }
        if !is_same {
            (self.process, self.program) = (sender.process, sender.program.clone());
        }
        self.sequence = sequence;
        self.until = self.until.max(valid_until.min(now + self.longest));
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONGEST: Span = Span::from_millis(500);

    fn holder() -> StreamHolder {
        StreamHolder { longest: LONGEST, ..StreamHolder::default() }
    }

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    fn program(port: u16, sequence: u64) -> Sender {
        Sender::network(([10, 0, 0, 7], port).into(), sequence)
    }

    #[test]
    fn the_references_of_a_second_program_are_refused_until_those_of_the_first_expire() {
        let mut holder = holder();
        let [first, second] = [5001, 5002].map(|port| program(port, 1));
        assert_eq!(holder.admit(&first, at(100), at(0)), Ok(true));
        let refusal = holder.admit(&second, at(150), at(50)).unwrap_err();
        assert!(refusal.starts_with("`10.0.0.7:5001` sends references already"), "{refusal}");
        assert_eq!(holder.admit(&first, at(150), at(50)), Ok(true));
        assert_eq!(holder.admit(&second, at(9000), at(150)), Ok(true));
        assert!(holder.admit(&first, at(700), at(600)).is_err());
        assert_eq!(holder.admit(&first, at(700), at(650)), Ok(true), "at most `longest`");
        // The daemon refuses a reference of the past, and still follows the one before.
        assert_eq!(holder.admit(&first, at(0), at(660)), Ok(true));
        assert!(holder.admit(&second, at(700), at(670)).is_err());
    }

    #[test]
    fn a_reference_that_was_overtaken_on_the_network_is_dropped() {
        let mut holder = holder();
        let mut admit =
            |sequence, now| holder.admit(&program(5001, sequence), at(now + 100), at(now));
        assert_eq!([7, 6, 8].map(|sequence| admit(sequence, 0)), [Ok(true), Ok(false), Ok(true)]);
        assert_eq!(admit(5, 100), Ok(true), "a new stream");
    }

    #[test]
    fn programs_of_other_containers_are_told_apart_by_their_addresses() {
        let mut holder = holder();
        let [first, second, unbound] = ["/run/a", "/run/b", ""].map(|path| Sender {
            address: None,
            process: 0,
            user: 1000,
            program: path.to_owned(),
        });
        assert_eq!(holder.admit(&first, at(100), at(0)), Ok(true));
        assert!(holder.admit(&second, at(100), at(0)).is_err());
        assert!(holder.admit(&unbound, at(900), at(800)).unwrap_err().contains("bind its socket"));
    }
}
