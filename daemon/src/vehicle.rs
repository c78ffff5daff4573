//! Monitor of the vehicle: whether it answers, whether its motors are being started, whether it is simulated.

use oqtal_bus::code::ControlHolder;
use oqtal_bus::message::VehicleV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::SafetyOptions;

/// Monitor of the vehicle, fed by topic `vehicle`.
#[derive(Clone, Debug)]
pub struct VehicleWatch {
    /// Age above which a reply of the vehicle no longer counts.
    silence: Span,
    /// Start-up time-out: motors that are not running after this time count as failed.
    start: Span,
    /// The last message, with the instant of its receipt.
    last: Option<(Time, VehicleV1)>,
    answered_at: Option<Time>,
    /// Last instant since the start of the flight at which the motors were reported running.
    ran_at: Option<Time>,
    /// Instant since which the flight waits for the start of the motors, then for the motors to run.
    awaited_since: Option<Time>,
    /// Whether the motors were reported starting since the start of the flight.
    were_starting: bool,
    /// The process that published the last message.
    source: Option<u64>,
    /// Number of the last message.
    number: u64,
    /// Whether the source has changed since the start of the flight.
    is_replaced: bool,
}

impl VehicleWatch {
    /// A monitor with the time-outs of `options`, before the first message.
    pub fn new(options: &SafetyOptions) -> Self {
        let millis = |millis: f64| Span::from_seconds(millis * 1e-3);
        Self {
            silence: millis(options.vehicle_silence_ms),
            start: millis(options.motor_start_ms),
            last: None,
            answered_at: None,
            ran_at: None,
            awaited_since: None,
            were_starting: false,
            source: None,
            number: 0,
            is_replaced: false,
        }
    }

    /// Whether message `number` follows the last one, so that none was missed.
    pub fn follows(&mut self, number: u64) -> bool {
        let last = std::mem::replace(&mut self.number, number);
        number == last + 1
    }

    /// Takes a message about the vehicle, published by process `source`, at `now`.
    pub fn receive(&mut self, now: Time, source: u64, vehicle: &VehicleV1) {
        self.is_replaced |= self.source.is_some_and(|known| known != source);
        self.source = Some(source);
        self.last = Some((now, *vehicle));
        if vehicle.answers() {
            self.answered_at = Some(now);
        }
        if vehicle.armed != 0 && vehicle.starting == 0 {
            self.ran_at = Some(now);
        }
        if vehicle.is_starting() && !self.were_starting {
            (self.were_starting, self.awaited_since) = (true, Some(now));
        }
    }

    /// Begins a flight at `now`: its motors have not run yet.
    pub fn begin_flight(&mut self, now: Time) {
        (self.ran_at, self.is_replaced) = (None, false);
        (self.were_starting, self.awaited_since) = (false, Some(now));
    }

    /// The process that published the last message.
    pub fn source(&self) -> Option<u64> {
        self.source
    }

    /// Whether the vehicle answers, by the last message, which is not too old.
    pub fn answers(&self, now: Time) -> bool {
        !self.is_old(now, self.last.map(|(at, _)| at))
            && self.last.is_some_and(|(_, vehicle)| vehicle.answers())
    }

    /// The last message about the vehicle, if it is not too old, whether the vehicle answers or not.
    pub fn last_message(&self, now: Time) -> Option<&VehicleV1> {
        self.last.as_ref().filter(|(at, _)| !self.is_old(now, Some(*at))).map(|(_, last)| last)
    }

    /// The last message about the vehicle, if it answers.
    pub fn answer(&self, now: Time) -> Option<&VehicleV1> {
        self.last.as_ref().map(|(_, vehicle)| vehicle).filter(|_| self.answers(now))
    }

    /// Whether a flight must end: no reply for too long, or a bridge that was restarted and has no state of the flight.
    pub fn is_lost(&self, now: Time) -> bool {
        self.is_replaced || self.is_old(now, self.answered_at)
    }

    /// Whether the vehicle behind a bridge has not replied since `at`, by the last message.
    pub fn is_silent_since(&self, at: Time) -> bool {
        self.last
            .is_some_and(|(_, vehicle)| vehicle.answered_at.is_set() && vehicle.answered_at < at)
    }

    /// Whether a flight must end: motors that stopped, or that do not start.
    pub fn has_no_motors(&self, now: Time) -> bool {
        let stands = self.ran_at.is_some() && self.is_old(now, self.ran_at);
        stands || self.does_not_start(now)
    }

    /// Whether a pilot or the vehicle itself has control, by the last message.
    pub fn control_is_taken(&self) -> bool {
        let another = ControlHolder::Another.code();
        self.last.is_some_and(|(_, vehicle)| vehicle.control == another)
    }

    /// Whether the flight waits for the motors: while they are being started, and with a real vehicle until they run.
    pub fn holds_flight(&self) -> bool {
        let waits = |vehicle: &VehicleV1| vehicle.starting != 0 || vehicle.simulated == 0;
        self.ran_at.is_none() && self.last.is_some_and(|(_, vehicle)| waits(&vehicle))
    }

    /// Whether the start of the motors was given up or takes too long, if they have not run yet.
    fn does_not_start(&self, now: Time) -> bool {
        let (None, Some(since), Some((_, vehicle))) = (self.ran_at, self.awaited_since, self.last)
        else {
            return false;
        };
        let given_up = self.were_starting && vehicle.starting == 0;
        vehicle.simulated == 0 && (given_up || now.since(since) > self.start)
    }

    /// Share of answered requests to the vehicle, by the last message \[0..1\]; NaN before it and without a radio.
    pub fn link_quality(&self) -> f64 {
        self.last.map_or(f64::NAN, |(_, vehicle)| vehicle.link_quality)
    }

    /// Whether the vehicle is simulated; `None` before the first message.
    pub fn is_simulated(&self) -> Option<bool> {
        self.last.map(|(_, vehicle)| vehicle.simulated != 0)
    }

    /// Time of a command on the vehicle's wire, as last reported; 0 without a wire.
    pub fn wire(&self) -> Span {
        self.last.map_or(Span::ZERO, |(_, vehicle)| Span::from_nanos(vehicle.wire_ns))
    }

    fn is_old(&self, now: Time, instant: Option<Time>) -> bool {
        instant.is_none_or(|instant| now.since(instant) > self.silence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BRIDGE: u64 = 4711;
    const WELL: VehicleV1 = VehicleV1 {
        command_sequence: 1,
        lost: 0,
        battery_v: 11.0,
        link_quality: 1.0,
        wire_ns: 0,
        air_ns: 0,
        estimate_position: [f64::NAN; 3],
        estimate_attitude: [0.0; 4],
        body_rate: [0.0; 3],
        body_rate_at: Time::UNSET,
        answered_at: Time::UNSET,
        time_out_s: 0.0,
        armed: 0,
        starting: 0,
        stopped: 0,
        link: 1,
        simulated: 0,
        control: 0,
        refusal: 0,
        estimator: 0,
        text: oqtal_bus::text::ShortText::EMPTY,
    };

    /// Silent after 500 ms; motors start within 3500 ms.
    fn watch() -> VehicleWatch {
        VehicleWatch::new(&oqtal_config::Config::default().safety)
    }

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    #[test]
    fn a_vehicle_is_silent_before_its_first_message_and_after_its_last() {
        let mut watch = watch();
        assert!(!watch.answers(at(0)) && watch.is_lost(at(0)));
        watch.receive(at(0), BRIDGE, &WELL);
        assert!(watch.answers(at(500)) && !watch.is_lost(at(500)));
        assert!(!watch.answers(at(501)) && watch.is_lost(at(501)));
    }

    #[test]
    fn a_vehicle_behind_a_bridge_is_silent_after_its_last_reply_and_another_never_is() {
        let mut watch = watch();
        watch.receive(at(0), BRIDGE, &WELL);
        assert!(!watch.is_silent_since(at(10)));
        watch.receive(at(110), BRIDGE, &VehicleV1 { answered_at: at(100), ..WELL });
        assert!(!watch.is_silent_since(at(100)) && watch.is_silent_since(at(101)));
    }

    /// Commands in between were lost only if no message between the last one and this one was.
    #[test]
    fn a_message_follows_the_last_one_unless_one_was_missed() {
        let mut watch = watch();
        let follows = [1, 2, 4, 5, 5].map(|number| watch.follows(number));
        assert_eq!(follows, [true, true, false, true, false]);
    }

    #[test]
    fn a_broken_link_keeps_on_the_ground_at_once_and_ends_a_flight_later() {
        let mut watch = watch();
        watch.receive(at(0), BRIDGE, &WELL);
        watch.receive(at(400), BRIDGE, &VehicleV1 { link: 0, ..WELL });
        assert!(!watch.answers(at(400)) && !watch.is_lost(at(400)));
        assert!(watch.is_lost(at(501)), "a bridge that publishes is not a vehicle that answers");
    }

    #[test]
    fn f18_a_bridge_restarted_in_flight_loses_the_vehicle_however_quick_it_is() {
        let mut watch = watch();
        watch.receive(at(0), BRIDGE, &WELL);
        watch.begin_flight(at(0));
        watch.receive(at(17), BRIDGE, &WELL);
        assert!(!watch.is_lost(at(17)));
        watch.receive(at(34), BRIDGE + 1, &WELL);
        assert!(watch.is_lost(at(34)) && watch.answers(at(34)));
        watch.begin_flight(at(34));
        assert!(!watch.is_lost(at(34)));
    }

    #[test]
    fn f36_motors_are_awaited_once_and_end_the_flight_when_they_stop_again() {
        let mut watch = watch();
        let starting = VehicleV1 { starting: 1, ..WELL };
        watch.receive(at(0), BRIDGE, &starting);
        assert!(watch.holds_flight() && !watch.has_no_motors(at(0)));
        watch.receive(at(10), BRIDGE, &VehicleV1 { armed: 1, ..WELL });
        assert!(!watch.holds_flight());
        watch.receive(at(500), BRIDGE, &starting);
        assert!(!watch.holds_flight() && !watch.has_no_motors(at(510)));
        assert!(watch.has_no_motors(at(511)) && !watch.is_lost(at(511)));
        watch.begin_flight(at(511));
        assert!(watch.holds_flight() && !watch.has_no_motors(at(511)));
    }
}
