//! HTML page of an identification: findings, tests of the residuals, measured and predicted motion.

use maud::{Markup, html};
use nalgebra::Vector3;
use oqtal_observe::page::page;
use oqtal_observe::plot::figure::{TimeSpan, over_time};
use oqtal_observe::plot::palette::Ink;
use oqtal_observe::plot::trace::{Point, Trace};

use super::data::{FlightData, PoseRecord};
use super::frequency_response::figures;
use super::identification::Identification;
use super::overview::{HEADINGS, cells, remarks};

/// Number of poses on either side over which a rate is the difference of two attitudes \[-\].
const RATE_POSES: usize = 3;
/// Number of poses on either side over which an acceleration is the second difference of positions \[-\].
const ACCELERATION_POSES: usize = 7;
/// Note above the frequency responses.
const RESPONSES: &str = "From the commanded to the flown rates, in units of the rate at full stick, beside the fitted model. The \
     loop is closed, so that only motion which the trajectory prescribes tells the vehicle from its controller: measured points are \
     shown at the frequencies where the rate follows from it, with a coherence of at least 0.5.";
const STYLE: &str = "td { font-variant-numeric: tabular-nums; } .remark { max-width: 95ch; }";

/// The HTML page of `identification`, made from `flights`.
pub fn html(identification: &Identification, flights: &[FlightData]) -> String {
    let body = html! {
        header {
            p.eyebrow { "oqtal" }
            h1 { "The vehicle, identified" }
            @for line in remarks(identification) { p.note.remark { (line) } }
        }
        main {
            section { h2 { "Findings" } (findings(identification)) }
            section { h2 { "Tests of the residuals" } (residuals(identification)) }
            @for (number, data) in flights.iter().enumerate() {
                section {
                    h2 { "Frequency responses, flight " (number + 1) }
                    p.note.remark { (RESPONSES) }
                    div.grid { (figures(data, &identification.estimate.turning.models[number])) }
                }
                section {
                    h2 { "Measured and predicted, flight " (number + 1) }
                    div.grid { (plots(identification, data, number)) }
                }
            }
        }
    };
    page("oqtal: the vehicle, identified", STYLE, &body)
}

fn findings(identification: &Identification) -> Markup {
    html! {
        table {
            thead { tr { @for heading in HEADINGS { th { (heading) } } } }
            tbody {
                @for finding in &identification.findings {
                    tr { @for cell in cells(finding) { td { (cell) } } }
                }
            }
        }
    }
}

fn residuals(identification: &Identification) -> Markup {
    let headings = [
        "",
        "residuals",
        "correlation with the next",
        "Ljung-Box (20), white below 37.6",
        "beyond 4 sd",
    ];
    html! {
        table {
            thead { tr { @for heading in headings { th { (heading) } } } }
            tbody {
                @for test in &identification.residuals {
                    tr {
                        td { (test.name) }
                        td { (test.count) }
                        td { (format!("{:+.3}", test.next_ratio)) }
                        td { (format!("{:.1}", test.ljung_box_ratio)) }
                        td { (format!("{:.2} %", 100.0 * test.outliers_ratio)) }
                    }
                }
            }
        }
    }
}

/// The plots of a flight.
fn plots(identification: &Identification, data: &FlightData, number: usize) -> Markup {
    let Some((first, last)) = data.air.first().zip(data.air.last()) else { return html! {} };
    let began_s = first.captured_s;
    let span = TimeSpan { range: 0.0..last.captured_s - began_s, ..TimeSpan::default() };
    let measured = measured_rates(data);
    let predicted = predicted_rates(identification, data, number);
    let accelerations = measured_accelerations(data);
    let expected = predicted_accelerations(identification, data, number);
    let pair = |title: &str, measured: &[Reading], predicted: &[Reading], axis: usize| {
        let points = |readings: &[Reading]| -> Vec<Point> {
            readings.iter().map(|(t_s, value)| (t_s - began_s, value[axis])).collect()
        };
        let trace = |name, ink, readings| Trace { name, ink, points: points(readings) };
        let traces = vec![
            trace("measured", Ink::Second, measured),
            trace("predicted", Ink::Actual, predicted),
        ];
        over_time(title, traces, &span)
    };
    let rates = ["rate, roll [rad/s]", "rate, pitch [rad/s]", "rate, yaw [rad/s]"];
    let pushes = ["acceleration, x [m/s²]", "acceleration, y [m/s²]", "acceleration, z [m/s²]"];
    html! {
        @for (axis, title) in rates.into_iter().enumerate() {
            (pair(title, &measured, &predicted, axis))
        }
        @for (axis, title) in pushes.into_iter().enumerate() {
            (pair(title, &accelerations, &expected, axis))
        }
        (normalised(identification, data, number, &span))
    }
}

/// Instant \[s\] and vector at it.
type Reading = (f64, Vector3<f64>);

/// Mean rates between attitudes some poses apart \[rad/s, body\].
fn measured_rates(data: &FlightData) -> Vec<Reading> {
    let windows = data.air.windows(2 * RATE_POSES + 1);
    let rate = |window: &[PoseRecord]| {
        let (from, to) = (&window[0], &window[2 * RATE_POSES]);
        let over_s = to.captured_s - from.captured_s;
        (window[RATE_POSES].captured_s, from.attitude.rotation_to(&to.attitude) / over_s)
    };
    windows.map(rate).collect()
}

/// Mean rates of the model over the same times \[rad/s, body\].
fn predicted_rates(
    identification: &Identification,
    data: &FlightData,
    number: usize,
) -> Vec<Reading> {
    let rates = &identification.estimate.turning.passes[number].rates;
    let mean = |(index, window): (usize, &[Vector3<f64>])| {
        let mean = window.iter().sum::<Vector3<f64>>() / window.len() as f64;
        // The first rate belongs to the second pose.
        (data.air[index + 1 + RATE_POSES].captured_s, mean)
    };
    rates.windows(2 * RATE_POSES + 1).enumerate().map(mean).collect()
}

/// Second differences of positions some poses apart \[m/s^2, world\].
fn measured_accelerations(data: &FlightData) -> Vec<Reading> {
    let windows = data.air.windows(2 * ACCELERATION_POSES + 1);
    let acceleration = |window: &[PoseRecord]| {
        let [from, at, to] = [0, ACCELERATION_POSES, 2 * ACCELERATION_POSES].map(|k| &window[k]);
        let slope = |a: &PoseRecord, b: &PoseRecord| {
            (b.position - a.position) / (b.captured_s - a.captured_s)
        };
        let over_s = 0.5 * (to.captured_s - from.captured_s);
        (at.captured_s, (slope(at, to) - slope(from, at)) / over_s)
    };
    windows.map(acceleration).collect()
}

/// Accelerations of the model, weighted like a second difference \[m/s^2, world\].
fn predicted_accelerations(
    identification: &Identification,
    data: &FlightData,
    number: usize,
) -> Vec<Reading> {
    let accelerations = &identification.estimate.lifting.passes[number].accelerations;
    let half = ACCELERATION_POSES;
    // The second difference weights the mean accelerations of the intervals by a triangle.
    let weights: Vec<f64> =
        (0..2 * half).map(|k| (k.min(2 * half - 1 - k) + 1) as f64 - 0.5).collect();
    let total: f64 = weights.iter().sum();
    let weighted = |(index, window): (usize, &[Vector3<f64>])| {
        let sum: Vector3<f64> = window.iter().zip(&weights).map(|(a, weight)| a * *weight).sum();
        (data.air[index + half].captured_s, sum / total)
    };
    accelerations.windows(2 * half).enumerate().map(weighted).collect()
}

/// The residuals over time, in standard deviations.
fn normalised(
    identification: &Identification,
    data: &FlightData,
    number: usize,
    span: &TimeSpan,
) -> Markup {
    let (turning, lifting) = (&identification.estimate.turning, &identification.estimate.lifting);
    let began_s = data.air[0].captured_s;
    let trace = |name, ink, residuals: Vec<f64>| {
        let times = data.air.iter().skip(1).map(|pose| pose.captured_s - began_s);
        Trace { name, ink, points: times.zip(residuals).collect() }
    };
    let inks = [Ink::Actual, Ink::Second, Ink::Third];
    let turned = |(name, axis): (&'static str, usize)| {
        let innovations = &turning.passes[number].innovations;
        trace(name, inks[axis], innovations.normalised(turning.noise.measured_rad, axis))
    };
    let lifted = |(name, axis): (&'static str, usize)| {
        let innovations = &lifting.passes[number].innovations;
        trace(name, inks[axis], innovations.normalised(lifting.noise.measured_m, axis))
    };
    let body = [("roll", 0), ("pitch", 1), ("yaw", 2)].map(turned);
    let world = [("x", 0), ("y", 1), ("z", 2)].map(lifted);
    html! {
        (over_time("residuals of the attitude [sd]", body.to_vec(), span))
        (over_time("residuals of the position [sd]", world.to_vec(), span))
    }
}
