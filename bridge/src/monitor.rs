//! State of the vehicle from its replies: whether it answers, its battery, and the share of answered requests.

use oqtal_bus::code::VehicleRefusal;
use oqtal_bus::message::VehicleV1;
use oqtal_bus::text::ShortText;
use oqtal_bus::time::{Span, Time};

use crate::protocol::{ReportedMotors, VehicleEstimate, VehicleReply, VehicleText};
use crate::round_trips::RoundTrips;

/// Number of intervals in the last second, over which requests and answers are counted.
const INTERVALS: usize = 10;
const INTERVAL: Span = Span::from_millis(100);

/// Requests and answers of one interval.
#[derive(Clone, Copy, Debug, Default)]
struct Exchanges {
    requests: u32,
    answers: u32,
}

/// Monitor of the vehicle's replies.
#[derive(Clone, Debug)]
pub struct VehicleMonitor {
    /// Time without a valid reply after which the vehicle is silent.
    silence: Span,
    received_at: Time,
    battery_v: f64,
    estimate: VehicleEstimate,
    body_rate: [f64; 3],
    /// Arrival of that body rate.
    body_rate_at: Time,
    refusal: VehicleRefusal,
    text: ShortText,
    motors_run: bool,
    round_trips: RoundTrips,
    intervals: [Exchanges; INTERVALS],
    current: usize,
    current_began: Time,
}

impl VehicleMonitor {
    /// Monitor of a vehicle that has not replied yet; it is silent when no valid reply arrives for `silence`.
    pub fn new(silence: Span) -> Self {
        Self {
            silence,
            received_at: Time::UNSET,
            battery_v: f64::NAN,
            estimate: VehicleEstimate::UNKNOWN,
            body_rate: [0.0; 3],
            body_rate_at: Time::UNSET,
            refusal: VehicleRefusal::None,
            text: ShortText::EMPTY,
            motors_run: false,
            round_trips: RoundTrips::default(),
            intervals: [Exchanges::default(); INTERVALS],
            current: 0,
            current_began: Time::UNSET,
        }
    }

    /// Discards the state of the vehicle: a port was opened, and another vehicle may be connected to it.
    pub fn reset(&mut self) {
        *self = Self::new(self.silence);
    }

    /// Counts a frame that the vehicle should answer.
    pub fn count_request(&mut self, now: Time) {
        self.interval(now).requests += 1;
    }

    /// Takes a valid reply.
    pub fn receive(&mut self, now: Time, reply: VehicleReply) {
        if reply == VehicleReply::Replaced {
            self.reset();
        }
        if is_answer(&reply) {
            self.received_at = now;
            self.clear_if(is_of_another_vehicle);
        }
        match reply {
            VehicleReply::Answer => self.interval(now).answers += 1,
            VehicleReply::RoundTrip(span) => {
                self.interval(now).answers += 1;
                self.round_trips.record(span);
            }
            VehicleReply::Battery(volts) => self.battery_v = volts,
            VehicleReply::Motors(motors) => {
                let run = motors == ReportedMotors::Running;
                if run && !self.motors_run {
                    (self.refusal, self.text) = (VehicleRefusal::None, ShortText::EMPTY);
                } else if !motors.are_armed() {
                    self.clear_if(|refusal| refusal == VehicleRefusal::Disarming);
                }
                self.motors_run = run;
            }
            VehicleReply::Estimate(estimate) => self.estimate = estimate,
            VehicleReply::BodyRate(rate) if rate.iter().all(|axis| axis.is_finite()) => {
                (self.body_rate, self.body_rate_at) = (rate, now);
            }
            VehicleReply::Refused(refusal) => self.refusal = refusal,
            VehicleReply::Ready => {
                (self.refusal, self.text) = (VehicleRefusal::None, ShortText::EMPTY)
            }
            VehicleReply::Text(VehicleText { is_trouble: true, text }) => self.text = text,
            VehicleReply::BodyRate(_)
            | VehicleReply::Text(_)
            | VehicleReply::Control(_)
            | VehicleReply::Replaced
            | VehicleReply::Other => {}
        }
    }

    /// Clears a refusal that is over.
    fn clear_if(&mut self, is_over: impl Fn(VehicleRefusal) -> bool) {
        if is_over(self.refusal) {
            self.refusal = VehicleRefusal::None;
        }
    }

    /// Transmission time of a frame, from round trips; `None` if none is known.
    pub fn one_way(&self) -> Option<Span> {
        self.round_trips.one_way()
    }

    /// Reason why the vehicle did not execute the last request.
    pub fn refusal(&self) -> VehicleRefusal {
        self.refusal
    }

    /// The state of the vehicle at `now`, from its replies.
    pub fn state(&mut self, now: Time) -> VehicleV1 {
        VehicleV1 {
            battery_v: self.battery_v,
            link_quality: self.quality(now),
            estimate_position: self.estimate.position,
            estimate_attitude: self.estimate.attitude,
            body_rate: self.body_rate,
            body_rate_at: self.body_rate_at,
            answered_at: self.received_at,
            refusal: self.refusal.code(),
            estimator: self.estimate.state.code(),
            text: self.text,
            ..VehicleV1::default()
        }
    }

    /// Time without a valid reply after which the vehicle is silent.
    pub fn silence(&self) -> Span {
        self.silence
    }

    /// Whether a valid reply has arrived within the silence time.
    pub fn is_answering(&self, now: Time) -> bool {
        self.received_at.is_set() && now.since(self.received_at) <= self.silence
    }

    /// Share of the last second's requests that were answered \[-, 0..1\]; NaN if there was no request.
    pub fn quality(&mut self, now: Time) -> f64 {
        self.advance(now);
        let requests: u32 = self.intervals.iter().map(|interval| interval.requests).sum();
        let answers: u32 = self.intervals.iter().map(|interval| interval.answers).sum();
        // An answer may fall into a later interval than its request.
        if requests == 0 { f64::NAN } else { (f64::from(answers) / f64::from(requests)).min(1.0) }
    }

    fn interval(&mut self, now: Time) -> &mut Exchanges {
        self.advance(now);
        &mut self.intervals[self.current]
    }

    /// Advances to the interval that contains `now`; clears those in between.
    fn advance(&mut self, now: Time) {
        if now.since(self.current_began) >= INTERVAL.scaled(INTERVALS as f64) {
            self.intervals = [Exchanges::default(); INTERVALS];
            self.current_began = now;
        }
        while now.since(self.current_began) >= INTERVAL {
            self.current = (self.current + 1) % INTERVALS;
            self.intervals[self.current] = Exchanges::default();
            self.current_began = self.current_began + INTERVAL;
        }
    }
}

/// Whether `reply` comes from the wanted vehicle. `NoAnswer` does not: the bridge itself determines it.
fn is_answer(reply: &VehicleReply) -> bool {
    let VehicleReply::Refused(refusal) = *reply else { return true };
    refusal != VehicleRefusal::NoAnswer && !is_of_another_vehicle(refusal)
}

/// Whether a vehicle is refused as a whole: it is not the one that was asked for.
fn is_of_another_vehicle(refusal: VehicleRefusal) -> bool {
    use VehicleRefusal::{OtherAutopilot, OtherSystem, Unsigned};
    matches!(refusal, OtherAutopilot | OtherSystem | Unsigned)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATUS: VehicleReply = VehicleReply::Battery(11.1);

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    #[test]
    fn a_vehicle_is_silent_before_its_first_reply_and_a_while_after_its_last() {
        let mut vehicle = VehicleMonitor::new(Span::from_millis(1000));
        assert!(!vehicle.is_answering(at(0)) && vehicle.state(at(0)).battery_v.is_nan());
        vehicle.receive(at(0), STATUS);
        assert!(vehicle.is_answering(at(1000)) && !vehicle.is_answering(at(1001)));
        assert_eq!(vehicle.state(at(1)).battery_v, 11.1);
        vehicle.reset();
        assert!(!vehicle.is_answering(at(1)));
    }

    #[test]
    fn a_refusal_of_another_vehicle_or_to_disarm_ends_with_its_cause() {
        let mut vehicle = VehicleMonitor::new(Span::from_millis(1000));
        vehicle.receive(at(0), VehicleReply::Refused(VehicleRefusal::OtherAutopilot));
        vehicle.receive(at(1), STATUS);
        assert_eq!(vehicle.refusal(), VehicleRefusal::None, "the wanted vehicle answers");
        vehicle.receive(at(2), VehicleReply::Motors(ReportedMotors::Running));
        vehicle.receive(at(3), VehicleReply::Refused(VehicleRefusal::Disarming));
        for motors in [ReportedMotors::Running, ReportedMotors::SpoolingUp] {
            vehicle.receive(at(4), VehicleReply::Motors(motors));
            assert_eq!(vehicle.refusal(), VehicleRefusal::Disarming);
        }
        vehicle.receive(at(5), VehicleReply::Motors(ReportedMotors::Off));
        assert_eq!(vehicle.refusal(), VehicleRefusal::None, "the motors have stopped");
        vehicle.receive(at(6), VehicleReply::Refused(VehicleRefusal::Arming));
        vehicle.receive(at(7), VehicleReply::Motors(ReportedMotors::Off));
        assert_eq!(vehicle.refusal(), VehicleRefusal::Arming);
    }

    #[test]
    fn a_trouble_is_shown_until_the_motors_run_and_another_vehicle_does_not_answer() {
        let mut vehicle = VehicleMonitor::new(Span::from_millis(1000));
        for refusal in [VehicleRefusal::OtherSystem, VehicleRefusal::NoAnswer] {
            vehicle.receive(at(0), VehicleReply::Refused(refusal));
            assert!(!vehicle.is_answering(at(0)), "{refusal:?}");
        }
        let says = |is_trouble, text| {
            VehicleReply::Text(VehicleText { is_trouble, text: ShortText::new(text) })
        };
        vehicle.receive(at(1), VehicleReply::Refused(VehicleRefusal::Arming));
        vehicle.receive(at(2), says(true, "PreArm: Gyros inconsistent"));
        vehicle.receive(at(3), says(false, "ready"));
        let state = vehicle.state(at(4));
        assert_eq!(state.refusal, VehicleRefusal::Arming.code());
        assert_eq!(state.text.as_str(), "PreArm: Gyros inconsistent");
        vehicle.receive(at(5), VehicleReply::Motors(ReportedMotors::Running));
        let state = vehicle.state(at(6));
        assert!(state.text.is_empty() && state.refusal == VehicleRefusal::None.code());
        vehicle.receive(at(7), says(true, "Failsafe"));
        vehicle.receive(at(8), VehicleReply::Motors(ReportedMotors::Running));
        assert_eq!(vehicle.state(at(8)).text.as_str(), "Failsafe", "reported in flight");
    }

    #[test]
    fn quality_is_that_of_the_last_second() {
        let mut vehicle = VehicleMonitor::new(Span::from_millis(1000));
        assert!(vehicle.quality(at(0)).is_nan());
        for tick in 0..100 {
            vehicle.count_request(at(20 * tick));
            // In the second half, one request of five is answered.
            if tick < 50 || tick % 5 == 0 {
                vehicle.receive(at(20 * tick + 5), VehicleReply::Answer);
            }
        }
        assert!((vehicle.quality(at(1999)) - 0.2).abs() < 0.05, "{}", vehicle.quality(at(1999)));
        assert!(vehicle.quality(at(5000)).is_nan());
    }
}
