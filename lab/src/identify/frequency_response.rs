//! Frequency responses from the commanded to the flown rates, with their coherence, beside those of the fitted model.
//!
//! The loop is closed: noise to which the controller responds is in the command and in the rate, and their ratio would tend to the inverse
//! of the controller. The response is therefore the ratio of the cross-spectra of rate and command with the prescribed attitude, which is
//! independent of noise (Ljung, *System Identification*, 2nd ed., 1999, chapter 13).

use std::f64::consts::TAU;
use std::ops::Range;

use maud::{Markup, html};
use nalgebra::{Complex, Vector3};
use oqtal_control::euler::shorter_turn;
use oqtal_control::statistics::median;
use oqtal_observe::plot::axis::Axis;
use oqtal_observe::plot::chart::{Mark, Plot};
use oqtal_observe::plot::figure::{HALF, figure};
use oqtal_observe::plot::palette::Ink;
use oqtal_observe::plot::trace::Point;

use super::data::{CommandRecord, FlightData, PoseRecord};
use super::rotation::RotationModel;

/// Number of samples of a segment \[-\]: 4.3 s at 60 Hz.
const SEGMENT: usize = 256;
/// Least coherence at which a measured response is shown \[0..1\].
const EXCITED: f64 = 0.5;
/// Greatest frequency that is shown, over the rate of the poses \[-\].
const MOST: f64 = 0.25;
const AXES: [&str; 3] = ["roll", "pitch", "yaw"];
const SIZE: (u32, u32) = (HALF, 420);
const LABEL_WIDTH: u32 = 110;

/// The response at one frequency.
#[derive(Clone, Copy, Debug)]
pub struct ResponsePoint {
    /// Frequency \[Hz\].
    pub hz: f64,
    /// Rate over command, in units of the rate at full stick \[-\].
    pub measured: Complex<f64>,
    /// That of the fitted model \[-\].
    pub model: Complex<f64>,
    /// Coherence of prescribed attitude and rate \[0..1\]: 1 if the rate follows from what the trajectory prescribes.
    pub coherence: f64,
}

impl ResponsePoint {
    /// Whether the trajectory excites this frequency.
    fn is_excited(&self) -> bool {
        self.coherence >= EXCITED
    }
}

/// Frequency response of each axis, estimated by Welch's method from half-overlapping segments with Hann's window. Command, rate and
/// the rate of the prescribed attitude are means over the same intervals between poses, so that the intervals do not appear in the
/// response. Empty if the flight is shorter than two segments, or if the trajectory excites no frequency of the axis.
pub fn responses(data: &FlightData, model: &RotationModel) -> [Vec<ResponsePoint>; 3] {
    let intervals: Vec<&[PoseRecord]> = data.air.windows(2).collect();
    let Some(period_s) = median(intervals.iter().map(|pair| duration(pair))) else {
        return Default::default();
    };
    std::array::from_fn(|axis| {
        let commands = held(&data.commands, &intervals, axis);
        let rates: Vec<f64> = intervals.iter().map(|pair| rate(pair, axis)).collect();
        let prescribed = prescribed(&data.prescribed, &intervals, axis);
        let points = response([&prescribed, &commands, &rates], (period_s, axis), model);
        if points.iter().any(ResponsePoint::is_excited) { points } else { Vec::new() }
    })
}

/// Mean rate of the prescribed attitude over each interval \[rad/s\].
fn prescribed(
    attitudes: &[(f64, Vector3<f64>)],
    intervals: &[&[PoseRecord]],
    axis: usize,
) -> Vec<f64> {
    let at = |time_s: f64| {
        let after = attitudes.partition_point(|(tick_s, _)| *tick_s <= time_s);
        attitudes.get(after.saturating_sub(1)).map_or(0.0, |(_, attitude)| attitude[axis])
    };
    let rate = |pair: &&[PoseRecord]| {
        let turned: f64 = at(pair[1].captured_s) - at(pair[0].captured_s);
        shorter_turn(turned) / duration(pair)
    };
    intervals.iter().map(rate).collect()
}

fn duration(pair: &[PoseRecord]) -> f64 {
    pair[1].captured_s - pair[0].captured_s
}

/// Mean rate between two poses \[rad/s, body\].
fn rate(pair: &[PoseRecord], axis: usize) -> f64 {
    pair[0].attitude.rotation_to(&pair[1].attitude)[axis] / duration(pair)
}

/// Mean stick over each interval \[-1..1\]; a command holds until the next one.
fn held(commands: &[CommandRecord], intervals: &[&[PoseRecord]], axis: usize) -> Vec<f64> {
    let mut first = 0;
    let mean = |pair: &&[PoseRecord]| {
        let (from, to) = (pair[0].captured_s, pair[1].captured_s);
        while first + 1 < commands.len() && commands[first + 1].sent_s <= from {
            first += 1;
        }
        let mut sum = 0.0;
        for (k, command) in commands.iter().enumerate().skip(first) {
            let end_s = commands.get(k + 1).map_or(to, |next| next.sent_s).min(to);
            let begin_s = if k == first { from } else { command.sent_s };
            sum += command.sticks[axis] * (end_s - begin_s).max(0.0);
            if end_s >= to {
                break;
            }
        }
        sum / (to - from)
    };
    intervals.iter().map(mean).collect()
}

fn response(
    [prescribed, commands, rates]: [&[f64]; 3],
    (period_s, axis): (f64, usize),
    model: &RotationModel,
) -> Vec<ResponsePoint> {
    let starts: Vec<usize> = (0..)
        .map(|k| k * SEGMENT / 2)
        .take_while(|start| start + SEGMENT <= commands.len())
        .collect();
    if starts.len() < 3 {
        return Vec::new();
    }
    let authority = model.authority[axis];
    let point = |bin: usize| {
        let [mut to_command, mut to_rate] = [Complex::new(0.0, 0.0); 2];
        let [mut input, mut output] = [0.0; 2];
        for start in &starts {
            let part = |values: &[f64]| component(&values[*start..start + SEGMENT], bin);
            let (source, rate) = (part(prescribed), part(rates) / authority);
            to_command += source.conj() * part(commands);
            to_rate += source.conj() * rate;
            input += source.norm_sqr();
            output += rate.norm_sqr();
        }
        let hz = bin as f64 / (SEGMENT as f64 * period_s);
        let measured = to_rate / to_command;
        let coherence = to_rate.norm_sqr() / (input * output);
        ResponsePoint { hz, measured, model: of_model(model, hz), coherence }
    };
    (1..(MOST * SEGMENT as f64) as usize).map(point).collect()
}

/// Component of `values`, without their mean, at `bin` periods per segment, under Hann's window.
fn component(values: &[f64], bin: usize) -> Complex<f64> {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let turn = TAU / values.len() as f64;
    let term = |(k, value): (usize, &f64)| {
        let window = 0.5 - 0.5 * (turn * k as f64).cos();
        Complex::from_polar(window * (value - mean), -turn * (bin * k) as f64)
    };
    values.iter().enumerate().map(term).sum()
}

/// Response of the model: a delay and two lags.
fn of_model(model: &RotationModel, hz: f64) -> Complex<f64> {
    let omega = TAU * hz;
    let lag = |s: f64| Complex::new(1.0, omega * s).inv();
    let delay_s = model.delay_s - model.fast_s;
    Complex::from_polar(1.0, -omega * delay_s) * lag(model.lag_s) * lag(model.fast_s)
}

/// Reason why an axis has no response.
fn no_response(data: &FlightData, axis: usize) -> String {
    let (from_s, until_s) = match (data.air.first(), data.air.last()) {
        (Some(first), Some(last)) => (first.captured_s, last.captured_s),
        _ => return "the flight has no poses in the air.".to_owned(),
    };
    let in_air = data.prescribed.iter().filter(|(at_s, _)| (from_s..=until_s).contains(at_s));
    let mut angles = in_air.map(|(_, attitude)| attitude[axis]);
    let first = angles.next().unwrap_or_default();
    if angles.all(|angle| shorter_turn(angle - first) == 0.0) {
        return "the trajectory excites no frequency, and without that the closed loop shows no response of the vehicle."
            .to_owned();
    }
    if data.air.len() <= 2 * SEGMENT {
        return format!("the flight is shorter than two segments of {SEGMENT} poses.");
    }
    format!(
        "the coherence of prescribed attitude and rate over the whole flight is below {EXCITED} at every frequency: no response is shown."
    )
}

/// Gain, phase and coherence of each axis.
pub fn figures(data: &FlightData, model: &RotationModel) -> Markup {
    let responses = responses(data, model);
    html! {
        @for (number, axis) in AXES.iter().enumerate().filter(|(number, _)| responses[*number].is_empty()) {
            p.note { (axis) ": " (no_response(data, number)) }
        }
        @for (axis, points) in AXES.iter().zip(&responses).filter(|(_, points)| !points.is_empty()) {
            (both(&format!("{axis}: gain [dB], of the rate at full stick"), points, |point| {
                [point.model, point.measured].map(|gain| 20.0 * gain.norm().log10())
            }))
            (both(&format!("{axis}: phase [°]"), points, continuous_phase()))
            (coherence(&format!("{axis}: coherence of prescribed attitude and rate"), points))
        }
    }
}

/// Phases of model and measurement \[deg\]: that of the model without jumps from one point to the next, that of the measurement within
/// half a turn of it.
fn continuous_phase() -> impl FnMut(&ResponsePoint) -> [f64; 2] {
    let mut last = 0.0;
    move |point| {
        let near = |gain: Complex<f64>, other: f64| {
            let degrees = gain.arg().to_degrees();
            degrees - 360.0 * ((degrees - other) / 360.0).round()
        };
        last = near(point.model, last);
        [last, near(point.measured, last)]
    }
}

/// Figure of a value of the model and the measured one at each frequency.
fn both(
    title: &str,
    points: &[ResponsePoint],
    mut values: impl FnMut(&ResponsePoint) -> [f64; 2],
) -> Markup {
    let [mut model, mut measured]: [Vec<Point>; 2] = Default::default();
    for point in points {
        let [of_model, seen] = values(point).map(|value| (point.hz.log10(), value));
        model.push(of_model);
        measured.extend(point.is_excited().then_some(seen));
    }
    let y = Axis::fitting(measured.iter().chain(&model).map(|point| point.1));
    let discs = measured.into_iter().map(|at| Mark::Disc(Ink::Second, at));
    let shapes: Vec<Mark> = discs.chain([Mark::Line(Ink::Actual, 3, model)]).collect();
    let legend = [("model", Ink::Actual), ("measured", Ink::Second)];
    figure(title, &legend, &over_frequency(range(points), y, shapes))
}

fn coherence(title: &str, points: &[ResponsePoint]) -> Markup {
    let line = points.iter().map(|point| (point.hz.log10(), point.coherence)).collect();
    let shapes = vec![Mark::Line(Ink::Third, 3, line)];
    figure(title, &[], &over_frequency(range(points), Axis::linear(0.0..1.0, 5.0, ""), shapes))
}

/// Logarithms of the first and the last frequency.
fn range(points: &[ResponsePoint]) -> Range<f64> {
    points[0].hz.log10()..points[points.len() - 1].hz.log10()
}

/// Plot over the decimal logarithm of the frequency, whose `range` it includes.
pub fn over_frequency(range: Range<f64>, y: Axis, shapes: Vec<Mark>) -> Plot {
    let x = Axis::decades(range, |decade| format!("{} Hz", 10_f64.powi(decade)));
    Plot { size: SIZE, label_width: LABEL_WIDTH, x, y, shapes }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;
    use oqtal_control::quaternion::Attitude;

    const PERIOD_S: f64 = 1.0 / 60.0;

    /// Responses of a vehicle whose roll follows the sticks after two samples, without a lag, under a proportional law that responds to
    /// noise of `noise_rad`, and the prescribed roll, a random walk of `size_rad`.
    fn flown(noise_rad: f64, size_rad: f64) -> (FlightData, [Vec<ResponsePoint>; 3]) {
        let mut random = SplitMix64::new(1);
        let mut noise = || random.between(-0.5, 0.5);
        let (mut data, mut sticks) = (FlightData::default(), [0.0; 2]);
        let [mut prescribed, mut angle] = [0.0; 2];
        for k in 0..3000 {
            let at_s = f64::from(k) * PERIOD_S;
            prescribed += size_rad * noise();
            let measured = angle + noise_rad * noise();
            let stick = 2.0 * (prescribed - measured);
            let sticks_now = Vector3::new(stick, 0.0, 0.0);
            data.prescribed.push((at_s, Vector3::x() * prescribed));
            data.commands.push(CommandRecord { sent_s: at_s, sticks: sticks_now, thrust: 0.5 });
            data.air.push(PoseRecord {
                captured_s: at_s,
                latency_s: 0.0,
                position: Vector3::zeros(),
                attitude: Attitude::from_rotation_vector(Vector3::x() * measured),
            });
            angle += 2.0 * PERIOD_S * sticks[0];
            sticks = [sticks[1], stick];
        }
        let authority = Vector3::new(2.0, 2.0, 2.0);
        let (delay_s, bias) = (2.0 * PERIOD_S, Vector3::zeros());
        let model = RotationModel { delay_s, lag_s: 0.0, fast_s: 0.0, authority, bias };
        let responses = responses(&data, &model);
        (data, responses)
    }

    #[test]
    fn the_phase_of_a_delay_does_not_jump() {
        let mut phases = continuous_phase();
        for step in 1..30 {
            let gain = Complex::from_polar(1.0, -0.3 * f64::from(step));
            let point = ResponsePoint { hz: 1.0, measured: gain, model: gain, coherence: 1.0 };
            for degrees in phases(&point) {
                assert!((degrees + (0.3 * f64::from(step)).to_degrees()).abs() < 1e-9, "{degrees}");
            }
        }
    }

    #[test]
    fn the_response_of_a_pure_delay_has_its_gain_and_phase_and_full_coherence() {
        let (data, [roll, pitch, _]) = flown(0.0, 0.02);
        for point in &roll {
            assert!((point.measured - point.model).norm() < 0.05, "{point:?}");
            assert!(point.coherence > 0.95, "{point:?}");
        }
        assert!(roll.len() > 50 && pitch.is_empty());
        assert!(no_response(&data, 1).contains("excites no frequency"));
    }

    #[test]
    fn feedback_of_noise_does_not_take_the_place_of_the_vehicle() {
        let (_, [roll, ..]) = flown(3e-3, 0.02);
        let excited = roll.iter().filter(|point| point.is_excited());
        for point in excited.clone() {
            assert!((point.measured - point.model).norm() < 0.3, "{point:?}");
        }
        assert!(excited.count() > 20);
        let (data, [roll, ..]) = flown(3e-3, 0.0);
        assert!(roll.is_empty(), "nothing but the noise moves the vehicle");
        assert!(no_response(&data, 0).contains("excites no frequency"));
        let (data, [roll, ..]) = flown(0.3, 1e-4);
        assert!(roll.is_empty(), "the noise hides the motion");
        assert!(no_response(&data, 0).contains("coherence"), "{}", no_response(&data, 0));
    }
}
