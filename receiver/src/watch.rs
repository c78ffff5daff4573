//! Changes since the last call, for the log: clock, bodies, frames. Pure.

use oqtal_bus::code::Cause;
use oqtal_bus::time::{Span, Time};

use crate::clock::ClockState;
use crate::gate::FrameCounts;
use crate::note::{ClockEvent, ReceiverNote};
use crate::receiver::PoseReceiver;

/// Time between two notes of troubled frames.
const TROUBLE_PERIOD: Span = Span::from_millis(5000);
/// Time without a frame after which a body is lost, where lost bodies have no frames.
const BODY_SILENCE: Span = Span::from_millis(200);
/// Time with frames after which an unknown clock is reported as having no usable stamps: missing, constant or in disorder.
const UNDATED_TIME: Span = Span::from_millis(2000);

/// The clock of one gate at the last look.
#[derive(Clone, Copy, Debug, Default)]
struct ClockWatch {
    is_known: bool,
    relearned: u64,
    /// Instant since which frames have come while the clock was not known; `None` if it is known, or without frames.
    undated_since: Option<Time>,
    /// Whether these frames have no usable stamps.
    is_undated: bool,
}

/// The state at the last look.
#[derive(Clone, Debug)]
pub struct ReceiverWatch {
    next_trouble: Time,
    receiving: bool,
    /// State of each gate's clock.
    clocks: Vec<ClockWatch>,
    /// Whether each body has its own gate.
    has_own_gates: bool,
    seen: Vec<bool>,
    there: Vec<bool>,
    /// Frame counts and damaged messages at the last note of trouble.
    noted: (FrameCounts, u64),
}

impl ReceiverWatch {
    /// Watch of this number of bodies, before the first frame.
    pub fn new(bodies: usize) -> Self {
        Self {
            next_trouble: Time::UNSET,
            receiving: false,
            clocks: vec![ClockWatch::default(); bodies.max(1)],
            has_own_gates: false,
            seen: vec![false; bodies],
            there: vec![true; bodies],
            noted: (FrameCounts::default(), 0),
        }
    }

    /// Records what has changed since the last call. `gates` of the receiver are in use, `has` says whether the server has the body of a
    /// route.
    pub fn look(
        &mut self,
        now: Time,
        (receiver, gates): (&PoseReceiver, usize),
        has: &dyn Fn(usize) -> bool,
        note: &mut dyn FnMut(ReceiverNote),
    ) {
        let fresh = |at: Time| at.is_set() && now.since(at) < BODY_SILENCE;
        if fresh(receiver.arrived_at()) && !self.receiving {
            self.receiving = true;
            note(ReceiverNote::Receiving);
        }
        self.has_own_gates = gates > 1;
        for (gate, clock) in self.clocks.iter_mut().take(gates).enumerate() {
            let body = (gates > 1).then_some(gate);
            let arrived_at = body.map_or(receiver.arrived_at(), |route| receiver.seen_at(route));
            let arriving = fresh(arrived_at).then_some(now);
            if let Some(event) = clock.look(arriving, receiver.clock(gate)) {
                note(ReceiverNote::Clock { body, event });
            }
        }
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
            let was_there = std::mem::replace(&mut self.there[route], there);
            if was_there && !there {
                note(ReceiverNote::BodyMissing { route });
            }
        }
        self.look_at_frames(now, (receiver, gates), note);
    }

    /// Trouble with the body of a route, by the last look.
    pub fn trouble(&self, route: usize) -> Cause {
        let gate = if self.has_own_gates { route } else { 0 };
        match (self.there[route], self.seen[route]) {
            (false, _) => Cause::NoBody,
            _ if self.clocks[gate].is_undated => Cause::NoStamps,
            (true, false) => Cause::Untracked,
            (true, true) => Cause::None,
        }
    }

    /// Frames have ceased to come.
    pub fn silence(&mut self, note: &mut dyn FnMut(ReceiverNote)) {
        self.receiving = false;
        note(ReceiverNote::Silent);
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

impl ClockWatch {
    /// The change since the last look; `arriving` is the present instant while frames come.
    fn look(&mut self, arriving: Option<Time>, clock: ClockState) -> Option<ClockEvent> {
        let relearned = clock.relearned > std::mem::replace(&mut self.relearned, clock.relearned);
        let was_known = std::mem::replace(&mut self.is_known, clock.is_known);
        let undated_at = arriving.filter(|_| !clock.is_known);
        self.undated_since = undated_at.map(|now| self.undated_since.unwrap_or(now));
        let lasted = undated_at.zip(self.undated_since).map(|(now, since)| now.since(since));
        let is_undated = lasted.is_some_and(|lasted| lasted >= UNDATED_TIME);
        let was_undated = std::mem::replace(&mut self.is_undated, is_undated);
        match (was_known, clock.is_known) {
            (false, true) => Some(ClockEvent::Known { uncertainty: clock.uncertainty }),
            (true, false) => Some(ClockEvent::Unknown),
            (true, true) => relearned.then_some(ClockEvent::Stepped),
            (false, false) => (is_undated && !was_undated).then_some(ClockEvent::Undated),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gate::FrameStamp;
    use crate::stream::{FrameSink as _, MeasuredBody};
    use oqtal_config::Config;
    use oqtal_wire::motion::RigidPose;

    /// Receiver of two bodies, watched.
    struct Watched {
        receiver: PoseReceiver,
        watch: ReceiverWatch,
        now: Time,
        notes: Vec<ReceiverNote>,
    }

    impl Watched {
        fn new() -> Self {
            let receiver = PoseReceiver::new(&Config::default().receiver, 2);
            let watch = ReceiverWatch::new(2);
            Self { receiver, watch, now: Time::VIRTUAL_START, notes: Vec::new() }
        }

        /// Passes `seconds` with 100 frames a second at each of `gates`, with the stamp that `stamp_ns` gives a time \[ns\].
        fn pass(&mut self, seconds: i64, gates: usize, stamp_ns: fn(u64) -> Option<u64>) {
            for _ in 0..100 * seconds {
                self.now = self.now + Span::from_millis(10);
                for route in 0..2 {
                    let gate = if gates == 1 { 0 } else { route };
                    if route < gates {
                        let stamp =
                            FrameStamp { number: None, stamp_ns: stamp_ns(self.now.nanos()) };
                        self.receiver.frame(gate, stamp, self.now);
                    }
                    let pose = RigidPose::new([0.0; 3], [0.0, 0.0, 0.0, 1.0]);
                    let body = MeasuredBody { number: 1, pose, residual_m: 0.0 };
                    self.receiver.body(gate, route, body);
                }
                let Self { receiver, watch, now, notes } = self;
                watch.look(*now, (receiver, gates), &|_| true, &mut |note| notes.push(note));
            }
        }

        fn clock_events(&self) -> Vec<(Option<usize>, bool)> {
            let events = self.notes.iter().filter_map(|note| match note {
                ReceiverNote::Clock { body, event: ClockEvent::Undated } => Some((*body, true)),
                ReceiverNote::Clock { body, event: ClockEvent::Known { .. } } => {
                    Some((*body, false))
                }
                _ => None,
            });
            events.collect()
        }
    }

    #[test]
    fn frames_without_usable_stamps_are_noted_once_and_are_trouble() {
        for unusable in [|_| None, |_| Some(7_000_000_000), |now| Some(u64::MAX / 4 - now)] {
            let mut watched = Watched::new();
            watched.pass(1, 1, unusable);
            assert_eq!(watched.watch.trouble(1), Cause::None, "the clock is being estimated");
            watched.pass(4, 1, unusable);
            assert_eq!([0, 1].map(|route| watched.watch.trouble(route)), [Cause::NoStamps; 2]);
            watched.pass(2, 1, Some);
            assert_eq!(watched.clock_events(), [(None, true), (None, false)]);
            assert_eq!(watched.watch.trouble(1), Cause::None);
        }
    }

    #[test]
    fn the_clock_of_each_body_is_noted_if_each_has_its_own_stamps() {
        let mut watched = Watched::new();
        watched.pass(2, 2, Some);
        assert_eq!(watched.clock_events(), [(Some(0), false), (Some(1), false)]);
    }
}
