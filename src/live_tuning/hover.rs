//! A hover under a running daemon, observed while it is tuned.

use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::message::TelemetryV1;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Sample};
use oqtal_config::Config;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::recording::McapRecorder;
use oqtal_observe::sink::{Reception, Sink, Tee};
use oqtal_runtime::process::{Exit, Failure};

/// Time in which the vehicle comes to rest, or settles with other gains \[s\].
pub const SETTLE_S: f64 = 3.0;
/// Speed below which a reference is at rest along an axis \[m/s\].
const REST_M_S: f64 = 1e-3;
/// Polling period.
const POLL_PERIOD: Duration = Duration::from_millis(10);
/// Time without a tick after which the daemon is silent.
const SILENT: Span = Span::from_millis(500);

/// Observer of a vehicle that is to go on flying.
pub struct ObservedHover {
    observer: BusObserver,
    ticks: ObservedTicks,
    /// Flags of a command that addresses the instance.
    place: String,
}

/// The newest tick with the instant of its reception, and the squared position error of each tick \[m^2\].
#[derive(Default)]
struct ObservedTicks {
    newest: Option<(Time, TelemetryV1)>,
    squares: Vec<f64>,
}

impl Sink for ObservedTicks {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        if let Sample::Telemetry(tick) = sample {
            let pairs = tick.position.iter().zip(tick.reference_position);
            self.squares.push(pairs.map(|(at, reference)| (at - reference).powi(2)).sum());
            self.newest = Some((reception.received_at, *tick));
        }
    }

    fn lost(&mut self, _: ObservedTopic, _: u64) {}
}

impl ObservedHover {
    /// Observes the daemon of `bus`, which flies with `config`.
    pub fn open(bus: &Bus, config: &Config) -> Result<Self, Failure> {
        let bus = Bus::open(bus.paths())?.for_observer();
        let observer = BusObserver::open(&bus, &McapRecorder::topics(config))?;
        Ok(Self { observer, ticks: ObservedTicks::default(), place: bus.paths().flags() })
    }

    /// Observes the vehicle for `seconds`, and records its flight; fails as soon as it does not fly on undisturbed.
    pub fn follow(
        &mut self,
        seconds: f64,
        mut recorder: Option<&mut McapRecorder>,
    ) -> Result<(), Failure> {
        let began = Time::now();
        let end = began + Span::from_seconds(seconds);
        while Time::now() < end {
            std::thread::sleep(POLL_PERIOD);
            let now = Time::now();
            match recorder.as_deref_mut() {
                Some(recorder) => {
                    recorder.note_clock(now);
                    self.observer.poll(now, &mut Tee(recorder, &mut self.ticks))?;
                }
                None => self.observer.poll(now, &mut self.ticks)?,
            }
            if let Some((_, tick)) = &self.ticks.newest {
                require_nominal(tick, &self.place)?;
            }
            let newest_at =
                self.ticks.newest.map_or(began, |(received_at, _)| received_at.max(began));
            if now.since(newest_at) > SILENT {
                let place = &self.place;
                let reason =
                    format!("the daemon publishes no ticks; see `oqtal ctl status {place}`");
                return Err(Failure::new(Exit::Peer, reason));
            }
        }
        Ok(())
    }

    /// Whether the reference of the newest tick is at rest.
    pub fn is_at_rest(&self) -> bool {
        self.ticks.newest.as_ref().is_some_and(|(_, tick)| rests(tick))
    }

    /// Root mean square of the position error over `seconds` \[m\].
    pub fn error_m(&mut self, seconds: f64) -> Result<f64, Failure> {
        self.ticks.squares.clear();
        self.follow(seconds, None)?;
        let squares = &self.ticks.squares;
        Ok((squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
    }
}

/// Whether the reference of a tick is at rest; its velocity is NaN without a flight.
fn rests(tick: &TelemetryV1) -> bool {
    tick.reference_velocity.iter().all(|speed| speed.abs() < REST_M_S)
}

/// Fails unless the vehicle of the instance that the flags `place` address flies in the state Nominal.
fn require_nominal(tick: &TelemetryV1, place: &str) -> Result<(), Failure> {
    let (mode, state) = (Mode::from_code(tick.mode), SafetyState::from_code(tick.state));
    if mode != Some(Mode::Flying) {
        // Arming would be refused.
        let first = match Cause::from_code(tick.cause) {
            Some(Cause::Battery) => "its battery is low: change it, then ",
            _ => "",
        };
        let reason = format!(
            "the vehicle does not fly; {first}`oqtal ctl arm {place}`, and `oqtal ctl hover {place}` where it has room"
        );
        return Err(Failure::new(Exit::Flight, reason));
    }
    if state != Some(SafetyState::Nominal) {
        let state = state.map_or_else(|| "unknown".to_owned(), |state| state.to_string());
        let reason = format!(
            "the daemon is in the state {state}, tuning needs Nominal; see `oqtal ctl status {place}`"
        );
        return Err(Failure::new(Exit::Flight, reason));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vehicle_on_the_ground_with_a_low_battery_needs_another_before_it_is_armed() {
        let told = |cause: Cause| {
            let tick = TelemetryV1 { cause: cause.code(), ..TelemetryV1::default() };
            require_nominal(&tick, "").unwrap_err().message
        };
        assert!(told(Cause::Battery).contains("battery is low: change it, then `oqtal ctl arm"));
        assert!(!told(Cause::NoPose).contains("battery"));
    }

    #[test]
    fn a_reference_that_moves_or_is_missing_is_not_at_rest() {
        let rests = |speed| {
            let reference_velocity = [0.0, speed, 0.0];
            rests(&TelemetryV1 { reference_velocity, ..TelemetryV1::default() })
        };
        assert!(rests(0.0) && !rests(-0.05) && !rests(f64::NAN));
    }
}
