//! The sweep over the weights, Figs. 6 to 9: classic LQR and OQTAL in the gravity turn for q and r from 2^0 to 2^20.

use oqtal_control::controller::ControlOptions;
use oqtal_control::metrics::TableTwo;
use oqtal_control::schedule::Cells;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use super::chapter::{Chapter, invalid};
use super::criteria::{CRITERIA, Criterion, EXPONENTS, Surface};
use super::lander::{Descent, Lander};
use super::words::{listed, ranges};
use super::{figures, roster};
use crate::progress::Progress;
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

const SIDE: usize = 21;

/// A law of the sweep.
struct Law {
    name: &'static str,
    settings: &'static str,
    /// From `[q, r]` to its options.
    options: fn([f64; 2]) -> ControlOptions,
    descent: fn() -> Descent,
    variant: Variant,
}

/// The two laws that the paper compares, the classic one without the singular start of the turn, and `oqtal-dt`.
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
/// An option of a law is invalid.
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let bar = progress.start("sweep", LAWS.len() * SIDE * SIDE);
    let fly = |index: usize| {
        let (law, point) = (&LAWS[index / (SIDE * SIDE)], index % (SIDE * SIDE));
        let weights = [point / SIDE, point % SIDE].map(|exponent| f64::powi(2.0, exponent as i32));
        bar.inc();
        lander.fly(&(law.options)(weights), &(law.descent)(), |_| ())
    };
    let flown: Result<Surface, _> =
        (0..LAWS.len() * SIDE * SIDE).into_par_iter().map(fly).collect();
    let flown = flown.map_err(invalid)?;
    let surfaces: Vec<Surface> = flown.chunks(SIDE * SIDE).map(<[_]>::to_vec).collect();
    Ok(Chapter {
        title: "Sweep over the weights",
        intro: vec![INTRO.to_owned(), stability(&surfaces)],
        sheets: vec![verdict(&surfaces), along_the_ratio(&surfaces), kept(&surfaces)],
        figures: figures::surface::all([&surfaces[0], &surfaces[1]]),
    })
}

const INTRO: &str = "Both laws with Q = q I, R = r I, OQTAL with the Jacobian of Eqs. (45) and (46) as printed, cells of 0.2 centred on zero, torque held at 60 Hz, for all 441 pairs \
     of q and r. Only q/r matters, so the surfaces are ridges along the diagonal.";

/// The point of the sweep with the ratio `2^ratio` and a smaller weight of 1.
fn at_ratio(surface: &Surface, ratio: i32) -> Option<&TableTwo> {
    let (q, r) = (ratio.max(0) as usize, (-ratio).max(0) as usize);
    surface[q * SIDE + r].as_ref()
}

/// The smallest exponent of q/r at which a law loses control; `None` if it never does.
fn edge(surface: &Surface) -> Option<i32> {
    let lost = surface.iter().enumerate().filter(|(_, metrics)| metrics.is_none());
    lost.map(|(point, _)| (point / SIDE) as i32 - (point % SIDE) as i32).min()
}

/// The table of the number of pairs of weights at which each law keeps control.
fn kept(surfaces: &[Surface]) -> Sheet {
    let row = |(law, surface): (&Law, &Surface)| {
        let edge = edge(surface).map(|ratio| SheetCell::Text(format!("2^{ratio}")));
        let stable = SheetCell::Count(surface.iter().flatten().count() as u64);
        let cells =
            vec![stable, SheetCell::Count(surface.len() as u64), edge.unwrap_or(SheetCell::None)];
        SheetRow::new(law.variant, law.name, law.settings, cells)
    };
    Sheet {
        name: "sweep-stability".to_owned(),
        title: "Pairs of weights at which the body stays under control".to_owned(),
        notes: vec!["A dash stands where it does so at every pair.".to_owned()],
        columns: STABILITY.to_vec(),
        rows: LAWS.iter().zip(surfaces).map(row).collect(),
        ..Sheet::default()
    }
}

const STABILITY: [Column; 3] =
    [("stable", "stable"), ("pairs", "of pairs"), ("lost_from", "lost from q/r on")];

/// The ratios from which on the laws lose control, as text.
fn stability(surfaces: &[Surface]) -> String {
    let said: Vec<String> = LAWS
        .iter()
        .zip(surfaces)
        .map(|(law, surface)| {
            let range = edge(surface).map_or_else(
                || "keeps the body under control everywhere".to_owned(),
                |ratio| format!("loses the body from q/r = 2^{ratio} on"),
            );
            format!("{} ({}) {range}", law.name, law.settings)
        })
        .collect();
    format!(
        "{}. The paper prints surfaces without such an edge: gains of the continuous-time equation have one in any loop that holds \
         its torque, so its surfaces were not flown so.",
        said.join("; ")
    )
}

/// The table of pairs at which OQTAL is better than each form of the classic law, by criterion.
fn verdict(surfaces: &[Surface]) -> Sheet {
    let rivals = [(&LAWS[0], &surfaces[0]), (&LAWS[2], &surfaces[2])];
    let judge = |(law, rival): (&Law, &Surface)| {
        CRITERIA.map(|criterion| {
            let against = format!("{}: against lqr, {}", criterion.name, law.settings);
            let cells = compared(criterion, rival, &surfaces[1]);
            SheetRow::new(Variant::AsPrinted, "oqtal", against, cells)
        })
    };
    Sheet {
        name: "sweep-claim".to_owned(),
        title: "\"Significantly lower errors and costs across the entire testing spectrum\""
            .to_owned(),
        notes: vec![CLAIM.to_owned(), holds(surfaces)],
        columns: VERDICT.to_vec(),
        rows: rivals.into_iter().flat_map(judge).collect(),
        ..Sheet::default()
    }
}

const CLAIM: &str = "The claim, judged at every pair of weights where both laws keep the body under control (of 441), against the \
     classic LQR as printed and against one that is spared the singularity of its Euler angles.";

/// The criteria by which the claim holds against each form of the classic law, as text.
fn holds(surfaces: &[Surface]) -> String {
    let said = [0, 2].map(|index| {
        let (rival, oqtal) = (&surfaces[index], &surfaces[1]);
        let (mut true_of, mut false_of) = (Vec::new(), Vec::new());
        for criterion in CRITERIA {
            let worse = not_better(criterion, rival, oqtal);
            if worse.is_empty() {
                true_of.push(criterion.name.to_owned());
            } else {
                let where_not = ranges(&worse, |ratio| format!("2^{ratio}"));
                false_of.push(format!("{} (at q/r = {where_not})", criterion.name));
            }
        }
        let settings = LAWS[index].settings;
        format!(
            "Against lqr, {settings}, it is true of: {}; false of: {}.",
            listed(&true_of),
            listed(&false_of)
        )
    });
    said.join(" ")
}

/// The exponents of the ratios at which `oqtal` is not better.
fn not_better(criterion: Criterion, rival: &Surface, oqtal: &Surface) -> Vec<i32> {
    let worse = |ratio: &i32| {
        let both = at_ratio(rival, *ratio).zip(at_ratio(oqtal, *ratio));
        both.is_some_and(|(a, b)| (criterion.value)(b) >= (criterion.value)(a))
    };
    (-EXPONENTS.end()..=*EXPONENTS.end()).filter(worse).collect()
}

/// The cells of a comparison of `oqtal` with `rival`.
fn compared(criterion: Criterion, rival: &Surface, oqtal: &Surface) -> Vec<SheetCell> {
    let both: Vec<(&TableTwo, &TableTwo)> =
        rival.iter().zip(oqtal).filter_map(|(a, b)| a.as_ref().zip(b.as_ref())).collect();
    let stable = |surface: &Surface| SheetCell::Count(surface.iter().flatten().count() as u64);
    let better = |(a, b): &&(&TableTwo, &TableTwo)| (criterion.value)(b) < (criterion.value)(a);
    let count = both.iter().filter(better).count();
    let holds = if count == both.len() { "true" } else { "false" };
    let both = SheetCell::Count(both.len() as u64);
    vec![SheetCell::Count(count as u64), both, stable(rival), stable(oqtal), holds.into()]
}

const VERDICT: [Column; 5] = [
    ("oqtal_better", "OQTAL better"),
    ("both_stable", "of pairs with both stable"),
    ("lqr_stable", "LQR stable"),
    ("oqtal_stable", "OQTAL stable"),
    ("claim", "claim"),
];

/// The table of the criteria along q/r.
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
    Sheet {
        name: "sweep".to_owned(),
        title: "Figures along q/r".to_owned(),
        notes: vec!["A dash stands where the law lost control of the body.".to_owned()],
        columns: SWEEP.to_vec(),
        rows: rows.collect(),
        ..Sheet::default()
    }
}

const SWEEP: [Column; 4] = [
    ("quaternion_error_norm", "error ∫|ε| [s]"),
    ("position_error", "position ∫|x̃| [m s]"),
    ("riccati_solves", "Riccati solves"),
    ("effort_norm", "effort ∫|τ| [N m s]"),
];

#[cfg(test)]
mod tests {
    use super::*;

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
