//! Table V: the square on the simulated testbed, 25 runs of every law, on the nominal plant and on mismatched ones.

use oqtal_config::Setting;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use crate::campaign::flights::{Contender, MISMATCHED, NOMINAL, Prepared, Test};
use crate::campaign::metric::{METRIC, METRICS, Metric};
use crate::campaign::table::{self, BEST, COLUMNS, Entrant, Flown, PAPER, Scope};
use crate::tune;

use super::chapter::{Chapter, ExperimentContext};
use super::figures;
use super::judgement::{self, Evidence};
use super::words::listed;
use crate::progress::Progress;
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

mod notes;

/// A printed row: law, mean and deviation of position, velocity and attitude error, largest q, calculations.
type Printed = (&'static str, [(f64, f64); 3], Option<f64>, u64);

const PRINTED: [Printed; 3] = [
    ("pid", [(0.330, 0.005), (0.147, 0.004), (1.192, 0.098)], None, 0),
    ("lqr", [(0.323, 0.005), (0.143, 0.002), (1.575, 0.047)], Some(20.0), 89),
    ("oqtal", [(0.306, 0.012), (0.139, 0.001), (1.184, 0.039)], Some(200.0), 1),
];

/// Flies Table V, the mismatched plants, and the counts by cell rule.
///
/// # Errors
/// A setting is invalid.
pub fn chapter(context: &ExperimentContext) -> Result<Chapter, Failure> {
    let entrants = entrants(context)?;
    let (nominal, others) = fly(&entrants, &PAPER, &context.progress)?;
    let evidence = Evidence { plant: NOMINAL.name, flown: &nominal };
    let elsewhere: Vec<Evidence<'_>> = MISMATCHED
        .iter()
        .zip(&others)
        .map(|(plant, flown)| Evidence { plant: plant.name, flown })
        .collect();
    let main = Sheet { notes: notes::all(&entrants, &nominal)?, ..main(&evidence, &elsewhere) };
    let judged = [
        judgement::duels(&evidence, &elsewhere),
        judgement::intervals(&evidence),
        judgement::ranking(&evidence),
    ];
    let more = [outer(context)?, counts(context)?];
    Ok(Chapter {
        title: "Square on the testbed",
        intro: vec![notes::intro()],
        sheets: [main].into_iter().chain(judged).chain(more).collect(),
        figures: figures::square::all(&entrants)?,
    })
}

/// Flies every entrant on the nominal plant and on the mismatched ones, which take over the largest weight of the nominal one.
fn fly(
    entrants: &[Entrant],
    scope: &Scope,
    progress: &Progress,
) -> Result<(Vec<Flown>, Vec<Vec<Flown>>), Failure> {
    let nominal = table::fly(entrants, &NOMINAL, scope, progress)?;
    let elsewhere = Scope { raises_weights: false, ..scope.clone() };
    let fly = |plant| {
        let mut flown = table::fly(entrants, plant, &elsewhere, progress)?;
        flown.iter_mut().zip(&nominal).for_each(|(there, here)| there.take_max_q_of(here));
        Ok(flown)
    };
    let others: Result<Vec<Vec<Flown>>, Failure> = MISMATCHED.iter().map(fly).collect();
    Ok((nominal, others?))
}

/// Table V without its notes.
fn main(nominal: &Evidence<'_>, elsewhere: &[Evidence<'_>]) -> Sheet {
    let mismatched = elsewhere.iter().map(|Evidence { plant, flown }| {
        sheet(plant, format!("The same with {plant}"), table::rows(flown, BEST))
    });
    let rows = paper().chain(table::rows(nominal.flown, BEST)).collect();
    Sheet { mismatched: mismatched.collect(), ..sheet("V", TITLE.to_owned(), rows) }
}

/// The entrants, tuned anew if that was requested.
fn entrants(context: &ExperimentContext) -> Result<Vec<Entrant>, Failure> {
    let mut entrants = table::entrants();
    if context.retune {
        for entrant in entrants.iter_mut().filter(|entrant| entrant.is_tuned()) {
            let name = entrant.contender.controller;
            let tuned =
                tune::tune(name, &Default::default(), &Default::default(), &context.progress)?;
            context.keep(&format!("tuned/{name}.toml"), &tuned.to_toml(&[]))?;
            entrant.contender.settings = tuned.settings();
            entrant.settings = "tuned alike, anew".to_owned();
        }
    }
    Ok(entrants)
}

const TITLE: &str = "Table V: repeated square";

fn sheet(name: &str, title: String, rows: Vec<SheetRow>) -> Sheet {
    Sheet { name: name.to_owned(), title, columns: COLUMNS.to_vec(), rows, ..Sheet::default() }
}

fn paper() -> impl Iterator<Item = SheetRow> {
    PRINTED.into_iter().map(|(name, errors, max_q, solves)| {
        let mut cells = vec![SheetCell::None; COLUMNS.len()];
        for (cell, (mean, sd)) in cells.iter_mut().zip(errors) {
            *cell = SheetCell::Spread(mean, sd);
        }
        cells[METRICS] = solves.into();
        cells[METRICS + 1] = max_q.into();
        cells[METRICS + 3] = SheetCell::Count(25);
        cells[METRICS + 4] = SheetCell::Count(5);
        SheetRow::new(Variant::Paper, name, "laboratory", cells)
    })
}

/// The shipped `oqtal` with the outer loops as shipped, and tuned one at a time.
fn outer(context: &ExperimentContext) -> Result<Sheet, Failure> {
    let tuned = match context.retune {
        true => {
            let tuned =
                tune::tune("outer", &Default::default(), &Default::default(), &context.progress)?;
            context.keep("tuned/outer.toml", &tuned.to_toml(&[]))?;
            tuned.settings()
        }
        false => tune::gains::tuned("outer"),
    };
    let bounds = tune::outer::on_a_bound(&tuned);
    let entrants =
        [("as shipped", Vec::new()), ("tuned one at a time", tuned)].map(|(outer, settings)| {
            Entrant {
                contender: Contender { controller: "oqtal", settings },
                variant: Variant::Ours,
                settings: format!("q 80, outer loops {outer}"),
            }
        });
    let flown = table::fly(&entrants, &NOMINAL, &PAPER, &context.progress)?;
    let bounds =
        format!("On a bound of the search, beyond which it may be better: {}.", listed(&bounds));
    let notes = vec![OUTER.to_owned(), bounds, changed(&flown[0], &flown[1])];
    Ok(Sheet { notes, ..sheet("outer", OUTER_TITLE.to_owned(), table::rows(&flown, BEST)) })
}

const OUTER_TITLE: &str = "The six outer PIDs, tuned one at a time";
const OUTER: &str = "As the paper's reference [27] does in flight: one loop after the other, single input and single output, the inner \
     ones first, each for its own error and a calm command; X and Y share their gains. The paper keeps the result for all \
     three attitude laws.";

/// The metrics that tuning the loops one at a time changed, as text.
fn changed(shipped: &Flown, tuned: &Flown) -> String {
    let (mut better, mut worse) = (Vec::new(), Vec::new());
    for (metric, Metric { title, .. }) in METRIC.iter().enumerate() {
        let (before, after) = (shipped.interval(metric), tuned.interval(metric));
        if before.is_apart_from(&after) {
            let list = if after.mean < before.mean { &mut better } else { &mut worse };
            list.push(*title);
        }
    }
    format!("Better, intervals apart: {}. Worse: {}.", listed(&better), listed(&worse))
}

const COUNTS: [Column; 3] = [
    ("cells", "cells"),
    ("delta_rad", "delta"),
    ("riccati_solves", "Riccati solves in the square"),
];

/// Riccati solves in a square, by rule and width of the cells.
fn counts(context: &ExperimentContext) -> Result<Sheet, Failure> {
    const RULES: [&str; 4] = ["centred", "floor", "truncated", "deadband"];
    let widths = [("0.5 rad", 0.5), ("0.5°", 0.5_f64.to_radians())];
    let cases: Vec<_> = ["lqr", "oqtal"]
        .into_iter()
        .flat_map(|law| RULES.map(|rule| (law, rule)))
        .flat_map(|(law, rule)| widths.map(|width| (law, rule, width)))
        .collect();
    let bar = context.progress.start("cells", cases.len());
    let fly = |(law, rule, (width, delta)): &(&'static str, &str, (&str, f64))| {
        let key = |name: &str| format!("control.{law}.{name}");
        let mut settings = vec![Setting::flag("cells", &key("cells"), *rule)];
        let names: &[&str] = match *law {
            "lqr" => &["cell-rate-rad-s", "cell-angle-rad"],
            _ => &["cell-rate-rad-s", "cell-eps", "cell-eps-ddot-per-s2"],
        };
        settings.extend(names.iter().map(|name| Setting::flag("cells", &key(name), *delta)));
        let contender = Contender { controller: law, settings };
        let flown = Prepared::new(&contender, Test::Path, &NOMINAL)?.fly(200)?;
        let solves = flown.and_then(|(flight, _)| {
            flight.samples.last().map(|sample| sample.telemetry.riccati_solves)
        });
        bar.inc();
        Ok(SheetRow::new(
            Variant::AsPrinted,
            *law,
            "shipped gains, seed 200",
            vec![(*rule).into(), (*width).into(), solves.into()],
        ))
    };
    let rows: Result<Vec<SheetRow>, Failure> = cases.par_iter().map(fly).collect();
    let rows = rows?;
    Ok(Sheet {
        name: "cells".to_owned(),
        title: "Riccati solves by rule and width of the cells".to_owned(),
        notes: vec![fitting(&rows)],
        columns: COUNTS.to_vec(),
        rows,
        ..Sheet::default()
    })
}

/// Factor within which a count fits a printed one \[-\].
const FITS: f64 = 3.0;

/// The rules and widths that fit the paper's 89 and 1 calculations, as text.
fn fitting(rows: &[SheetRow]) -> String {
    let (lqr, oqtal) = rows.split_at(rows.len() / 2);
    let fits = |(lqr, oqtal): (&SheetRow, &SheetRow)| match (&lqr.cells[2], &oqtal.cells[2]) {
        (SheetCell::Count(many), SheetCell::Count(1)) => {
            let near = (*many as f64 / 89.0).max(89.0 / *many as f64) <= FITS;
            near.then(|| format!("{} cells of {}", lqr.cells[0].show(), lqr.cells[1].show()))
        }
        _ => None,
    };
    let fitting: Vec<String> = lqr.iter().zip(oqtal).filter_map(fits).collect();
    format!(
        "The paper prints 89 and 1 calculations, cells as with `floor` and 0.5 without a unit. Within a factor of {FITS} of 89 for the \
         classic law, with 1 for oqtal: {}. The estimated rate is in the classic law's operating point.",
        listed(&fitting)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    /// Columns with a number in every row except the paper's.
    const NUMBERS: [&str; 9] = [
        "chirp4_rms_deg",
        "doublet_settle_s",
        "hover_rms_mm",
        "settle_s",
        "overshoot_mm",
        "riccati_solves",
        "max_q",
        "runs",
        "best",
    ];
    /// Columns with mean and deviation.
    const SPREADS: [&str; 3] = ["position_error_m", "velocity_error_m_s", "attitude_error_deg"];

    fn assert_numbers(rows: &Value) {
        for row in rows.as_array().unwrap().iter().filter(|row| row["variant"] != "paper") {
            for key in NUMBERS {
                assert!(row[key].is_number(), "{key}: {row:#}");
            }
            for key in SPREADS {
                assert!(row[key]["mean"].is_number() && row[key]["sd"].is_number(), "{row:#}");
            }
        }
    }

    #[test]
    fn every_figure_of_every_law_on_every_plant_is_a_number() {
        let mut entrants = table::entrants();
        entrants.retain(|e| ["lqr", "oqtal-dt"].contains(&e.contender.controller));
        let scope = Scope { seeds: 200..201, ..PAPER };
        let (nominal, others) = fly(&entrants, &scope, &Progress::default()).unwrap();
        let evidence = |(plant, flown)| Evidence { plant, flown };
        let elsewhere: Vec<Evidence<'_>> = MISMATCHED
            .iter()
            .map(|p| p.name)
            .zip(others.iter().map(Vec::as_slice))
            .map(evidence)
            .collect();
        let table = main(&evidence((NOMINAL.name, &nominal)), &elsewhere).to_json();
        assert_eq!(table["rows"].as_array().unwrap().len(), 3 + entrants.len());
        assert_numbers(&table["rows"]);
        let mismatched = table["mismatched"].as_array().unwrap();
        assert_eq!(mismatched.len(), 5);
        for plant in mismatched {
            assert_eq!(plant["rows"].as_array().unwrap().len(), entrants.len());
            assert_numbers(&plant["rows"]);
        }
    }
}
