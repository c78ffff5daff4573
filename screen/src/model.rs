//! The model that `oqtal monitor` shows: the model of the instance, and three quantities over time.

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
    /// Answer to the last request.
    pub answer: Option<String>,
}

impl MonitorModel {
    /// An empty model of the instance `name` at `now`.
    pub fn new(name: &str, now: Time) -> Self {
        let instance = InstanceModel::new(now, SILENCE);
        let name = name.to_owned();
        let (trends, keyboard) = (Trends::default(), Keyboard::default());
        Self { name, instance, trends, keyboard, answer: None }
    }

    /// Starts a new instant; to be called before the samples received at it.
    pub fn advance(&mut self, now: Time) {
        self.instance.advance(now);
        let Trends { error, thrust, latency } = &mut self.trends;
        [error, thrust, latency].into_iter().for_each(|trend| trend.advance(now));
    }
}

impl Sink for MonitorModel {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        let Trends { error, thrust, latency } = &mut self.trends;
        match sample {
            Sample::Telemetry(telemetry) => {
                thrust.add(telemetry.thrust * 100.0);
                error.add(tracking_error_m(telemetry).unwrap_or(f64::NAN));
            }
            Sample::Vehicle(vehicle) => {
                let stamps = &reception.header.stamps;
                if hops(stamps).is_some() {
                    let whole = sensor_to_actuator(stamps, OnwardTime::of(vehicle));
                    latency.add(whole.seconds() * 1e3);
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
