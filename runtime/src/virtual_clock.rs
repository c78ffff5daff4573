//! Scheduler of virtual time: selects the role that acts next, and its instant. Pure; the same type orders processes in lockstep
//! and an in-process flight.
//!
//! Every role reports its next event. The earliest event is executed first; at equal times the fixed order of [`Role`] decides. A
//! role that published wakes its reader at the same instant: truth wakes the cameras, a pose the daemon, a command the plant.
//! Events inside a role (poses in transit, commands on the radio) wait in that role's own first-in, first-out queue. All events
//! of a flight are therefore ordered by (time, role, sequence), with any clock.

use oqtal_bus::time::Time;
use oqtal_bus::topic::Role;

use crate::faults::outage::Outage;

/// The result of a turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TurnResult {
    /// The next event of the role; `None` for none.
    pub next: Option<Time>,
    /// Whether the role published a sample that the next role in the loop must read at the same instant.
    pub published: bool,
}

/// Orders turns by virtual time.
#[derive(Clone, Debug)]
pub struct VirtualClock {
    now: Time,
    roles: [bool; Role::ALL.len()],
    next: [Option<Time>; Role::ALL.len()],
    /// Instant since which an unread sample waits for the role.
    unread: [Option<Time>; Role::ALL.len()],
    outages: Vec<Outage>,
}

impl VirtualClock {
    /// Starts at `start`; each of `roles` has its first turn there, other roles never act.
    pub fn new(start: Time, roles: &[Role]) -> Self {
        let mut next = [None; Role::ALL.len()];
        for &role in roles {
            next[role as usize] = Some(start);
        }
        Self {
            now: start,
            roles: next.map(|first| first.is_some()),
            next,
            unread: Default::default(),
            outages: Vec::new(),
        }
    }

    /// Omits the turns of stopped processes and delays the turns of slow ones.
    pub fn set_outages(&mut self, outages: Vec<Outage>) {
        self.outages = outages;
    }

    /// Instant at which `role` acts next, not before the present; `None` if it has no further event.
    fn due(&self, role: Role) -> Option<Time> {
        let at = self.unread[role as usize].or(self.next[role as usize])?;
        let at = if self.outages.is_empty() { at } else { self.postponed(role, at)? };
        Some(at.max(self.now))
    }

    /// The role that acts next, and the instant; `None` if no role has a further event.
    pub fn turn(&mut self) -> Option<(Role, Time)> {
        let mut first: Option<(Role, Time)> = None;
        for role in Role::ALL {
            let Some(at) = self.due(role) else { continue };
            if first.is_none_or(|(_, earliest)| at < earliest) {
                first = Some((role, at));
            }
        }
        let (role, at) = first?;
        self.now = at;
        self.unread[role as usize] = None;
        self.next[role as usize] = None;
        Some((role, at))
    }

    /// Takes the result of the turn of `role`.
    pub fn done(&mut self, role: Role, result: TurnResult) {
        self.next[role as usize] = result.next;
        if result.published
            && let Some(reader) = reader_of(role).filter(|r| self.roles[*r as usize])
        {
            self.unread[reader as usize].get_or_insert(self.now);
        }
    }

    /// Instant at which a turn of `role` due `at` is executed; `None` for never.
    fn postponed(&self, role: Role, at: Time) -> Option<Time> {
        let mut outages = self.outages.iter().filter(|outage| outage.role == role);
        outages.try_fold(at, |at, outage| outage.postpone(at))
    }
}

/// Role that reads the output of `role`.
const fn reader_of(role: Role) -> Option<Role> {
    match role {
        Role::Plant => Some(Role::Mocap),
        Role::Mocap => Some(Role::Daemon),
        Role::Daemon => Some(Role::Plant),
        Role::Recorder | Role::Bridge | Role::Receiver => None,
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

    /// A clock after its first round, with the next event of every role as given.
    fn clock_after_start(events: [Option<Time>; 4]) -> VirtualClock {
        let mut clock = VirtualClock::new(START, &Role::ALL);
        for (role, event) in Role::ALL.into_iter().zip(events) {
            assert_eq!(clock.turn(), Some((role, START)));
            clock.done(role, idle(event));
        }
        clock
    }

    #[test]
    fn the_earliest_acts_first_and_ties_follow_the_fixed_order() {
        let mut clock = clock_after_start([at(3), at(2), at(2), None]);
        assert_eq!(clock.turn(), Some((Role::Mocap, at(2).unwrap())));
        clock.done(Role::Mocap, idle(at(9)));
        assert_eq!(clock.turn(), Some((Role::Daemon, at(2).unwrap())));
        clock.done(Role::Daemon, idle(None));
        assert_eq!(clock.turn(), Some((Role::Plant, at(3).unwrap())));
    }

    #[test]
    fn publishing_wakes_the_reader_at_the_same_instant() {
        let mut clock = clock_after_start([at(10), at(5), at(25), None]);
        assert_eq!(clock.turn(), Some((Role::Mocap, at(5).unwrap())));
        clock.done(Role::Mocap, TurnResult { next: None, published: true });
        assert_eq!(clock.turn(), Some((Role::Daemon, at(5).unwrap())));
        clock.done(Role::Daemon, TurnResult { next: at(30), published: true });
        assert_eq!(clock.turn(), Some((Role::Plant, at(5).unwrap())));
        clock.done(Role::Plant, idle(at(10)));
        assert_eq!(clock.turn(), Some((Role::Plant, at(10).unwrap())));
    }

    #[test]
    fn time_never_runs_back_even_if_a_role_asks_for_the_past() {
        let mut clock = clock_after_start([at(4), None, None, None]);
        assert_eq!(clock.turn(), Some((Role::Plant, at(4).unwrap())));
        clock.done(Role::Plant, idle(at(1)));
        assert_eq!(clock.turn(), Some((Role::Plant, at(4).unwrap())));
    }

    #[test]
    fn virtual_time_ends_when_no_role_has_another_event() {
        assert_eq!(clock_after_start([None; 4]).turn(), None);
    }
}
