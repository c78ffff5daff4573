//! Detection of the end of a flight, tick by tick.

use oqtal_bus::code::{Mode, SafetyState};
use oqtal_bus::time::{Span, Time};
use oqtal_config::FenceOptions;
use oqtal_control::trajectory::Phase;

use crate::crash::{AT_FLOOR_M, AT_REST_M_S, Crash};
use crate::flight::{MISSED_ARMING_S, Outcome};
use crate::flight_sample::FlightSample;

/// Time at rest after which the flight has ended.
const REST: Span = Span::from_millis(500);

/// State of the detection.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FlightEnd {
    /// Outcome of the flight; `None` while it lasts.
    pub outcome: Option<Outcome>,
    /// Instant and cause of a crash.
    pub crash: Option<(Time, Crash)>,
    /// Whether the vehicle was armed in a tick.
    pub flown: bool,
    /// Whether another simulator took the place of the first one since the motors were started: its vehicle is another one.
    pub is_replaced: bool,
    /// The tick before.
    last: Option<FlightSample>,
    /// Whether the record begins with a stop: it is of an earlier flight.
    begins_stopped: bool,
    resting_since: Option<Time>,
    /// Height of the floor \[m, world z\]: that of the vehicle at arming, as in the daemon; 0 for a record that begins in flight.
    floor_m: f64,
}

impl FlightEnd {
    /// Takes the next tick of a flight inside `fence`.
    pub fn tick(&mut self, sample: &FlightSample, fence: &FenceOptions) {
        let before = self.last.replace(*sample);
        self.begins_stopped |= before.is_none() && is_stopped(sample);
        // A stop before the first flight is the end of an earlier one.
        if self.outcome.is_some() && (self.flown || !sample.is_armed()) {
            return;
        }
        if sample.is_armed() && !before.is_some_and(|before| before.is_armed()) {
            let is_on_floor = sample.telemetry.phase == Phase::TakeOff as u8
                && sample.telemetry.mission_s <= MISSED_ARMING_S;
            self.floor_m = if is_on_floor { sample.position().z } else { 0.0 };
        }
        self.detect((before.as_ref(), sample), fence);
        let touchdown = before.filter(|_| self.outcome.is_none() && self.flown);
        let crash = |before| Crash::at_touchdown(&before, sample, self.floor_m);
        if let Some(crash) = touchdown.and_then(crash) {
            self.crashed(sample.telemetry.time, crash);
        }
    }

    /// Whether the vehicle of the present flight is off the floor in `sample`.
    pub fn has_risen(&self, sample: &FlightSample) -> bool {
        sample.position().z > self.floor_m + AT_FLOOR_M
    }

    /// Outcome at the end of the record: a vehicle that rests after its flight has landed.
    pub fn at_end(&self) -> Option<Outcome> {
        self.outcome.or(self.resting_since.map(|_| Outcome::Landed))
    }

    /// Records a crash at the instant `at`.
    pub fn crashed(&mut self, at: Time, crash: Crash) {
        (self.outcome, self.crash) = (Some(Outcome::Crashed), Some((at, crash)));
    }

    /// Ends the flight if this tick ends it.
    fn detect(
        &mut self,
        (before, sample): (Option<&FlightSample>, &FlightSample),
        fence: &FenceOptions,
    ) {
        if sample.is_armed() {
            if self.resting_since.is_some() {
                // The vehicle was armed again before the landing was confirmed by its rest.
                self.outcome = Some(Outcome::Landed);
                return;
            }
            (self.flown, self.outcome) = (true, None);
            let crash = Crash::of((before, sample), fence, self.floor_m);
            if let Some(crash) = crash.filter(|_| !self.is_replaced) {
                self.crashed(sample.telemetry.time, crash);
            }
            return;
        }
        // A stop that is in force when the recording begins is of an earlier flight.
        let is_of_earlier = !self.flown && self.begins_stopped;
        if is_stopped(sample) && !is_of_earlier {
            self.outcome = Some(Outcome::Stopped);
            return;
        }
        // Without a stop, the daemon disarms only after a landing, at whatever height.
        let is_at_rest = self.flown
            && sample.telemetry.mode == Mode::Disarmed.code()
            && sample.velocity().norm() < AT_REST_M_S;
        let now = sample.telemetry.time;
        self.resting_since = is_at_rest.then(|| self.resting_since.unwrap_or(now));
        if self.resting_since.is_some_and(|since| now.since(since) >= REST) {
            self.outcome = Some(Outcome::Landed);
        }
    }
}

fn is_stopped(sample: &FlightSample) -> bool {
    sample.telemetry.state == SafetyState::Stop.code()
}

#[cfg(test)]
mod tests {
    use oqtal_bus::message::TelemetryV1;
    use oqtal_config::Config;

    use super::*;

    /// End of a flight, tick by tick of 20 ms: mode, phase, height \[m, world z\] and vertical velocity \[m/s\].
    fn flown(ticks: &[(Mode, Phase, f64, f64)]) -> FlightEnd {
        let (config, mut end) = (Config::default(), FlightEnd::default());
        for (k, (mode, phase, height, climb)) in ticks.iter().enumerate() {
            let time = Time::VIRTUAL_START + Span::from_millis(20).scaled(k as f64);
            let telemetry = TelemetryV1 {
                time,
                mode: mode.code(),
                phase: *phase as u8,
                mission_s: 0.02 * k as f64,
                position: [0.0, 0.0, *height],
                velocity: [0.0, 0.0, *climb],
                attitude: [0.0, 0.0, 0.0, 1.0],
                ..TelemetryV1::default()
            };
            end.tick(&FlightSample { telemetry, truth: None }, &config.fence);
        }
        end
    }

    #[test]
    fn a_flight_ends_at_rest_on_the_ground_at_whatever_height_that_is() {
        use Mode::{Disarmed, Flying, Landing};
        for (floor, ground) in [(0.0, 0.0), (0.08, 0.08), (-0.4, -0.4), (0.08, 0.7)] {
            let mut ticks = vec![
                (Flying, Phase::TakeOff, floor, 0.0),
                (Flying, Phase::Trajectory, floor + 0.3, 0.0),
                (Landing, Phase::Landing, ground + 0.03, -0.2),
            ];
            ticks.extend([(Disarmed, Phase::Landing, ground, 0.0); 25]);
            assert_eq!(flown(&ticks).outcome, None, "{floor} {ground}");
            ticks.push((Disarmed, Phase::Landing, ground, 0.0));
            assert_eq!(flown(&ticks).outcome, Some(Outcome::Landed), "{floor} {ground}");
            // A touchdown that is hard, and a contact in flight.
            ticks[2].3 = -2.0;
            let crash = flown(&ticks).crash.map(|(_, crash)| crash);
            let is_of_floor = floor == ground;
            assert_eq!(crash, is_of_floor.then_some(Crash::Hard { speed: 2.0 }));
            ticks[1].2 = floor;
            assert_eq!(flown(&ticks).crash.map(|(_, crash)| crash), Some(Crash::Floor));
        }
    }

    #[test]
    fn a_vehicle_may_fly_below_the_table_on_which_it_was_armed() {
        let flying = |height, climb| (Mode::Flying, Phase::Trajectory, height, climb);
        let mut ticks = vec![(Mode::Flying, Phase::TakeOff, 0.7, 0.0)];
        ticks.extend(
            [(1.0, 0.0), (0.7, -1.0), (0.6, 0.0), (0.68, 0.0), (0.7, 0.5)]
                .map(|(z, v)| flying(z, v)),
        );
        assert_eq!(flown(&ticks).outcome, None);
        ticks.push(flying(0.005, -1.0));
        assert_eq!(flown(&ticks).crash.map(|(_, crash)| crash), Some(Crash::Floor));
    }

    #[test]
    fn a_record_that_begins_in_flight_has_the_floor_at_zero() {
        let of = |height| flown(&[(Mode::Flying, Phase::Trajectory, height, 0.0)]).outcome;
        assert_eq!((of(1.0), of(0.0)), (None, Some(Outcome::Crashed)));
    }
}
