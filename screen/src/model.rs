//! The model that `oqtal monitor` shows: the model of the instance, and three quantities over time.

use oqtal_bus::message::TelemetryV1;
use oqtal_bus::time::Time;
use oqtal_bus::topic::{ObservedTopic, Sample};
use oqtal_observe::instance::{InstanceModel, tracking_error_m};
use oqtal_observe::latency::{OnwardTime, hops, sensor_to_actuator};
use oqtal_observe::sink::{Reception, Sink};
use oqtal_runtime::health::SILENCE;

use crate::keys::Keyboard;
use crate::trend::Trend;

/// Quantities that are shown over time.
#[derive(Debug, Default)]
pub struct Trends {
    /// Distance of the estimated position from the reference, in flight \[m\].
    pub error: Trend,
    /// Collective thrust sent \[percent of the vehicle's maximum\].
    pub thrust: Trend,
    /// Time from the capture of a pose to its effect on the vehicle \[ms\].
    pub latency: Trend,
}

/// Model of the observed instance.
#[derive(Debug)]
pub struct MonitorModel {
    /// Name of the instance.
    pub name: String,
    /// The instance.
    pub instance: InstanceModel,
    /// Quantities over time.
    pub trends: Trends,
    /// Keys, with the request being typed.
    pub keyboard: Keyboard,
    /// Answer to the last request, until another flight begins or another daemon is seen.
    pub answer: Option<ShownAnswer>,
    /// Source of the daemon's newest tick, and whether a mission was active in it.
    daemon: Option<(u64, bool)>,
}

/// Answer to a request.
#[derive(Debug)]
pub struct ShownAnswer {
    /// Whether it answers `arm`, so that the flight that begins next belongs to it.
    is_of_arm: bool,
    /// Time of day and text of the answer.
    pub text: String,
}

impl ShownAnswer {
    /// The answer `text` to `request`, received at `at`.
    pub fn at(at: Time, request: &str, text: &str) -> Self {
        let second = (at + Time::wall_offset()).nanos() / 1_000_000_000;
        let [hours, minutes, seconds] = [second / 3600 % 24, second / 60 % 60, second % 60];
        let is_of_arm = request.split_whitespace().next() == Some("arm");
        Self { is_of_arm, text: format!("{hours:02}:{minutes:02}:{seconds:02} UTC: {text}") }
    }
}

impl MonitorModel {
    /// An empty model of the instance `name` at `now`.
    pub fn new(name: &str, now: Time) -> Self {
        let instance = InstanceModel::new(now, SILENCE);
        let name = name.to_owned();
        let (trends, keyboard) = (Trends::default(), Keyboard::default());
        Self { name, instance, trends, keyboard, answer: None, daemon: None }
    }

    /// Starts a new instant; to be called before the samples received at it.
    pub fn advance(&mut self, now: Time) {
        self.instance.advance(now);
        let Trends { error, thrust, latency } = &mut self.trends;
        [error, thrust, latency].into_iter().for_each(|trend| trend.advance(now));
    }

    /// Shows the answer `text` to `request`, received at `now`. It belongs to the next flight only if none has begun.
    pub fn show_answer(&mut self, now: Time, request: &str, text: &str) {
        let is_armed = self.daemon.is_some_and(|(_, is_armed)| is_armed);
        let answer = ShownAnswer::at(now, request, text);
        self.answer = Some(ShownAnswer { is_of_arm: answer.is_of_arm && !is_armed, ..answer });
    }

    /// Removes the answer if the tick belongs to another flight or another daemon.
    fn forget_answer(&mut self, reception: &Reception, telemetry: &TelemetryV1) {
        let (source, is_armed) = (reception.header.source, telemetry.is_armed());
        let before = self.daemon.replace((source, is_armed));
        let Some((daemon, was_armed)) = before else { return };
        let begins = is_armed && !was_armed;
        // The answer to `arm` belongs to the flight that begins, and not to the next one.
        self.answer.take_if(|answer| {
            daemon != source || (begins && !std::mem::take(&mut answer.is_of_arm))
        });
    }
}

impl Sink for MonitorModel {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        match sample {
            Sample::Telemetry(telemetry) => {
                self.forget_answer(reception, telemetry);
                self.trends.thrust.add(telemetry.thrust * 100.0);
                self.trends.error.add(tracking_error_m(telemetry).unwrap_or(f64::NAN));
            }
            Sample::Vehicle(vehicle) => {
                let stamps = &reception.header.stamps;
                if hops(stamps).is_some() {
                    let whole = sensor_to_actuator(stamps, OnwardTime::of(vehicle));
                    self.trends.latency.add(whole.seconds() * 1e3);
                }
            }
            _ => {}
        }
        self.instance.sample(reception, sample);
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        self.instance.lost(topic, count);
    }
}
