//! Frequency responses from the commanded to the flown rates, with their coherence, beside those of the fitted model.

use std::f64::consts::TAU;

use maud::{Markup, html};
use nalgebra::{Complex, UnitQuaternion};
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
    /// Coherence of command and rate \[0..1\]: 1 if the rate is explained by the command alone.
    pub coherence: f64,
}

/// Frequency response of each axis, estimated by Welch's method from half-overlapping segments with Hann's window. Command and
/// rate are means over the same intervals between poses, so that the intervals do not appear in the response. Empty if the flight
/// is shorter than two segments.
pub fn responses(data: &FlightData, model: &RotationModel) -> [Vec<ResponsePoint>; 3] {
    let intervals: Vec<&[PoseRecord]> = data.air.windows(2).collect();
    let Some(period_s) = median(intervals.iter().map(|pair| duration(pair))) else {
        return Default::default();
    };
    std::array::from_fn(|axis| {
        let commands = held(&data.commands, &intervals, axis);
        let rates: Vec<f64> = intervals.iter().map(|pair| rate(pair, axis)).collect();
        response(&commands, &rates, (period_s, axis), model)
    })
}

fn duration(pair: &[PoseRecord]) -> f64 {
    pair[1].captured_s - pair[0].captured_s
}

/// Mean rate between two poses \[rad/s, body\].
fn rate(pair: &[PoseRecord], axis: usize) -> f64 {
    let turned: UnitQuaternion<f64> =
        pair[0].attitude.unit_quaternion().inverse() * pair[1].attitude.unit_quaternion();
    turned.scaled_axis()[axis] / duration(pair)
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
    commands: &[f64],
    rates: &[f64],
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
        let (mut across, mut input, mut output) = (Complex::new(0.0, 0.0), 0.0, 0.0);
        for start in &starts {
            let segment = *start..start + SEGMENT;
            let command = component(&commands[segment.clone()], bin);
            let rate = component(&rates[segment], bin) / authority;
            across += command.conj() * rate;
            input += command.norm_sqr();
            output += rate.norm_sqr();
        }
        let hz = bin as f64 / (SEGMENT as f64 * period_s);
        let measured = across / input;
        let coherence = across.norm_sqr() / (input * output);
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

/// Gain, phase and coherence of each axis.
pub fn figures(data: &FlightData, model: &RotationModel) -> Markup {
    let responses = responses(data, model);
    html! {
        @for (axis, points) in AXES.iter().zip(&responses).filter(|(_, points)| !points.is_empty()) {
            (both(&format!("{axis}: gain [dB], of the rate at full stick"), points, |gain| {
                20.0 * gain.norm().log10()
            }))
            (both(&format!("{axis}: phase [°]"), points, |gain| {
                let degrees = gain.arg().to_degrees();
                // From 90 down: the phase of a delay does not jump at -180.
                if degrees > 90.0 { degrees - 360.0 } else { degrees }
            }))
            (coherence(&format!("{axis}: coherence of command and rate"), points))
        }
    }
}

fn both(title: &str, points: &[ResponsePoint], value: impl Fn(Complex<f64>) -> f64) -> Markup {
    let of = |of: fn(&ResponsePoint) -> Complex<f64>| -> Vec<Point> {
        points.iter().map(|point| (point.hz.log10(), value(of(point)))).collect()
    };
    let discs = of(|point| point.measured).into_iter().map(|at| Mark::Disc(Ink::Second, at));
    let line = Mark::Line(Ink::Actual, 3, of(|point| point.model));
    let shapes: Vec<Mark> = discs.chain([line]).collect();
    let values = of(|point| point.measured).into_iter().chain(of(|point| point.model));
    let y = Axis::fitting(values.map(|point| point.1));
    let legend = [("model", Ink::Actual), ("measured", Ink::Second)];
    figure(title, &legend, &over_frequency(points, y, shapes))
}

fn coherence(title: &str, points: &[ResponsePoint]) -> Markup {
    let line = points.iter().map(|point| (point.hz.log10(), point.coherence)).collect();
    let shapes = vec![Mark::Line(Ink::Third, 3, line)];
    figure(title, &[], &over_frequency(points, Axis::linear(0.0..1.0, 5.0, ""), shapes))
}

fn over_frequency(points: &[ResponsePoint], y: Axis, shapes: Vec<Mark>) -> Plot {
    let range = points[0].hz.log10()..points[points.len() - 1].hz.log10();
    let x = Axis::decades(range, |decade| format!("{} Hz", 10_f64.powi(decade)));
    Plot { size: SIZE, label_width: LABEL_WIDTH, x, y, shapes }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use oqtal_control::quaternion::Attitude;

    /// Rates that follow the commands after two samples, without a lag.
    #[test]
    fn the_response_of_a_pure_delay_has_its_gain_and_phase_and_full_coherence() {
        let period_s = 1.0 / 60.0;
        let mut state = 1_u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24) - 0.5
        };
        let sticks: Vec<f64> = (0..2000).map(|_| 0.2 * noise()).collect();
        let mut data = FlightData::default();
        let mut angle = 0.0;
        for (k, stick) in sticks.iter().enumerate() {
            let at_s = k as f64 * period_s;
            let sticks_now = Vector3::new(*stick, 0.0, 0.0);
            data.commands.push(CommandRecord { sent_s: at_s, sticks: sticks_now, thrust: 0.5 });
            data.air.push(PoseRecord {
                captured_s: at_s,
                latency_s: 0.0,
                position: Vector3::zeros(),
                attitude: Attitude::from_rotation_vector(Vector3::x() * angle),
            });
            angle += 2.0 * period_s * if k >= 2 { sticks[k - 2] } else { 0.0 };
        }
        let authority = Vector3::new(2.0, 2.0, 2.0);
        let (delay_s, bias) = (2.0 * period_s, Vector3::zeros());
        let model = RotationModel { delay_s, lag_s: 0.0, fast_s: 0.0, authority, bias };
        let [roll, pitch, _] = responses(&data, &model);
        for point in &roll {
            assert!((point.measured - point.model).norm() < 0.05, "{point:?}");
            assert!(point.coherence > 0.99, "{point:?}");
        }
        assert!(roll.len() > 50 && pitch.iter().all(|point| point.coherence.is_nan()));
    }
}
