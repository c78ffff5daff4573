//! Reasons why a flight did not end as planned.

use oqtal_bus::code::{Cause, HandoverCause, SafetyState};
use oqtal_bus::obstacle::ArmingObstacles;
use oqtal_bus::time::Time;
use oqtal_config::{ClockKind, FaultTarget};
use oqtal_control::trajectory::Phase;

use crate::command_path::CommandPath;
use crate::crash::{Crash, beyond};
use crate::flight::{Flight, HELD, Outcome};
use crate::flight_sample::FlightSample;
use crate::reservation::LONGEST_TICK;

/// Distance beyond the fence from which the true vehicle counts as outside \[m\].
const OUTSIDE_M: f64 = 0.05;

impl Flight {
    /// Reason why the flight did not end as planned: an operator or the daemon landed or stopped the vehicle, it crashed, or
    /// there was no take-off. `None` for a complete flight, and for an outcome that needs no reason.
    pub fn shortfall(&self) -> Option<String> {
        let reasons: Vec<_> = self.shortfall_of_one().into_iter().chain(self.excursion()).collect();
        let own = (!reasons.is_empty()).then(|| reasons.join("; "));
        match (self.reservation(), &own) {
            (None, _) => own,
            // Of several flights the figures are of all, the reason is of one.
            (Some(reservation), Some(own))
                if self.crash.is_some() || self.flights().count() < 2 =>
            {
                Some(format!("{own}; {reservation}"))
            }
            (reservation, _) => reservation,
        }
    }

    /// How far the true vehicle left the fence, as text; `None` if it did not. The poses of the daemon may differ.
    fn excursion(&self) -> Option<String> {
        let outside_m = self.outside_m();
        let is_told = outside_m > OUTSIDE_M && !matches!(self.crash, Some((_, Crash::Lost { .. })));
        is_told.then(|| format!("the vehicle was up to {outside_m:.2} m outside the fence"))
    }

    /// Greatest distance of the true vehicle beyond the box around the fence \[m\].
    fn outside_m(&self) -> f64 {
        let true_samples = self.armed().filter(|sample| sample.truth.is_some());
        let outside = |sample: &FlightSample| beyond(&self.config.fence, &sample.position());
        true_samples.map(outside).fold(0.0, f64::max)
    }

    fn shortfall_of_one(&self) -> Option<String> {
        let (when, ended) = (self.when(), self.ended());
        match self.outcome {
            Outcome::Stopped | Outcome::Timeout | Outcome::Unfinished
                if self.armed().next().is_none() =>
            {
                Some(self.without_flight())
            }
            Outcome::Landed => match self.early_landing().map(cause_of) {
                Some(cause) => Some(format!(
                    "the daemon landed the vehicle before the end of the flight: {cause}"
                )),
                None if self.take_over().is_some() => self.taken_over(),
                None if self.lacks_take_off() => Some(format!("ended{when}, before the take-off")),
                None => self.landing_on_request(),
            },
            Outcome::Stopped => Some(match (self.stop_cause(), self.stops_at_once()) {
                (cause @ Cause::NoVehicle, _) => format!(
                    "the daemon commanded the motors off{ended}: {cause}, so it is unknown when they stopped"
                ),
                (Cause::Operator, true) => {
                    let landing = self.landing_before(Some(Cause::Operator));
                    format!("an operator stopped the motors{ended}{landing}")
                }
                (cause, at_once) => {
                    let what =
                        if at_once { "stopped the motors" } else { "commanded the motors off" };
                    let landing = self.landing_before(Some(cause));
                    format!("the daemon {what}{ended}: {cause}{landing}")
                }
            }),
            Outcome::Crashed => {
                let (silence, landing) = (self.silence(), self.landing_before(None));
                Some(format!("the vehicle {}{ended}{silence}{landing}", self.crash?.1))
            }
            Outcome::Timeout => Some(format!(
                "the flight lasted too long and was ended{when}: it began late, or was held up, as by the fence"
            )),
            Outcome::Unfinished => Some(self.unfinished(&when)),
            Outcome::Replayed | Outcome::Observed => None,
        }
    }

    /// Reason why the record ends in flight; `when` is the instant, as text.
    fn unfinished(&self, when: &str) -> String {
        if self.ends_with_law() {
            return format!("the flight was ended{when}: the law ended");
        }
        if self.lacks_take_off() {
            return format!("the daemon or the record ended{when}, before the take-off");
        }
        format!(
            "the record ends{when}, before the flight did: another file continues it, a process of the flight ended, or the recording was cut off"
        )
    }

    /// Whether the flight ended with its law: in one process nobody could connect another one.
    fn ends_with_law(&self) -> bool {
        self.config.clock.kind == ClockKind::InProcess && self.answers.unconnected > 0
    }

    /// Cause for which the daemon was landing the vehicle, as text; empty if it was not, or for the cause `known`.
    fn landing_before(&self, known: Option<Cause>) -> String {
        let cause = self.early_landing().map(cause_of).filter(|cause| Some(*cause) != known);
        cause.map_or_else(String::new, |cause| {
            format!("; the daemon was landing the vehicle: {cause}")
        })
    }

    /// Time for which a vehicle behind a bridge had not replied when it crashed, as text; empty if the daemon tolerates it.
    fn silence(&self) -> String {
        let answered_at = self.wire.latest().map(|vehicle| vehicle.answered_at);
        let (Some((at, _)), Some(answered_at)) = (self.crash, answered_at) else {
            return String::new();
        };
        let silent_s = at.since(answered_at).seconds();
        let is_silent =
            answered_at.is_set() && silent_s * 1e3 > self.config.safety.vehicle_silence_ms;
        if is_silent { format!("; it had not answered for {silent_s:.2} s") } else { String::new() }
    }

    /// Reason why there was no take-off.
    fn without_flight(&self) -> String {
        let unflown = "nothing was flown: the motors were never armed";
        let stopped = "nothing was flown: stopped before the motors were armed";
        match self.outcome {
            Outcome::Unfinished => return format!("{unflown} in this recording"),
            Outcome::Stopped => return format!("{stopped} ({})", self.stop_cause()),
            _ => {}
        }
        let last = self.samples.last().map(|sample| &sample.telemetry);
        let reasons = ArmingObstacles::from_bits(last.map_or(0, |last| last.obstacles));
        let cause = last.and_then(|last| Cause::from_code(last.cause)).unwrap_or(Cause::None);
        match (reasons.is_empty(), cause) {
            (true, _) => "no take-off: the daemon gives no reason".to_owned(),
            (false, Cause::None) => format!("no take-off: {reasons}"),
            (false, cause) => format!("no take-off: {reasons} ({cause})"),
        }
    }

    /// Reason, as returned by [`Flight::shortfall`], without instants and figures, so that flights with the same reason can be counted;
    /// `None` for a flight that landed as planned.
    pub fn cause(&self) -> Option<String> {
        Some(match (self.outcome, self.crash) {
            (Outcome::Landed, _) => match self.early_landing() {
                Some(sample) => format!("landed by the daemon: {}", cause_of(sample)),
                None if self.take_over().is_some() => "landing taken over".to_owned(),
                None if self.lacks_take_off() => "ended before the take-off".to_owned(),
                None if self.landing_on_request().is_some() => "landed on request".to_owned(),
                None if self.outside_m() > OUTSIDE_M => "outside the fence".to_owned(),
                None => self.is_held().then(|| HELD.to_owned())?,
            },
            (Outcome::Stopped, _) if self.stops_at_once() => {
                format!("motors stopped: {}", self.stop_cause())
            }
            (Outcome::Stopped, _) => format!("motors commanded off: {}", self.stop_cause()),
            (Outcome::Crashed, Some((_, crash))) => crash.name().to_owned(),
            (Outcome::Timeout, _) if self.armed().next().is_none() => "no take-off".to_owned(),
            (Outcome::Timeout, _) => "not ended in time".to_owned(),
            (Outcome::Unfinished, _) if self.ends_with_law() => HandoverCause::Ended.to_string(),
            (outcome, _) => outcome.to_string(),
        })
    }

    /// Whether the motors stop in the tick that commands it: a bridge takes time to stop them, a silent vehicle does not report it, and
    /// with an injected fault the command may not reach it.
    fn stops_at_once(&self) -> bool {
        let mut faults = self.config.fault.inject.iter();
        self.command_path == CommandPath::Bus
            && !matches!(self.stop_cause(), Cause::NoVehicle | Cause::MotorsNotRunning)
            && !faults.any(|it| matches!(it.target, FaultTarget::Command | FaultTarget::Radio))
    }

    /// Cause of the last tick in Stop of the first flight or after it, before another one; ticks that follow the end of a flight may
    /// have another state.
    fn stop_cause(&self) -> Cause {
        let is_stopped = |s: &&FlightSample| s.telemetry.state == SafetyState::Stop.code();
        let mut parts = self.samples.chunk_by(|a, b| a.is_armed() == b.is_armed());
        let flight = parts.by_ref().find(|part| part[0].is_armed());
        let (flight, after) = (flight.unwrap_or(&self.samples), parts.next().unwrap_or_default());
        let stopped = flight.iter().chain(after).rev().find(is_stopped);
        stopped.map_or(Cause::None, cause_of)
    }

    /// Whether the fence held the vehicle before its landing.
    fn is_held(&self) -> bool {
        self.samples.iter().any(FlightSample::is_held)
    }

    /// Instant of the last armed tick, as text; empty without one.
    fn when(&self) -> String {
        let last = self.armed().last();
        last.map_or_else(String::new, |last| self.after_arming(last.telemetry.time))
    }

    /// Instant at which the flight ended, as text: that of the crash or of the last armed tick, or the interval without ticks just before
    /// or after it.
    fn ended(&self) -> String {
        let is_last = |sample: &FlightSample| match self.crash {
            Some((at, _)) => sample.telemetry.time <= at,
            None => sample.is_armed(),
        };
        let Some(last) = self.samples.iter().rposition(is_last) else { return String::new() };
        let time = |index: usize| self.samples[index].telemetry.time;
        let next = (last + 1).min(self.samples.len() - 1);
        let pairs = [(last.saturating_sub(1), last), (last, next)];
        let gap = pairs.into_iter().find(|(from, to)| time(*to).since(time(*from)) > LONGEST_TICK);
        let has_daemon = !matches!(self.crash, Some((_, Crash::DaemonDied)));
        match gap.filter(|_| has_daemon) {
            Some((from, to)) => {
                let pause_s = time(to).since(time(from)).seconds();
                let until = self.after_arming(time(to));
                format!(
                    "{until}, after {pause_s:.2} s without a tick, during which the vehicle may have stopped its motors by itself"
                )
            }
            // The tick after the last armed one stopped the motors.
            None if self.outcome == Outcome::Stopped => self.after_arming(time(next)),
            None => self.after_arming(time(last)),
        }
    }

    /// The instant `at` as text.
    fn after_arming(&self, at: Time) -> String {
        let seconds = at.since(self.origin()).seconds();
        match self.begins_in_flight() {
            true => format!(" at {seconds:.2} s of the record, which begins in flight"),
            false => format!(" {seconds:.2} s after arming"),
        }
    }

    /// Part of the trajectory flown before a landing requested by an operator; `None` without such a landing.
    pub fn landing_on_request(&self) -> Option<String> {
        let is_other = self.early_landing().or_else(|| self.take_over()).is_some();
        if is_other || self.lacks_take_off() {
            return None;
        }
        let landing = self.armed().find(|s| s.telemetry.phase == Phase::Landing as u8)?.telemetry;
        let planned_s = landing.planned_landing_s;
        let period_s = 1.0 / self.config.loop_rate_hz();
        // The landing begins in the tick after its planned instant.
        if planned_s.is_nan() || landing.mission_s > planned_s - period_s {
            return None;
        }
        // An operator changed the flight, which then had no planned landing.
        if planned_s.is_infinite() {
            return Some(format!("landed, as requested{}", self.after_arming(landing.time)));
        }
        let options = &self.config.trajectory;
        let before_s = options.start_s();
        let [flown_s, of_s] = [landing.mission_s, planned_s].map(|t_s| (t_s - before_s).max(0.0));
        let record = if self.begins_in_flight() { "; the record begins in flight" } else { "" };
        Some(format!(
            "landed on request after {flown_s:.1} of {of_s:.1} s of the trajectory{record}"
        ))
    }

    /// Cause for which the daemon took over a landing, as text; `None` if it did not.
    fn taken_over(&self) -> Option<String> {
        let cause = cause_of(self.take_over()?);
        Some(format!("the daemon took over the landing: {cause}"))
    }

    /// Tick in which the daemon took over a landing that was planned or requested, for a cause that requires more than a landing.
    fn take_over(&self) -> Option<&FlightSample> {
        self.armed().find(|sample| {
            let lands_anyway = matches!(cause_of(sample), Cause::Battery | Cause::Operator);
            sample.is_ended_by_daemon() && !lands_anyway
        })
    }

    /// Tick in which the daemon itself began to land earlier than planned; `None` without an early landing.
    fn early_landing(&self) -> Option<&FlightSample> {
        let mut last = Phase::TakeOff as u8;
        self.armed().find(|sample| {
            let was_landing = std::mem::replace(&mut last, sample.telemetry.phase);
            sample.is_ended_by_daemon() && was_landing != Phase::Landing as u8
        })
    }
}

fn cause_of(sample: &FlightSample) -> Cause {
    Cause::from_code(sample.telemetry.cause).unwrap_or(Cause::None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::fixture;
    use oqtal_bus::code::Mode;
    use oqtal_bus::message::{Header, VehicleV1};
    use oqtal_bus::time::Span;

    /// Tilt and speed of a crash are those of the instant that is named with them, not of the end of the flight.
    #[test]
    fn a_crash_is_told_with_its_own_instant() {
        let mut flight = fixture::square();
        let at = flight.origin() + Span::from_millis(5000);
        let crash = Crash::TurnedOver { tilt_deg: 81.0 };
        (flight.outcome, flight.crash) = (Outcome::Crashed, Some((at, crash)));
        let told = flight.shortfall().unwrap();
        assert_eq!(told, "the vehicle turned over, tilt 81 deg 5.00 s after arming");
        let answered_at = at - Span::from_millis(1500);
        let vehicle = VehicleV1 { answered_at, ..VehicleV1::default() };
        flight.wire.vehicle(&Header::default(), &vehicle, true);
        let told = flight.shortfall().unwrap();
        assert!(told.ends_with("after arming; it had not answered for 1.50 s"), "{told}");
    }

    #[test]
    fn a_crash_in_a_landing_of_the_daemon_names_the_cause_of_the_landing() {
        let mut flight = fixture::square();
        let at = flight.samples[1000].telemetry.time;
        (flight.outcome, flight.crash) = (Outcome::Crashed, Some((at, Crash::Hard { speed: 2.0 })));
        assert!(!flight.shortfall().unwrap().contains("landing"));
        let ticks = flight.samples.iter_mut().filter(|s| s.telemetry.mission_s > 15.0);
        for FlightSample { telemetry, .. } in ticks {
            telemetry.state = SafetyState::Land.code();
            telemetry.cause = Cause::Battery.code();
        }
        let told = flight.shortfall().unwrap();
        assert!(told.ends_with("; the daemon was landing the vehicle: battery low"), "{told}");
    }

    #[test]
    fn a_gap_in_the_record_and_a_vehicle_outside_the_fence_are_told() {
        let whole = Flight { outcome: Outcome::Landed, ..fixture::square() };
        assert_eq!(whole.shortfall(), None);
        let is_lost = |s: &FlightSample| (12.0..16.0).contains(&s.telemetry.mission_s);
        let mut without_ticks = whole.clone();
        without_ticks.samples.retain(|sample| !is_lost(sample));
        let mut without_truth = whole.clone();
        let lost = without_truth.samples.iter_mut().filter(|sample| is_lost(sample));
        lost.for_each(|sample| sample.truth = None);
        for flight in [without_ticks, without_truth] {
            let told = flight.shortfall().unwrap();
            assert!(told.starts_with("4.0") && told.contains("s of the flight are not"), "{told}");
        }
        let mut outside = whole;
        let index = outside.samples.len() / 2;
        let truth = outside.samples[index].truth.as_mut().unwrap();
        truth.position[1] = outside.config.fence.y_m[1] + 1.0;
        let told = outside.shortfall().unwrap();
        assert_eq!(told, "the vehicle was up to 1.00 m outside the fence");
        assert_eq!(outside.cause().unwrap(), "outside the fence");
    }

    #[test]
    fn a_stop_of_motors_that_were_never_armed_did_not_end_a_flight() {
        let mut flight = fixture::square();
        flight.outcome = Outcome::Stopped;
        for FlightSample { telemetry, .. } in &mut flight.samples {
            telemetry.mode = Mode::Disarmed.code();
            telemetry.state = SafetyState::Stop.code();
            telemetry.cause = Cause::Operator.code();
        }
        let told = format!("stopped before the motors were armed ({})", Cause::Operator);
        assert_eq!(flight.shortfall().unwrap(), format!("nothing was flown: {told}"));
    }

    #[test]
    fn a_flight_that_ended_before_its_take_off_is_not_as_planned() {
        let mut flight = fixture::square();
        flight.samples.truncate(20);
        assert!(flight.shortfall().unwrap().ends_with("after arming, before the take-off"));
        assert_eq!(flight.landing_on_request(), None);
        assert_eq!(flight.cause().unwrap(), "ended before the take-off");
    }

    #[test]
    fn a_landing_that_the_daemon_takes_over_is_not_as_planned() {
        let mut flight = fixture::square();
        flight.outcome = Outcome::Landed;
        assert_eq!(flight.shortfall(), None);
        let is_landing =
            |s: &&mut FlightSample| s.is_armed() && s.telemetry.phase == Phase::Landing as u8;
        let last = flight.samples.iter_mut().filter(is_landing).last().unwrap();
        last.telemetry.state = SafetyState::Land.code();
        last.telemetry.cause = Cause::Tracking.code();
        let told = flight.shortfall().unwrap();
        assert!(told.starts_with("the daemon took over the landing: "), "{told}");
    }
}
