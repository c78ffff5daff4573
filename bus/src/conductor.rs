//! Virtual time: whose turn it is, and when. Pure; the same object conducts processes in lockstep and an in-process flight.
//!
//! Every party says when it wants to act next. The earliest acts; at equal times the fixed order of [`Party`] decides. A
//! party that published wakes its reader at the same instant: truth wakes the cameras, a pose the daemon, a command the
//! plant. Events that wait inside a party (poses in flight, commands on the radio) are its own first-in, first-out queue.
//! So all events of a flight are ordered by (time, party, sequence), whichever clock drives it.

use crate::time::Time;
use crate::topic::Party;

/// What a party answers after its turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Done {
    /// When it wants to act next of its own accord.
    pub next: Option<Time>,
    /// Whether it published what the next party in the loop has to look at now.
    pub published: bool,
}

/// Grants turns in the order of virtual time.
#[derive(Clone, Debug)]
pub struct Conductor {
    now: Time,
    parties: [bool; Party::ALL.len()],
    next: [Option<Time>; Party::ALL.len()],
    mail: [bool; Party::ALL.len()],
}

impl Conductor {
    /// Starts at `start`; each of the `parties` has its first turn there, the others never.
    #[must_use]
    pub fn new(start: Time, parties: &[Party]) -> Self {
        let mut next = [None; Party::ALL.len()];
        for &party in parties {
            next[party as usize] = Some(start);
        }
        Self {
            now: start,
            parties: next.map(|first| first.is_some()),
            next,
            mail: Default::default(),
        }
    }

    /// Who acts next, and at which instant. `None` when nobody ever wants to act again.
    pub fn turn(&mut self) -> Option<(Party, Time)> {
        let due = |&party: &Party| {
            let i = party as usize;
            let at = if self.mail[i] { Some(self.now) } else { self.next[i] };
            at.map(|at| (at.max(self.now), party))
        };
        let (at, party) = Party::ALL.iter().filter_map(due).min()?;
        self.now = at;
        self.mail[party as usize] = false;
        self.next[party as usize] = None;
        Some((party, at))
    }

    /// Takes the answer of the party that had the turn.
    pub fn done(&mut self, party: Party, done: Done) {
        self.next[party as usize] = done.next;
        if done.published
            && let Some(reader) = reader_of(party).filter(|r| self.parties[*r as usize])
        {
            self.mail[reader as usize] = true;
        }
    }
}

/// Who has to look when `party` published.
const fn reader_of(party: Party) -> Option<Party> {
    match party {
        Party::Plant => Some(Party::Mocap),
        Party::Mocap => Some(Party::Daemon),
        Party::Daemon => Some(Party::Plant),
        Party::Recorder | Party::Bridge => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Span;

    const START: Time = Time::VIRTUAL_START;

    fn at(millis: i64) -> Option<Time> {
        Some(START + Span::from_millis(millis))
    }

    fn idle(next: Option<Time>) -> Done {
        Done { next, published: false }
    }

    /// A conductor behind its first round, with every party's next wish as given.
    fn conductor(wishes: [Option<Time>; 4]) -> Conductor {
        let mut conductor = Conductor::new(START, &Party::ALL);
        for (party, wish) in Party::ALL.into_iter().zip(wishes) {
            assert_eq!(conductor.turn(), Some((party, START)));
            conductor.done(party, idle(wish));
        }
        conductor
    }

    #[test]
    fn the_earliest_acts_first_and_ties_follow_the_fixed_order() {
        let mut conductor = conductor([at(3), at(2), at(2), None]);
        assert_eq!(conductor.turn(), Some((Party::Mocap, at(2).unwrap())));
        conductor.done(Party::Mocap, idle(at(9)));
        assert_eq!(conductor.turn(), Some((Party::Daemon, at(2).unwrap())));
        conductor.done(Party::Daemon, idle(None));
        assert_eq!(conductor.turn(), Some((Party::Plant, at(3).unwrap())));
    }

    #[test]
    fn who_publishes_wakes_its_reader_at_the_same_instant() {
        let mut conductor = conductor([at(10), at(5), at(25), None]);
        assert_eq!(conductor.turn(), Some((Party::Mocap, at(5).unwrap())));
        conductor.done(Party::Mocap, Done { next: None, published: true });
        assert_eq!(conductor.turn(), Some((Party::Daemon, at(5).unwrap())));
        conductor.done(Party::Daemon, Done { next: at(30), published: true });
        assert_eq!(conductor.turn(), Some((Party::Plant, at(5).unwrap())));
        conductor.done(Party::Plant, idle(at(10)));
        assert_eq!(conductor.turn(), Some((Party::Plant, at(10).unwrap())));
    }

    #[test]
    fn time_never_runs_back_even_if_a_party_asks_for_the_past() {
        let mut conductor = conductor([at(4), None, None, None]);
        assert_eq!(conductor.turn(), Some((Party::Plant, at(4).unwrap())));
        conductor.done(Party::Plant, idle(at(1)));
        assert_eq!(conductor.turn(), Some((Party::Plant, at(4).unwrap())));
    }

    #[test]
    fn nobody_wants_to_act_again_ends_it() {
        assert_eq!(conductor([None; 4]).turn(), None);
    }
}
