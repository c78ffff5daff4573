//! Flown loop: a sine is added to the commands where they take effect, and the response of the law is measured.
//!
//! With `u` the input commanded by the law and `v` the input in effect, the loop gain is `-u / v` at the frequency of the sine. The
//! adaptation is off, since the loop is not linear with it.

use std::f64::consts::TAU;

use nalgebra::Complex;
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_observe::flight::Flight;
use oqtal_runtime::process::{Exit, Failure};
use rayon::prelude::*;

use super::frequency::LoopResponse;
use crate::mission::Mission;
use crate::simulation;

/// Duration of the prescribed attitude \[s\].
const SWEEP_S: f64 = 12.0;
/// Duration of a hover, whose first 10 s are not scored \[s\].
const HOVER_S: f64 = SWEEP_S + 10.0;
/// Time after which the motion is steady \[s\].
const TRANSIENT_S: f64 = 4.0;
/// Time over which the sines are measured: a whole number of periods of each \[s\].
const MEASURED_S: f64 = 6.0;
/// Numbers of periods within [`MEASURED_S`]: frequencies of 0.5 to 14 Hz.
const PERIODS: [u32; 27] = [
    3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 19, 21, 23, 26, 29, 33, 37, 42, 48, 56,
    66, 84,
];
/// Amplitude of the sine \[-\]: far below full stick, far above rounding errors.
const AMPLITUDE: f64 = 0.02;

/// Settings without random motion.
const CALM: [(&str, f64); 5] = [
    ("plant.gust-sd-m-s2", 0.0),
    ("plant.disturbance-spread", 0.0),
    ("plant.spread", 0.0),
    ("mocap.position-noise-mm", 0.0),
    ("mocap.attitude-noise-deg", 0.0),
];

/// Loops that are closed while the response is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClosedLoops {
    /// The attitude loop: the prescribed attitude is level, and the position loop open.
    Attitude,
    /// Attitude and position loops: the vehicle hovers.
    Hover,
}

/// Loop response of a law with `settings` about axis number `axis`.
///
/// # Errors
/// A setting is invalid, a flight did not land, or the loop is unstable.
pub fn flown(
    settings: &[Setting],
    (axis, loops): (usize, ClosedLoops),
) -> Result<LoopResponse, Failure> {
    let config = prepared(settings, (axis, loops))?;
    let points: Result<Vec<_>, Failure> = PERIODS
        .par_iter()
        .map(|periods| {
            let hertz = f64::from(*periods) / MEASURED_S;
            Ok((hertz, at(&config, axis, hertz)?))
        })
        .collect();
    Ok(LoopResponse { points: points? })
}

/// Settings without noise, drift, gusts, disturbances and faults; the filters still assume the noise of `nominal`.
pub fn calm(nominal: &Config) -> Vec<Setting> {
    let set = |key: &str, value: toml::Value| Setting::flag("calm", key, value);
    let still = || toml::Value::from(vec![0.0; 3]);
    let filter = &nominal.control.predictive.filter;
    let quiet = CALM.into_iter().map(|(key, value)| set(key, value.into()));
    let own = [
        set("plant.rate-drift-deg-s", still()),
        set("plant.force-n", still()),
        set("plant.disturb", toml::Value::Array(Vec::new())),
        set("fault.inject", toml::Value::Array(Vec::new())),
        set("control.predictive.filter.attitude-noise-deg", filter.attitude_noise_deg.into()),
        set("control.predictive.filter.position-noise-mm", filter.position_noise_mm.into()),
    ];
    quiet.chain(own).collect()
}

fn prepared(settings: &[Setting], (axis, loops): (usize, ClosedLoops)) -> Result<Config, Failure> {
    let nominal = Config::from_settings(settings)?;
    let mut settings = [settings, &calm(&nominal)].concat();
    let mut set = |key: &str, value: toml::Value| settings.push(Setting::flag("probe", key, value));
    // The adaptation would attribute an uncommanded sine to the vehicle.
    set("control.predictive.adaptation.adapt", false.into());
    match loops {
        ClosedLoops::Attitude => {
            set("trajectory.kind", "attitude-chirp".into());
            set("trajectory.duration-s", SWEEP_S.into());
            set("trajectory.attitude-chirp.sweep-s", SWEEP_S.into());
            // Level up to rounding.
            set("trajectory.attitude-chirp.amplitude-deg", 1e-9.into());
        }
        ClosedLoops::Hover => {
            set("trajectory.kind", "hover".into());
            set("trajectory.duration-s", HOVER_S.into());
        }
    }
    set("plant.probe.stick", (axis as i64 + 1).into());
    set("plant.probe.amplitude", AMPLITUDE.into());
    Ok(Config::from_settings(&settings)?)
}

/// The loop gain at a frequency \[Hz\].
fn at(config: &Config, axis: usize, hertz: f64) -> Result<Complex<f64>, Failure> {
    let mut config = config.clone();
    config.plant.probe.frequency_hz = hertz;
    let flight = simulation::fly(&Mission::new(config)?)?;
    let gain = gain(&flight, axis, hertz).filter(|gain| gain.re.is_finite() && gain.im.is_finite());
    gain.ok_or_else(|| {
        let cause = flight
            .cause()
            .unwrap_or_else(|| "the loop is unstable, or too few ticks are scored".to_owned());
        Failure::new(Exit::Flight, format!("no loop gain at {hertz:.2} Hz: {cause}"))
    })
}

/// Loop gain of the flight; `None` unless the sticks follow the sine alone, as those of an unstable loop do not.
fn gain(flight: &Flight, axis: usize, hertz: f64) -> Option<Complex<f64>> {
    let applied = flight.applied.last()?.stamps;
    // The sine is added when a command acts, which is later than its stamp.
    let hidden = Span::from_seconds(1e-3 * flight.config.plant.hidden_delay_ms);
    let delay = applied.applied_at.since(applied.command_published_at) + hidden;
    let begin =
        flight.scored().next()?.telemetry.time.since(Time::VIRTUAL_START).seconds() + TRANSIENT_S;
    let (mut commanded, mut acting) = (Complex::from(0.0), Complex::from(0.0));
    let (mut ticks, mut sum, mut square_sum) = (0, 0.0, 0.0);
    for sample in flight.scored() {
        let at = sample.telemetry.time.since(Time::VIRTUAL_START);
        let seconds = at.seconds() - begin;
        // Half a tick from both ends, so that rounding of instants does not count a tick twice.
        let half = 0.5 / flight.config.loop_rate_hz();
        if !(-half..MEASURED_S - half).contains(&seconds) {
            continue;
        }
        let sine = AMPLITUDE * (TAU * hertz * (at + delay).seconds()).sin();
        let stick = sample.telemetry.sticks[axis];
        let turn = Complex::from_polar(1.0, -TAU * hertz * seconds);
        commanded += turn * stick;
        acting += turn * (stick + sine);
        ticks += 1;
        sum += stick;
        square_sum += stick * stick;
    }
    let count = f64::from(ticks);
    let expected = MEASURED_S * flight.config.loop_rate_hz();
    let other = square_sum / count - (sum / count).powi(2) - 2.0 * (commanded / count).norm_sqr();
    // Variance besides mean and sine, against that of the added sine, half the square of its amplitude.
    let is_steady = other < 0.5 * AMPLITUDE * AMPLITUDE;
    (is_steady && (count - expected).abs() < 1.5).then(|| -commanded / acting)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disturbances_and_faults_of_the_study_are_left_out() {
        let settings = ["plant.disturb=['gust@16+3=3,0,0m/s']", "fault.inject=['pose:off@15+1']"]
            .map(|text| Setting::parse("test", text).unwrap());
        let given = Config::from_settings(&settings).unwrap();
        let config = prepared(&settings, (0, ClosedLoops::Hover)).unwrap();
        assert!(!given.plant.disturb.is_empty() && !given.fault.inject.is_empty());
        assert!(config.plant.disturb.is_empty() && config.fault.inject.is_empty());
    }
}
