//! What the daemon knows of whatever carries its commands out: whether it answers, whether its motors are being started, whether
//! anything really flies.

use oqtal_bus::message::VehicleV1;
use oqtal_bus::time::{Span, Time};

/// Listens to the vehicle.
#[derive(Clone, Debug)]
pub struct VehicleWatch {
    /// An answer older than this is none.
    silence: Span,
    /// Motors that do not run for so long do not start.
    start: Span,
    heard: Option<(Time, VehicleV1)>,
    answered_at: Option<Time>,
    /// When the motors were last said to run since the flight began.
    ran_at: Option<Time>,
    /// Since when the flight has waited for the motors to be started, then for them to run.
    awaited_since: Option<Time>,
    /// Whether they were being started since the flight began.
    were_starting: bool,
    /// The process that spoke last, and whether it is another than when the flight began.
    speaker: Option<u64>,
    is_replaced: bool,
}

impl VehicleWatch {
    /// Nothing heard yet; after `silence` without an answer the vehicle is silent. What really flies has its motors started
    /// within `start`.
    #[must_use]
    pub fn new(silence: Span, start: Span) -> Self {
        Self {
            silence,
            start,
            heard: None,
            answered_at: None,
            ran_at: None,
            awaited_since: None,
            were_starting: false,
            speaker: None,
            is_replaced: false,
        }
    }

    /// Takes what process `source` says of the vehicle at `now`.
    pub fn hear(&mut self, now: Time, source: u64, vehicle: &VehicleV1) {
        self.is_replaced |= self.speaker.is_some_and(|speaker| speaker != source);
        self.speaker = Some(source);
        self.heard = Some((now, *vehicle));
        if vehicle.link != 0 {
            self.answered_at = Some(now);
        }
        if vehicle.armed != 0 && vehicle.starting == 0 {
            self.ran_at = Some(now);
        }
        if vehicle.starting != 0 && !self.were_starting {
            (self.were_starting, self.awaited_since) = (true, Some(now));
        }
    }

    /// A flight begins at `now`: the motors have not run in it.
    pub fn begin_flight(&mut self, now: Time) {
        (self.ran_at, self.is_replaced) = (None, false);
        (self.were_starting, self.awaited_since) = (false, Some(now));
    }

    /// The process that last spoke of the vehicle.
    #[must_use]
    pub fn speaker(&self) -> Option<u64> {
        self.speaker
    }

    /// Whether the vehicle answers, as of the last word about it, which is not old.
    #[must_use]
    pub fn answers(&self, now: Time) -> bool {
        !self.is_old(now, self.heard.map(|(at, _)| at))
            && self.heard.is_some_and(|(_, vehicle)| vehicle.link != 0)
    }

    /// Whether a flight cannot go on: no answer for too long, motors that ran and no longer do or that do not start, or a bridge
    /// that was restarted and knows nothing of a flight.
    #[must_use]
    pub fn is_lost(&self, now: Time) -> bool {
        let stands = self.ran_at.is_some() && self.is_old(now, self.ran_at);
        stands || self.is_replaced || self.is_old(now, self.answered_at) || self.does_not_start(now)
    }

    /// Whether the flight waits for the motors: while they are being started, and with what really flies until they run.
    #[must_use]
    pub fn holds_flight(&self) -> bool {
        let waits = |vehicle: &VehicleV1| vehicle.starting != 0 || vehicle.simulated == 0;
        self.ran_at.is_none() && self.heard.is_some_and(|(_, vehicle)| waits(&vehicle))
    }

    /// Whether the start of motors that never ran was given up, or takes too long.
    fn does_not_start(&self, now: Time) -> bool {
        let (None, Some(since), Some((_, vehicle))) = (self.ran_at, self.awaited_since, self.heard)
        else {
            return false;
        };
        let given_up = self.were_starting && vehicle.starting == 0;
        vehicle.simulated == 0 && (given_up || now.since(since) > self.start)
    }

    /// Whether nothing really flies; `None` before the vehicle was heard.
    #[must_use]
    pub fn is_simulated(&self) -> Option<bool> {
        self.heard.map(|(_, vehicle)| vehicle.simulated != 0)
    }

    fn is_old(&self, now: Time, instant: Option<Time>) -> bool {
        instant.is_none_or(|instant| now.since(instant) > self.silence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SILENCE: Span = Span::from_millis(500);
    const START: Span = Span::from_millis(3500);
    const BRIDGE: u64 = 4711;
    const WELL: VehicleV1 = VehicleV1 {
        command_sequence: 1,
        lost: 0,
        battery_v: 11.0,
        link_quality: 1.0,
        wire_ns: 0,
        air_ns: 0,
        armed: 0,
        starting: 0,
        link: 1,
        simulated: 0,
    };

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    #[test]
    fn a_vehicle_is_silent_before_its_first_word_and_after_its_last() {
        let mut watch = VehicleWatch::new(SILENCE, START);
        assert!(!watch.answers(at(0)) && watch.is_lost(at(0)));
        watch.hear(at(0), BRIDGE, &WELL);
        assert!(watch.answers(at(500)) && !watch.is_lost(at(500)));
        assert!(!watch.answers(at(501)) && watch.is_lost(at(501)));
    }

    #[test]
    fn a_broken_link_keeps_on_the_ground_at_once_and_ends_a_flight_later() {
        let mut watch = VehicleWatch::new(SILENCE, START);
        watch.hear(at(0), BRIDGE, &WELL);
        watch.hear(at(400), BRIDGE, &VehicleV1 { link: 0, ..WELL });
        assert!(!watch.answers(at(400)) && !watch.is_lost(at(400)));
        assert!(watch.is_lost(at(501)), "a bridge that speaks is not a vehicle that answers");
    }

    #[test]
    fn f18_a_bridge_restarted_in_flight_loses_the_vehicle_however_quick_it_is() {
        let mut watch = VehicleWatch::new(SILENCE, START);
        watch.hear(at(0), BRIDGE, &WELL);
        watch.begin_flight(at(0));
        watch.hear(at(17), BRIDGE, &WELL);
        assert!(!watch.is_lost(at(17)));
        watch.hear(at(34), BRIDGE + 1, &WELL);
        assert!(watch.is_lost(at(34)) && watch.answers(at(34)));
        watch.begin_flight(at(34));
        assert!(!watch.is_lost(at(34)));
    }

    #[test]
    fn motors_are_waited_for_once_and_when_they_stand_again_the_vehicle_is_lost() {
        let mut watch = VehicleWatch::new(SILENCE, START);
        let starting = VehicleV1 { starting: 1, ..WELL };
        watch.hear(at(0), BRIDGE, &starting);
        assert!(watch.holds_flight() && !watch.is_lost(at(0)));
        watch.hear(at(10), BRIDGE, &VehicleV1 { armed: 1, ..WELL });
        assert!(!watch.holds_flight());
        watch.hear(at(500), BRIDGE, &starting);
        assert!(!watch.holds_flight() && !watch.is_lost(at(510)));
        assert!(watch.is_lost(at(511)));
        watch.begin_flight(at(511));
        assert!(watch.holds_flight() && !watch.is_lost(at(511)));
    }
}
