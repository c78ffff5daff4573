//! Table V: the square on the simulated testbed, 25 runs of every law, on the nominal plant and on mismatched ones.

use std::ops::Range;

use oqtal_config::{Config, Setting};
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use crate::campaign::flights::{Contender, MISMATCHED, NOMINAL, Prepared, Test};
use crate::campaign::metric::{METRIC, Metric, POSITION};
use crate::campaign::statistics::{EVALUATION_SEEDS, TRAINING_SEEDS};
use crate::campaign::table::{self, BEST, COLUMNS, Entrant, Flown, PAPER, Scope};
use crate::tune::search::{self, Budget};
use crate::tune::{self};

use super::chapter::{Chapter, ExperimentContext};
use super::comparison::{self, FlownLaws};
use super::expression::TextValues;
use super::figures;
use super::text::{self, listed};
use crate::progress::Progress;
use crate::sheet::{Sheet, SheetCell, SheetRow, Variant};

/// Flies Table V, the mismatched plants, and the counts by cell rule.
///
/// # Errors
/// A setting is invalid.
pub fn chapter(context: &ExperimentContext) -> Result<Chapter, Failure> {
    let entrants = entrants(context)?;
    let (nominal, others) = fly(&entrants, &PAPER, &context.progress)?;
    let laws = FlownLaws { plant: NOMINAL.name, flown: &nominal };
    let elsewhere: Vec<FlownLaws<'_>> = MISMATCHED
        .iter()
        .zip(&others)
        .map(|(plant, flown)| FlownLaws { plant: plant.name, flown })
        .collect();
    let values = values(&entrants, &nominal)?;
    let main = text::with_notes(main(&laws, &elsewhere), &values);
    let compared = [
        comparison::against_the_best(&laws, &elsewhere),
        comparison::intervals(&laws),
        comparison::ranking(&laws),
    ];
    let more = [outer(context)?, counts(context)?];
    Ok(Chapter {
        sheets: [main].into_iter().chain(compared).chain(more).collect(),
        figures: figures::square::all(&entrants)?,
        ..text::chapter("square", &values)
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
fn main(nominal: &FlownLaws<'_>, elsewhere: &[FlownLaws<'_>]) -> Sheet {
    let mismatched = elsewhere.iter().map(|FlownLaws { plant, flown }| Sheet {
        name: (*plant).to_owned(),
        title: format!("The same with {plant}"),
        columns: COLUMNS.to_vec(),
        rows: table::rows(flown, BEST),
        ..Sheet::default()
    });
    let sheet = text::table_of("V", COLUMNS.to_vec(), table::rows(nominal.flown, BEST));
    Sheet { mismatched: mismatched.collect(), ..sheet }
}

/// The entrants, tuned again if that was requested.
fn entrants(context: &ExperimentContext) -> Result<Vec<Entrant>, Failure> {
    let mut entrants = table::entrants();
    if context.retune {
        for entrant in entrants.iter_mut().filter(|entrant| entrant.is_tuned()) {
            let name = entrant.contender.controller;
            let tuned =
                tune::tune(name, &Default::default(), &Default::default(), &context.progress)?;
            context.keep(&format!("tuned/{name}.toml"), &tuned.to_toml(&[]))?;
            entrant.contender.settings = tuned.settings();
            entrant.settings = "tuned alike, again".to_owned();
        }
    }
    Ok(entrants)
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
    let (better, worse) = changed(&flown[0], &flown[1]);
    let values = TextValues::from([
        ("bounds", listed(&bounds).into()),
        ("better", listed(&better).into()),
        ("worse", listed(&worse).into()),
    ]);
    let sheet = text::table_of("outer", COLUMNS.to_vec(), table::rows(&flown, BEST));
    Ok(text::with_notes(sheet, &values))
}

/// The metrics that tuning the loops one at a time made better, and those that it made worse.
fn changed(shipped: &Flown, tuned: &Flown) -> (Vec<&'static str>, Vec<&'static str>) {
    let (mut better, mut worse) = (Vec::new(), Vec::new());
    for (metric, Metric { title, .. }) in METRIC.iter().enumerate() {
        let (before, after) = (shipped.interval(metric), tuned.interval(metric));
        if before.is_apart_from(&after) {
            let list = if after.mean < before.mean { &mut better } else { &mut worse };
            list.push(*title);
        }
    }
    (better, worse)
}

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
    let values = TextValues::from([("fitting", listed(&fitting(&rows)).into())]);
    Ok(text::with_notes(text::table("cells", rows), &values))
}

/// Factor within which a count fits a printed one \[-\].
const FITS: f64 = 3.0;

/// The rules and widths that fit the paper's 89 and 1 calculations.
fn fitting(rows: &[SheetRow]) -> Vec<String> {
    let (lqr, oqtal) = rows.split_at(rows.len() / 2);
    let fits = |(lqr, oqtal): (&SheetRow, &SheetRow)| match (&lqr.cells[2], &oqtal.cells[2]) {
        (SheetCell::Count(many), SheetCell::Count(1)) => {
            let near = (*many as f64 / 89.0).max(89.0 / *many as f64) <= FITS;
            near.then(|| format!("{} cells of {}", lqr.cells[0].show(), lqr.cells[1].show()))
        }
        _ => None,
    };
    lqr.iter().zip(oqtal).filter_map(fits).collect()
}

/// The values of the texts: tests, search for gains, and the bound of the position error by speed and tilt.
fn values(entrants: &[Entrant], nominal: &[Flown]) -> Result<TextValues, Failure> {
    let Config { plant, mocap, position, trajectory, .. } = Config::default();
    let (square, chirp) = (trajectory.square, trajectory.attitude_chirp);
    let ways = (square.duration_s / square.dwell_s).floor();
    let speed_m_s = position.horizontal_velocity_limit_m_s;
    let acceleration = plant.gravity_m_s2 * position.tilt_limit_deg.to_radians().tan();
    let way_s = square.side_m / speed_m_s + speed_m_s / acceleration;
    let late_ms = mocap.latency_ms + plant.command_delay_ms + plant.rate_lag_ms;
    let travelled = ways * square.side_m / square.duration_s;
    let tuned = nominal.iter().filter(|flown| flown.is_tuned());
    let errors: Vec<f64> = tuned.map(|flown| flown.interval(POSITION).mean).collect();
    let [least, most] =
        [f64::min, f64::max].map(|pick| errors.iter().copied().fold(f64::NAN, pick));
    let numbers = [
        ("rate_lag_ms", plant.rate_lag_ms),
        ("delay_ms", plant.command_delay_ms),
        ("latency_ms", mocap.latency_ms),
        ("noise_mm", mocap.position_noise_mm),
        ("noise_deg", mocap.attitude_noise_deg),
        ("side_m", square.side_m),
        ("hover_s", trajectory.hover.duration_s),
        ("chirp_deg", chirp.amplitude_deg),
        ("from_hz", chirp.from_hz),
        ("to_hz", chirp.to_hz),
        ("sweep_s", chirp.sweep_s),
        ("doublet_deg", trajectory.attitude_doublet.angle_deg),
        ("speed_m_s", speed_m_s),
        ("tilt_deg", position.tilt_limit_deg),
        ("way_s", way_s),
        ("ways", ways),
        ("duration_s", square.duration_s),
        ("least_m", travelled * way_s / 2.0),
        ("late_ms", late_ms),
        ("late_m", travelled * late_ms * 1e-3),
        ("tuned_from_m", least),
        ("tuned_to_m", most),
    ];
    let mut values = search_values(entrants)?;
    values.extend(numbers.map(|(name, number)| (name, number.into())));
    Ok(values)
}

/// The values of the texts on the search for gains.
fn search_values(entrants: &[Entrant]) -> Result<TextValues, Failure> {
    let Budget { points, seed, optimiser } = Budget::default();
    let weights = METRIC.iter().map(|metric| format!("{} {}", metric.title, metric.weight));
    let tuned = entrants.iter().filter(|entrant| entrant.is_tuned());
    let searches: Result<Vec<String>, Failure> = tuned
        .map(|Entrant { contender, .. }| {
            let [shipped, tuned] = search::before_and_after(contender)?;
            Ok(format!("{} {shipped:.3}, {tuned:.3}", contender.controller))
        })
        .collect();
    let seeds = |seeds: Range<u64>| format!("{} to {}", seeds.start, seeds.end - 1);
    Ok(TextValues::from([
        ("optimiser", optimiser.name().to_owned().into()),
        ("points", (points as f64).into()),
        ("seed", (seed as f64).into()),
        ("weights", weights.collect::<Vec<_>>().join(", ").into()),
        ("searches", searches?.join("; ").into()),
        ("tuned_on", seeds(TRAINING_SEEDS).into()),
        ("flown_on", seeds(EVALUATION_SEEDS).into()),
    ]))
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
        let laws = |(plant, flown)| FlownLaws { plant, flown };
        let elsewhere: Vec<FlownLaws<'_>> = MISMATCHED
            .iter()
            .map(|p| p.name)
            .zip(others.iter().map(Vec::as_slice))
            .map(laws)
            .collect();
        let table = main(&laws((NOMINAL.name, &nominal)), &elsewhere).to_json();
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
