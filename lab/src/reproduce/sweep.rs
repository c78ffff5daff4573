//! The sweep over the weights, Figs. 6 to 9: classic LQR and OQTAL in the gravity turn for q and r from 2^0 to 2^20.

use oqtal_control::controller::ControlOptions;
use oqtal_control::metrics::TableTwo;
use oqtal_control::schedule::Cells;
use oqtal_runtime::process::Failure;

use super::chapter::{Chapter, invalid};
use super::expression::TextValues;
use super::figures::surface::{self, CRITERIA, Criterion, EXPONENTS, SIDE, Surface};
use super::lander::{Descent, Lander};
use super::roster;
use super::text::{self, listed};
use crate::progress::Progress;
use crate::sheet::{Sheet, SheetCell, SheetRow, Variant};

/// A law of the sweep.
struct Law {
    name: &'static str,
    settings: &'static str,
    /// Options for the weights `[q, r]`.
    options: fn([f64; 2]) -> ControlOptions,
    descent: fn() -> Descent,
    variant: Variant,
}

/// The two laws compared in the paper, the classic law without the singular start of the turn, and `oqtal-dt`.
const LAWS: [Law; 5] = [
    Law {
        name: "lqr",
        settings: "centred cells",
        options: |weights| roster::lqr(weights, Cells::Centred),
        descent: Descent::default,
        variant: Variant::AsPrinted,
    },
    Law {
        name: "oqtal",
        settings: "centred cells",
        options: |weights| roster::oqtal_as_printed(weights, Cells::Centred),
        descent: Descent::default,
        variant: Variant::AsPrinted,
    },
    Law {
        name: "lqr",
        settings: "centred cells, in the plane to the last bit",
        options: |weights| roster::lqr(weights, Cells::Centred),
        descent: || Descent { noise_rad: 0.0, ..Descent::default() },
        variant: Variant::AsPrinted,
    },
    Law {
        name: "oqtal",
        settings: "centred cells, decoupled Jacobian",
        options: |weights| roster::oqtal(weights, Cells::Centred),
        descent: Descent::default,
        variant: Variant::Ours,
    },
    Law {
        name: "oqtal-dt",
        settings: "Q = q I",
        options: |[q, r]| roster::oqtal_dt([q, q, r]),
        descent: Descent::default,
        variant: Variant::Ours,
    },
];

/// Flies the sweep.
///
/// # Errors
/// An option of a law is invalid, or the study was interrupted (exit code 1).
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let fly = |index: &usize| {
        let (law, point) = (&LAWS[index / (SIDE * SIDE)], index % (SIDE * SIDE));
        let weights = [point / SIDE, point % SIDE].map(|exponent| f64::powi(2.0, exponent as i32));
        lander.fly(&(law.options)(weights), &(law.descent)(), |_| ()).map_err(invalid)
    };
    let points: Vec<usize> = (0..LAWS.len() * SIDE * SIDE).collect();
    let flown = progress.each("sweep", &points, fly)?;
    let surfaces: Vec<Surface> = flown.chunks(SIDE * SIDE).map(<[_]>::to_vec).collect();
    let values = TextValues::new();
    let sheets = [verdict(&surfaces), along_the_ratio(&surfaces), kept(&surfaces)];
    Ok(Chapter {
        sheets: sheets.map(|sheet| text::with_notes(sheet, &values)).into(),
        figures: surface::all([&surfaces[0], &surfaces[1]]),
        ..text::chapter("sweep", &values)
    })
}

/// Point of the sweep with the ratio `2^ratio` and 1 as the smaller weight.
fn at_ratio(surface: &Surface, ratio: i32) -> Option<&TableTwo> {
    let (q, r) = (ratio.max(0) as usize, (-ratio).max(0) as usize);
    surface[q * SIDE + r].as_ref()
}

/// Smallest exponent of q/r at which a law loses control; `None` if it never does.
fn edge(surface: &Surface) -> Option<i32> {
    let lost = surface.iter().enumerate().filter(|(_, metrics)| metrics.is_none());
    lost.map(|(point, _)| (point / SIDE) as i32 - (point % SIDE) as i32).min()
}

/// Table of the number of weight pairs at which each law keeps control.
fn kept(surfaces: &[Surface]) -> Sheet {
    let row = |(law, surface): (&Law, &Surface)| {
        let edge = edge(surface).map(|ratio| SheetCell::Text(format!("2^{ratio}")));
        let stable = SheetCell::Count(surface.iter().flatten().count() as u64);
        let cells =
            vec![stable, SheetCell::Count(surface.len() as u64), edge.unwrap_or(SheetCell::None)];
        SheetRow::new(law.variant, law.name, law.settings, cells)
    };
    text::table("sweep-stability", LAWS.iter().zip(surfaces).map(row).collect())
}

/// Table of the weight pairs at which OQTAL is better than each form of the classic law, by criterion.
fn verdict(surfaces: &[Surface]) -> Sheet {
    let rivals = [(&LAWS[0], &surfaces[0]), (&LAWS[2], &surfaces[2])];
    let compare = |(law, rival): (&Law, &Surface)| {
        CRITERIA.map(|criterion| {
            let against = format!("{}: against lqr, {}", criterion.name, law.settings);
            let cells = compared(criterion, rival, &surfaces[1]);
            SheetRow::new(Variant::AsPrinted, "oqtal", against, cells)
        })
    };
    text::table("sweep-claim", rivals.into_iter().flat_map(compare).collect())
}

/// Exponents of the ratios at which `oqtal` is not better.
fn not_better(criterion: Criterion, rival: &Surface, oqtal: &Surface) -> Vec<i32> {
    let worse = |ratio: &i32| {
        let both = at_ratio(rival, *ratio).zip(at_ratio(oqtal, *ratio));
        both.is_some_and(|(a, b)| (criterion.value)(b) >= (criterion.value)(a))
    };
    (-EXPONENTS.end()..=*EXPONENTS.end()).filter(worse).collect()
}

/// Cells of a comparison of `oqtal` with `rival`.
fn compared(criterion: Criterion, rival: &Surface, oqtal: &Surface) -> Vec<SheetCell> {
    let both: Vec<(&TableTwo, &TableTwo)> =
        rival.iter().zip(oqtal).filter_map(|(a, b)| a.as_ref().zip(b.as_ref())).collect();
    let stable = |surface: &Surface| SheetCell::Count(surface.iter().flatten().count() as u64);
    let better = |(a, b): &&(&TableTwo, &TableTwo)| (criterion.value)(b) < (criterion.value)(a);
    let count = both.iter().filter(better).count();
    let holds = if count == both.len() { "true" } else { "false" };
    let both = SheetCell::Count(both.len() as u64);
    let worse = not_better(criterion, rival, oqtal);
    let worse = (!worse.is_empty()).then(|| SheetCell::Text(ranges(&worse)));
    vec![
        SheetCell::Count(count as u64),
        both,
        stable(rival),
        stable(oqtal),
        holds.into(),
        worse.unwrap_or(SheetCell::None),
    ]
}

/// Ascending exponents of two as ranges: "2^1 to 2^3 and 2^7".
fn ranges(exponents: &[i32]) -> String {
    let parts = exponents.chunk_by(|a, b| b - a == 1).map(|part| match part {
        [only] => format!("2^{only}"),
        [first, .., last] => format!("2^{first} to 2^{last}"),
        [] => String::new(),
    });
    listed(&parts.collect::<Vec<_>>())
}

/// Table of the criteria over q/r.
fn along_the_ratio(surfaces: &[Surface]) -> Sheet {
    let exponents = -EXPONENTS.end()..=*EXPONENTS.end();
    let rows = LAWS.iter().zip(surfaces).flat_map(|(law, surface)| {
        exponents.clone().step_by(2).map(move |ratio| {
            let metrics = at_ratio(surface, ratio);
            let cells = vec![
                metrics.map(|m| m.quaternion_error).into(),
                metrics.map(|m| m.position_error).into(),
                metrics.map(|m| m.riccati_solves).into(),
                metrics.map(|m| m.effort).into(),
            ];
            let settings = format!("q/r = 2^{ratio}, {}", law.settings);
            SheetRow::new(law.variant, law.name, settings, cells)
        })
    });
    text::table("sweep", rows.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn successive_exponents_are_a_range() {
        assert_eq!(ranges(&[-3, -2, -1, 4, 7, 8]), "2^-3 to 2^-1, 2^4 and 2^7 to 2^8");
    }

    #[test]
    fn only_the_ratio_of_the_weights_matters() {
        let lander = Lander::new().unwrap();
        for law in [&LAWS[1], &LAWS[2]] {
            let fly = |weights| {
                let flown = lander.fly(&(law.options)(weights), &(law.descent)(), |_| ());
                flown.unwrap().unwrap()
            };
            let (one, other) = (fly([16.0, 1.0]), fly([16384.0, 1024.0]));
            assert_eq!(one.riccati_solves, other.riccati_solves);
            assert!((one.position_error / other.position_error - 1.0).abs() < 1e-6);
        }
    }
}
