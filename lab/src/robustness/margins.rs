//! Margins of every law, in hover and of the attitude loop alone, from flights and from the linear model, and the loop responses.

use maud::Markup;
use nalgebra::Complex;
use oqtal_bus::message::{FNV_OFFSET, fnv1a};
use oqtal_config::{Interface, Setting};
use oqtal_observe::plot::axis::Axis;
use oqtal_observe::plot::chart::Mark;
use oqtal_observe::plot::figure::figure;
use oqtal_observe::plot::palette::Ink;
use oqtal_runtime::process::{Exit, Failure};
use serde_json::{Value, json};

use super::frequency::{LoopResponse, Margins};
use super::linear::LinearLoop;
use super::probed::{self, ClosedLoops};
use crate::identify::frequency_response::over_frequency;
use crate::progress::Progress;
use crate::reproduce::chapter::Chapter;
use crate::sheet::{Sheet, SheetCell, SheetRow, Variant};
use crate::study::law::StudyLaw;

const AXES: [&str; 3] = ["roll", "pitch", "yaw"];

/// The loop of a law about an axis.
#[derive(Clone, Debug)]
pub struct LoopPair {
    /// Name of the law.
    pub law: String,
    /// Name of the axis.
    pub axis: &'static str,
    /// Loop response of the linear model.
    pub linear: LoopResponse,
    /// Loop response measured in flight, with the position loop open; without points if that is unstable.
    pub flown: LoopResponse,
    /// Loop response measured in a hover, with the position loop closed; `None` if that is unstable.
    pub hover: Option<LoopResponse>,
}

impl LoopPair {
    /// Margins of `response`, one of the two, in the order of [`Margins::COLUMNS`]; NaN if the loop is unstable.
    fn margins(&self, response: &LoopResponse) -> [f64; 5] {
        let is_stable = self.linear.is_stable() && !response.points.is_empty();
        if is_stable { response.margins().numbers() } else { UNSTABLE }
    }

    /// Margins in hover; NaN if the loop is unstable.
    fn hover_margins(&self) -> [f64; 5] {
        self.hover.as_ref().map_or(UNSTABLE, |hover| hover.margins().numbers())
    }
}

/// Margins of a loop without any.
const UNSTABLE: [f64; 5] = [f64::NAN; 5];

/// Margins of a law in hover with the position loop closed, each the least of roll, pitch and yaw, in the order of
/// [`Margins::COLUMNS`], measured in flight; NaN if a loop is unstable. `None` for a vehicle that is not
/// commanded by rates.
///
/// # Errors
/// A setting is invalid, or does not allow the flights.
pub fn in_hover(law: &StudyLaw) -> Result<Option<[f64; 5]>, Failure> {
    if law.config()?.vehicle.interface != Interface::Rate {
        return Ok(None);
    }
    let of_axis = |axis| {
        let response = stable(probed::flown(&settings(law), (axis, closed_in_hover(axis))))?;
        Ok(response.map_or(UNSTABLE, |response| response.margins().numbers()))
    };
    let axes: Result<Vec<_>, Failure> = (0..AXES.len()).map(of_axis).collect();
    Ok(Some(least_of(axes?.into_iter())))
}

/// The measured loop; `None` if it is unstable.
fn stable<T>(measured: Result<T, Failure>) -> Result<Option<T>, Failure> {
    match measured {
        Err(failure) if failure.exit == Exit::Flight => Ok(None),
        measured => measured.map(Some),
    }
}

/// The loops with which the margins in hover are measured: the position loop does not act about yaw, where the daemon tests the heading.
fn closed_in_hover(axis: usize) -> ClosedLoops {
    if AXES[axis] == "yaw" { ClosedLoops::Attitude } else { ClosedLoops::Hover }
}

/// The settings with which a law flies.
fn settings(law: &StudyLaw) -> Vec<Setting> {
    [&law.settings[..], &[law.setting()]].concat()
}

/// The least of each margin, and the greatest sensitivity; NaN if one of them is.
fn least_of(margins: impl Iterator<Item = [f64; 5]>) -> [f64; 5] {
    let worst = |a: f64, b: f64, column| match column {
        _ if a.is_nan() || b.is_nan() => f64::NAN,
        Margins::PEAK => a.max(b),
        _ => a.min(b),
    };
    let worse = |a: [f64; 5], b: [f64; 5]| std::array::from_fn(|k| worst(a[k], b[k], k));
    margins.reduce(worse).expect("a law has an axis")
}

/// Loop responses of every law about every axis.
///
/// # Errors
/// The vehicle is not commanded by rates (exit code 78), a setting is invalid, or a flight did not land.
pub fn all(laws: &[StudyLaw], progress: &Progress) -> Result<Vec<LoopPair>, Failure> {
    let bar = progress.start("loops", laws.len() * AXES.len());
    let mut loops = Vec::new();
    for law in laws {
        let config = law.config()?;
        let settings = settings(law);
        if config.vehicle.interface != Interface::Rate {
            let reason = "the linear model is that of a vehicle commanded by rates; set vehicle.interface = \"rate\", or leave out --margins";
            return Err(Failure::new(Exit::Config, reason));
        }
        for (index, axis) in AXES.into_iter().enumerate() {
            progress.check()?;
            let linear = LinearLoop::new(&config, index).map_err(|error| config.locate(&error))?;
            let measured = |name: &str, closed: ClosedLoops| {
                let key = |axis: &&str| {
                    let name = fnv1a(FNV_OFFSET, format!("{name} about {axis}").as_bytes());
                    fnv1a(name, &config.hash().to_le_bytes())
                };
                // As bits: JSON rounds, and a resumed study has the result of an uninterrupted one.
                let bits = progress.kept(axis, key, |_| {
                    let points = probed::flown(&settings, (index, closed))?.points.into_iter();
                    Ok(points.map(|(hertz, g)| [hertz, g.re, g.im].map(f64::to_bits)).collect())
                });
                stable(bits).map(|bits| bits.map(response))
            };
            let flown = measured("loop", ClosedLoops::Attitude)?;
            let hover = match closed_in_hover(index) {
                ClosedLoops::Attitude => flown.clone(),
                closed => measured("loop in hover", closed)?,
            };
            let flown = flown.unwrap_or(LoopResponse { points: Vec::new() });
            progress.check()?;
            let (law, linear) = (law.name.clone(), linear.response());
            loops.push(LoopPair { law, axis, linear, flown, hover });
            bar.inc();
        }
    }
    Ok(loops)
}

/// The response with these points, as bits: frequency \[Hz\], real and imaginary part of the loop gain.
fn response(points: Vec<[u64; 3]>) -> LoopResponse {
    let point = |[hertz, re, im]: [f64; 3]| (hertz, Complex::new(re, im));
    LoopResponse {
        points: points.into_iter().map(|bits| point(bits.map(f64::from_bits))).collect(),
    }
}

/// The chapter of the page.
pub fn chapter(loops: &[LoopPair]) -> Chapter {
    let figures = loops.iter().filter(|pair| pair.axis != "pitch").flat_map(drawn);
    Chapter {
        title: "Margins",
        intro: INTRO.map(str::to_owned).to_vec(),
        sheets: vec![hover(loops), least(loops), table(loops)],
        figures: figures.collect(),
    }
}

const INTRO: [&str; 3] = [
    "The loop is broken at the input of the vehicle. Flown: a sine is added to the commands where they take effect, one flight for \
     each of 27 frequencies from 0.5 to 14 Hz; -u/v at that frequency is the loop gain.",
    "In hover, attitude and position loops are closed: these are the margins of the vehicle as it flies. Those of the attitude loop \
     alone, with a prescribed attitude, are compared with the model: the linearised law, filter and prediction, and the exact \
     sampled vehicle with its lag and delays.",
    "Gain, phase and delay margin are the least change of one of them that makes the loop oscillate; the disk margin allows gain \
     and phase to change at once. Where a margin of a stable loop is missing, the loop has no such limit below the highest \
     frequency. They apply to the configured model with the adaptation off, not to an adaptation at its bound.",
];

/// Least margin of each kind in hover over the axes, for each law; no value if the loop about one of them is unstable.
fn hover(loops: &[LoopPair]) -> Sheet {
    let note = "Flown, position loop closed, adaptation off; the least of roll, pitch and yaw. With its adaptation on, a law tolerates other delays.".to_owned();
    least_sheet(
        ("hover_margins", "Least margins in hover"),
        [&[note], &*unstable_hovers(loops)].concat(),
        loops,
        LoopPair::hover_margins,
    )
}

/// Least flown margin of each kind of the attitude loop over the axes, for each law; no value if the loop about one of them is unstable.
fn least(loops: &[LoopPair]) -> Sheet {
    let note =
        "Flown, position loop open, adaptation off; the least of roll, pitch and yaw.".to_owned();
    least_sheet(
        ("least_margins", "Least margins of the attitude loop alone"),
        [&[note], &*notes(loops)].concat(),
        loops,
        |pair| pair.margins(&pair.flown),
    )
}

fn least_sheet(
    (name, title): (&str, &str),
    notes: Vec<String>,
    loops: &[LoopPair],
    margins: fn(&LoopPair) -> [f64; 5],
) -> Sheet {
    let row = |law: &[LoopPair]| {
        let cells = least_of(law.iter().map(margins)).map(finite).to_vec();
        SheetRow::new(Variant::Ours, law[0].law.clone(), "", cells)
    };
    Sheet {
        name: name.to_owned(),
        title: title.to_owned(),
        notes,
        columns: Margins::COLUMNS.to_vec(),
        rows: loops.chunk_by(|a, b| a.law == b.law).map(row).collect(),
        ..Sheet::default()
    }
}

fn table(loops: &[LoopPair]) -> Sheet {
    let row = |pair: &LoopPair, is: &str, margins: [f64; 5]| {
        let cells = margins.map(finite).to_vec();
        SheetRow::new(Variant::Ours, pair.law.clone(), format!("{}, {is}", pair.axis), cells)
    };
    let rows = loops.iter().flat_map(|pair| {
        [
            row(pair, "model", pair.margins(&pair.linear)),
            row(pair, "flown", pair.margins(&pair.flown)),
            row(pair, "in hover", pair.hover_margins()),
        ]
    });
    Sheet {
        name: "margins".to_owned(),
        title: "Margins about each axis".to_owned(),
        notes: [notes(loops), unstable_hovers(loops)].concat(),
        columns: Margins::COLUMNS.to_vec(),
        rows: rows.collect(),
        is_detail: true,
        ..Sheet::default()
    }
}

fn finite(number: f64) -> SheetCell {
    if number.is_finite() { SheetCell::Number(number) } else { SheetCell::None }
}

/// Greatest relative difference between a flown margin and the model's \[-\]; the gain margin is compared as a factor.
pub fn greatest_difference(pair: &LoopPair) -> f64 {
    let [model, flown] = [&pair.linear, &pair.flown].map(|response| response.margins());
    let of = |m: &Margins| [m.gain, m.phase_deg, m.delay_ms, m.disk];
    // A loop without a crossover in the measured range has no phase and no delay margin.
    let pairs = of(&model).into_iter().zip(of(&flown));
    let measured = pairs.filter(|(a, b)| a.is_finite() && b.is_finite());
    measured.map(|(a, b)| (b / a - 1.0).abs()).fold(0.0, f64::max)
}

/// Agreement of model and flight, and the loops that have no margins.
fn notes(loops: &[LoopPair]) -> Vec<String> {
    let worst = loops
        .iter()
        .filter(|pair| pair.linear.is_stable() && !pair.flown.points.is_empty())
        .max_by(|a, b| greatest_difference(a).total_cmp(&greatest_difference(b)));
    let agreement = worst.map(|pair| {
        format!(
            "Gain, phase, delay and disk margin of the model agree with those flown within {:.1} % (the most: {}, {}).",
            1e2 * greatest_difference(pair),
            pair.law,
            pair.axis
        )
    });
    let by_model = unstable("by the model", loops, |pair| !pair.linear.is_stable());
    let flown = unstable("in flight", loops, |pair| pair.flown.points.is_empty());
    [agreement, by_model, flown].into_iter().flatten().collect()
}

/// The loops that have no margins in hover.
fn unstable_hovers(loops: &[LoopPair]) -> Vec<String> {
    unstable("in hover", loops, |pair| pair.hover.is_none()).into_iter().collect()
}

/// Note of the loops that are unstable `when`, if there are any.
fn unstable(when: &str, loops: &[LoopPair], is: impl Fn(&LoopPair) -> bool) -> Option<String> {
    let of = loops.iter().filter(|pair| is(pair));
    let names: Vec<String> = of.map(|pair| format!("{}, {}", pair.law, pair.axis)).collect();
    (!names.is_empty())
        .then(|| format!("Unstable {when}, and therefore without margins: {}.", names.join("; ")))
}

/// Gain, phase and sensitivity over frequency.
fn drawn(pair: &LoopPair) -> [Markup; 3] {
    let decibels = |gain: f64| 20.0 * gain.log10();
    let title = |quantity: &str| format!("{}, {}: {quantity}", pair.law, pair.axis);
    [
        both(&title("loop gain [dB]"), pair, |gain| decibels(gain.norm())),
        both(&title("phase [°], from 0 to -360"), pair, |gain| {
            (gain.arg().to_degrees().rem_euclid(360.0)) - 360.0
        }),
        both(&title("sensitivity [dB]"), pair, |gain| decibels((gain + 1.0).inv().norm())),
    ]
}

/// Value of the loop gain of model and flight over frequency.
fn both(title: &str, pair: &LoopPair, value: impl Fn(Complex<f64>) -> f64) -> Markup {
    let points = |response: &LoopResponse| -> Vec<(f64, f64)> {
        response.points.iter().map(|(hertz, gain)| (hertz.log10(), value(*gain))).collect()
    };
    let (model, flown) = (points(&pair.linear), points(&pair.flown));
    let x = model.first().map_or(-1.0, |p| p.0)..model.last().map_or(1.5, |p| p.0);
    let y = Axis::fitting(model.iter().map(|point| point.1));
    let discs = flown.into_iter().map(|point| Mark::Disc(Ink::Second, point));
    let shapes = std::iter::once(Mark::Line(Ink::Actual, 3, model)).chain(discs).collect();
    let legend = [("model", Ink::Actual), ("flown", Ink::Second)];
    figure(title, &legend, &over_frequency(x, y, shapes))
}

/// The loops as JSON: frequency \[Hz\], loop gain \[dB\], phase \[deg\].
pub fn document(loops: &[LoopPair]) -> Value {
    let points = |response: &LoopResponse| -> Value {
        let point = |(hertz, gain): &(f64, Complex<f64>)| {
            json!([hertz, 20.0 * gain.norm().log10(), gain.arg().to_degrees()])
        };
        response.points.iter().map(point).collect()
    };
    let pair = |pair: &LoopPair| {
        json!({
            "law": pair.law, "axis": pair.axis, "flown": points(&pair.flown), "hover": pair.hover.as_ref().map(points)
        })
    };
    loops.iter().map(pair).collect()
}
