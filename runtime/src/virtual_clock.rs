//! Virtual time: whose turn it is, and when. Pure; the same object orders processes in lockstep and an in-process flight.
//!
//! Every role says when it wants to act next. The earliest acts; at equal times the fixed order of [`Role`] decides. A
//! role that published wakes its reader at the same instant: truth wakes the cameras, a pose the daemon, a command the
//! plant. Events that wait inside a role (poses in flight, commands on the radio) are its own first-in, first-out queue.
//! So all events of a flight are ordered by (time, role, sequence), whichever clock drives it.

use oqtal_bus::time::Time;
use oqtal_bus::topic::Role;

/// What a role answers after its turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TurnResult {
    /// When it wants to act next of its own accord.
    pub next: Option<Time>,
    /// Whether it published what the next role in the loop has to look at now.
    pub published: bool,
}

/// Grants turns in the order of virtual time.
#[derive(Clone, Debug)]
pub struct VirtualClock {
    now: Time,
    roles: [bool; Role::ALL.len()],
    next: [Option<Time>; Role::ALL.len()],
    mail: [bool; Role::ALL.len()],
}

impl VirtualClock {
    /// Starts at `start`; each of the `roles` has its first turn there, the others never.
    #[must_use]
    pub fn new(start: Time, roles: &[Role]) -> Self {
        let mut next = [None; Role::ALL.len()];
        for &role in roles {
            next[role as usize] = Some(start);
        }
        Self {
            now: start,
            roles: next.map(|first| first.is_some()),
            next,
            mail: Default::default(),
        }
    }

    /// Who acts next, and at which instant. `None` when nobody ever wants to act again.
    pub fn turn(&mut self) -> Option<(Role, Time)> {
        let due = |&role: &Role| {
            let i = role as usize;
            let at = if self.mail[i] { Some(self.now) } else { self.next[i] };
            at.map(|at| (at.max(self.now), role))
        };
        let (at, role) = Role::ALL.iter().filter_map(due).min()?;
        self.now = at;
        self.mail[role as usize] = false;
        self.next[role as usize] = None;
        Some((role, at))
    }

    /// Takes the answer of the role that had the turn.
    pub fn done(&mut self, role: Role, done: TurnResult) {
        self.next[role as usize] = done.next;
        if done.published
            && let Some(reader) = reader_of(role).filter(|r| self.roles[*r as usize])
        {
            self.mail[reader as usize] = true;
        }
    }
}

/// Who has to look when `role` published.
const fn reader_of(role: Role) -> Option<Role> {
    match role {
        Role::Plant => Some(Role::Mocap),
        Role::Mocap => Some(Role::Daemon),
        Role::Daemon => Some(Role::Plant),
        Role::Recorder | Role::Bridge => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::time::Span;

    const START: Time = Time::VIRTUAL_START;

    fn at(millis: i64) -> Option<Time> {
        Some(START + Span::from_millis(millis))
    }

    fn idle(next: Option<Time>) -> TurnResult {
        TurnResult { next, published: false }
    }

    /// A virtual_clock behind its first round, with every role's next wish as given.
    fn virtual_clock(wishes: [Option<Time>; 4]) -> VirtualClock {
        let mut virtual_clock = VirtualClock::new(START, &Role::ALL);
        for (role, wish) in Role::ALL.into_iter().zip(wishes) {
            assert_eq!(virtual_clock.turn(), Some((role, START)));
            virtual_clock.done(role, idle(wish));
        }
        virtual_clock
    }

    #[test]
    fn the_earliest_acts_first_and_ties_follow_the_fixed_order() {
        let mut virtual_clock = virtual_clock([at(3), at(2), at(2), None]);
        assert_eq!(virtual_clock.turn(), Some((Role::Mocap, at(2).unwrap())));
        virtual_clock.done(Role::Mocap, idle(at(9)));
        assert_eq!(virtual_clock.turn(), Some((Role::Daemon, at(2).unwrap())));
        virtual_clock.done(Role::Daemon, idle(None));
        assert_eq!(virtual_clock.turn(), Some((Role::Plant, at(3).unwrap())));
    }

    #[test]
    fn who_publishes_wakes_its_reader_at_the_same_instant() {
        let mut virtual_clock = virtual_clock([at(10), at(5), at(25), None]);
        assert_eq!(virtual_clock.turn(), Some((Role::Mocap, at(5).unwrap())));
        virtual_clock.done(Role::Mocap, TurnResult { next: None, published: true });
        assert_eq!(virtual_clock.turn(), Some((Role::Daemon, at(5).unwrap())));
        virtual_clock.done(Role::Daemon, TurnResult { next: at(30), published: true });
        assert_eq!(virtual_clock.turn(), Some((Role::Plant, at(5).unwrap())));
        virtual_clock.done(Role::Plant, idle(at(10)));
        assert_eq!(virtual_clock.turn(), Some((Role::Plant, at(10).unwrap())));
    }

    #[test]
    fn time_never_runs_back_even_if_a_party_asks_for_the_past() {
        let mut virtual_clock = virtual_clock([at(4), None, None, None]);
        assert_eq!(virtual_clock.turn(), Some((Role::Plant, at(4).unwrap())));
        virtual_clock.done(Role::Plant, idle(at(1)));
        assert_eq!(virtual_clock.turn(), Some((Role::Plant, at(4).unwrap())));
    }

    #[test]
    fn nobody_wants_to_act_again_ends_it() {
        assert_eq!(virtual_clock([None; 4]).turn(), None);
    }
}
