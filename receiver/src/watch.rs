//! Changes since the last call, for the log: clock, bodies, frames. Pure.

use oqtal_bus::code::Cause;
use oqtal_bus::time::{Span, Time};

use crate::gate::FrameCounts;
use crate::note::ReceiverNote;
use crate::receiver::PoseReceiver;

/// Time between two looks at the bodies and the clock.
const LOOK_PERIOD: Span = Span::from_millis(100);
/// Time between two notes of troubled frames.
const TROUBLE_PERIOD: Span = Span::from_millis(5000);
/// Time without a frame after which a body is lost, where lost bodies have no frames.
const BODY_SILENCE: Span = Span::from_millis(200);

/// The state at the last look.
#[derive(Clone, Debug)]
pub struct ReceiverWatch {
    next_look: Time,
    next_trouble: Time,
    receiving: bool,
    clock_known: bool,
    relearned: u64,
    seen: Vec<bool>,
    there: Vec<bool>,
    /// Frame counts and damaged messages at the last note of trouble.
    noted: (FrameCounts, u64),
}

impl ReceiverWatch {
    /// Watch of this number of bodies, before the first frame.
    pub fn new(bodies: usize) -> Self {
        Self {
            next_look: Time::UNSET,
            next_trouble: Time::UNSET,
            receiving: false,
            clock_known: false,
            relearned: 0,
            seen: vec![false; bodies],
            there: vec![true; bodies],
            noted: (FrameCounts::default(), 0),
        }
    }

    /// Notes what has changed. `gates` of the receiver are in use, `has` says whether the server has the body of a route.
    pub fn look(
        &mut self,
        now: Time,
        (receiver, gates): (&PoseReceiver, usize),
        has: &dyn Fn(usize) -> bool,
        note: &mut dyn FnMut(ReceiverNote),
    ) {
        if now < self.next_look {
            return;
        }
        self.next_look = now + LOOK_PERIOD;
        let fresh = |at: Time| at.is_set() && now.since(at) < BODY_SILENCE;
        if fresh(receiver.arrived_at()) && !self.receiving {
            self.receiving = true;
            note(ReceiverNote::Receiving);
        }
        self.look_at_clock(receiver.clock(0), note);
        for route in 0..self.seen.len() {
            // Without frames nothing is known of a body.
            let seen = match fresh(receiver.arrived_at()) {
                true => receiver.is_tracked(route) && fresh(receiver.seen_at(route)),
                false => self.seen[route],
            };
            if seen != std::mem::replace(&mut self.seen[route], seen) {
                let (lost, found) =
                    (ReceiverNote::BodyLost { route }, ReceiverNote::BodySeen { route });
                note(if seen { found } else { lost });
            }
            let there = has(route);
            if !there && std::mem::replace(&mut self.there[route], there) {
                note(ReceiverNote::BodyMissing { route });
            }
            self.there[route] = there;
        }
        self.look_at_frames(now, (receiver, gates), note);
    }

    /// Trouble with the body of a route, by the last look.
    pub fn trouble(&self, route: usize) -> Cause {
        match (self.there[route], self.seen[route]) {
            (false, _) => Cause::NoBody,
            (true, false) => Cause::Untracked,
            (true, true) => Cause::None,
        }
    }

    /// Frames have ceased to come.
    pub fn silence(&mut self, note: &mut dyn FnMut(ReceiverNote)) {
        self.receiving = false;
        note(ReceiverNote::Silent);
    }

    fn look_at_clock(
        &mut self,
        clock: crate::clock::ClockState,
        note: &mut dyn FnMut(ReceiverNote),
    ) {
        let relearned = clock.relearned > std::mem::replace(&mut self.relearned, clock.relearned);
        if clock.is_known == std::mem::replace(&mut self.clock_known, clock.is_known) {
            if clock.is_known && relearned {
                note(ReceiverNote::ClockStepped);
            }
            return;
        }
        let uncertainty = clock.uncertainty;
        note(if clock.is_known {
            ReceiverNote::ClockKnown { uncertainty }
        } else {
            ReceiverNote::ClockUnknown
        });
    }

    fn look_at_frames(
        &mut self,
        now: Time,
        (receiver, gates): (&PoseReceiver, usize),
        note: &mut dyn FnMut(ReceiverNote),
    ) {
        if now < self.next_trouble {
            return;
        }
        let counts = (0..gates)
            .map(|gate| receiver.counts(gate))
            .fold(FrameCounts::default(), FrameCounts::plus);
        let (before, damaged_before) =
            std::mem::replace(&mut self.noted, (counts, receiver.damaged()));
        let troubled = ReceiverNote::Troubled {
            lost: counts.lost - before.lost,
            repeated: counts.repeated - before.repeated,
            out_of_order: counts.out_of_order - before.out_of_order,
            late: counts.late - before.late,
            damaged: receiver.damaged() - damaged_before,
        };
        let none =
            ReceiverNote::Troubled { lost: 0, repeated: 0, out_of_order: 0, late: 0, damaged: 0 };
        if troubled != none {
            self.next_trouble = now + TROUBLE_PERIOD;
            note(troubled);
        }
    }
}
