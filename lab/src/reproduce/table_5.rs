//! Table V: the square on the simulated testbed, 25 runs of every law, on the nominal plant and on mismatched ones.

use std::ops::Range;

use oqtal_config::{Config, Setting};
use oqtal_runtime::process::Failure;

use crate::campaign::table::{self, COLUMNS, MaxQ};
use crate::output::StudyOutput;
use crate::study::flights::{MISMATCHED, NOMINAL, path};
use crate::study::gains::tuned;
use crate::study::law::{self, StudyLaw};
use crate::study::metric::{METRIC, Metric, POSITION};
use crate::study::{Case, EVALUATION_SEEDS, Flown, Study, TRAINING_SEEDS};
use crate::tune;
use crate::tune::search::{self, Budget};

use super::chapter::{Chapter, ExperimentContext};
use super::comparison::{self, FlownLaws};
use super::expression::TextValues;
use super::figures;
use super::text::{self, listed};
use crate::progress::Progress;
use crate::sheet::{Sheet, SheetCell, SheetRow, Variant};

mod max_q;

use max_q::max_q;

/// Number of runs with the smallest position error over which the paper averages \[-\].
const BEST: usize = 5;

/// Flies Table V, the mismatched plants, and the counts by cell rule.
///
/// # Errors
/// A setting is invalid.
pub fn chapter(context: &ExperimentContext) -> Result<Chapter, Failure> {
    let laws = laws(context)?;
    let flown = fly(&laws, EVALUATION_SEEDS, &context.output.progress)?;
    let max_q = context.output.progress.each("greatest weights", &laws, max_q)?;
    let (nominal, elsewhere) = flown.split_first().expect("the nominal plant was flown");
    let values = values(&laws, &nominal.flown, &context.output.progress)?;
    let main = text::with_notes(main(nominal, elsewhere, &max_q), &values);
    let compared = [
        comparison::against_the_best(nominal, elsewhere),
        comparison::intervals(nominal),
        comparison::ranking(nominal),
    ];
    let more = [outer(context)?, counts(context)?];
    Ok(Chapter {
        sheets: [main].into_iter().chain(compared).chain(more).collect(),
        figures: figures::square::all(&laws)?,
        ..text::chapter("square", &values)
    })
}

/// Flies every law on the nominal plant and on the mismatched ones. Returns the flights on each plant, the nominal one first.
fn fly(
    laws: &[StudyLaw],
    seeds: Range<u64>,
    progress: &Progress,
) -> Result<Vec<FlownLaws>, Failure> {
    let plants = || [NOMINAL].into_iter().chain(MISMATCHED);
    let cases: Vec<Case> = plants().map(|plant| Case::on(plant, seeds.clone())).collect();
    let flown = Study { name: "Table V", laws, cases: &cases }.fly(progress)?;
    let of = |name: &str| flown.iter().filter(|row| row.case == name).cloned().collect();
    Ok(plants().map(|plant| FlownLaws { plant: plant.name, flown: of(plant.name) }).collect())
}

/// Table V without its notes; the mismatched plants show the greatest weight found on the nominal plant.
fn main(nominal: &FlownLaws, elsewhere: &[FlownLaws], max_q: &[MaxQ]) -> Sheet {
    let rows = |flown: &[Flown], max_q: &[MaxQ]| -> Vec<SheetRow> {
        let with = flown.iter().zip(max_q);
        with.map(|(flown, max_q)| table::row(flown, BEST, Some(*max_q))).collect()
    };
    let of_nominal = |max_q: &MaxQ| MaxQ { found: "the nominal plant's", ..*max_q };
    let max_q_elsewhere: Vec<MaxQ> = max_q.iter().map(of_nominal).collect();
    let mismatched = elsewhere.iter().map(|FlownLaws { plant, flown }| Sheet {
        name: (*plant).to_owned(),
        title: format!("The same with {plant}"),
        columns: COLUMNS.to_vec(),
        rows: rows(flown, &max_q_elsewhere),
        ..Sheet::default()
    });
    let mismatched = mismatched.collect();
    let sheet = text::table_of("V", COLUMNS.to_vec(), rows(&nominal.flown, max_q));
    Sheet { mismatched, ..sheet }
}

/// Laws of Table V on the shipped vehicle: with the paper's gains, and all tuned alike.
fn all_laws() -> Vec<StudyLaw> {
    let printed = [
        ("pid", "shipped gains, k 8, T 2: the paper prints none", None),
        ("lqr", "q 20 (Table V), delta 0.5 rad", Some(("control.lqr.attitude-weight", 20.0))),
        (
            "oqtal",
            "q 80: four times the classic one",
            Some(("control.oqtal.attitude-weight", 80.0)),
        ),
        ("oqtal", "q 200 (Table V), delta 0.5 rad", Some(("control.oqtal.attitude-weight", 200.0))),
    ];
    let printed = printed.into_iter().map(|(controller, remark, weight)| {
        let setting = |(key, value): (&str, f64)| Setting::flag("Table V", key, value);
        let settings = weight.map(setting).into_iter().collect();
        let variant = Variant::AsPrinted;
        StudyLaw { variant, ..StudyLaw::new(controller, settings, remark) }
    });
    let tuned = law::names().map(|controller| {
        let settings = tuned(controller);
        let remark = match settings.is_empty() {
            false => "tuned alike, deploy/tuned",
            true => "shipped gains, not tuned",
        };
        StudyLaw::new(controller, settings, remark)
    });
    printed.chain(tuned).collect()
}

/// Laws of Table V, tuned again if requested.
fn laws(context: &ExperimentContext) -> Result<Vec<StudyLaw>, Failure> {
    let mut laws = all_laws();
    if context.retune {
        for law in laws.iter_mut().filter(|law| law.variant == Variant::Ours) {
            law.settings = retuned(law.controller, &context.output)?;
            law.remark = "tuned alike, again".to_owned();
        }
    }
    Ok(laws)
}

/// Gains of `target`, tuned again, as settings; their file is written into the directory of `output`.
fn retuned(target: &str, output: &StudyOutput) -> Result<Vec<Setting>, Failure> {
    let (budget, flights) = Default::default();
    let tuned = tune::tune(target, &budget, &flights, &output.progress)?;
    output.write(&format!("tuned/{target}.toml"), tuned.to_toml(&[], ""))?;
    Ok(tuned.settings())
}

/// The shipped `oqtal` with the shipped outer loops, and with outer loops tuned one at a time.
fn outer(context: &ExperimentContext) -> Result<Sheet, Failure> {
    let tuned = match context.retune {
        true => retuned("outer", &context.output)?,
        false => self::tuned("outer"),
    };
    let bounds = tune::space::on_a_bound("outer", &tuned).into_iter();
    let bounds: Vec<String> = bounds.map(|range| range.key.into_owned()).collect();
    let laws =
        [("as shipped", Vec::new()), ("tuned one at a time", tuned)].map(|(outer, settings)| {
            StudyLaw::new("oqtal", settings, format!("q 80, outer loops {outer}"))
        });
    let cases = [Case::on(NOMINAL, EVALUATION_SEEDS)];
    let flown =
        Study { name: "outer loops", laws: &laws, cases: &cases }.fly(&context.output.progress)?;
    let row = |flown: &Flown| Ok(table::row(flown, BEST, Some(max_q(&flown.law)?)));
    let rows: Result<Vec<SheetRow>, Failure> = flown.iter().map(row).collect();
    let (better, worse) = changed(&flown[0], &flown[1]);
    let values = TextValues::from([
        ("bounds", listed(&bounds).into()),
        ("better", listed(&better).into()),
        ("worse", listed(&worse).into()),
    ]);
    let sheet = text::table_of("outer", COLUMNS.to_vec(), rows?);
    Ok(text::with_notes(sheet, &values))
}

/// Metrics improved, and metrics worsened, by tuning the loops one at a time.
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

/// Number of Riccati solves in a square, by rule and cell width.
fn counts(context: &ExperimentContext) -> Result<Sheet, Failure> {
    const RULES: [&str; 4] = ["centred", "floor", "truncated", "deadband"];
    let widths = [("0.5 rad", 0.5), ("0.5°", 0.5_f64.to_radians())];
    let cases: Vec<_> = ["lqr", "oqtal"]
        .into_iter()
        .flat_map(|law| RULES.map(|rule| (law, rule)))
        .flat_map(|(law, rule)| widths.map(|width| (law, rule, width)))
        .collect();
    let fly = |(law, rule, (width, delta)): &(&'static str, &str, (&str, f64))| {
        let key = |name: &str| format!("control.{law}.{name}");
        let mut settings = vec![Setting::flag("cells", &key("cells"), *rule)];
        let names: &[&str] = match *law {
            "lqr" => &["cell-rate-rad-s", "cell-angle-rad"],
            _ => &["cell-rate-rad-s", "cell-eps", "cell-eps-ddot-per-s2"],
        };
        settings.extend(names.iter().map(|name| Setting::flag("cells", &key(name), *delta)));
        let flown = path(&StudyLaw::new(law, settings, ""), EVALUATION_SEEDS.start)?;
        let last = flown.and_then(|flight| flight.samples.last().copied());
        let solves = last.map(|sample| sample.telemetry.riccati_solves);
        Ok(SheetRow::new(
            Variant::AsPrinted,
            *law,
            "shipped gains, seed 200",
            vec![(*rule).into(), (*width).into(), solves.into()],
        ))
    };
    let rows = context.output.progress.each("cells", &cases, fly)?;
    let values = TextValues::from([("fitting", listed(&fitting(&rows)).into())]);
    Ok(text::with_notes(text::table("cells", rows), &values))
}

/// Factor within which a count agrees with a printed one \[-\].
const FITS: f64 = 3.0;

/// Rules and widths that agree with the paper's 89 and 1 calculations.
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

/// Values of the texts: tests, search for gains, and the bound of the position error by speed and tilt.
fn values(
    laws: &[StudyLaw],
    nominal: &[Flown],
    progress: &Progress,
) -> Result<TextValues, Failure> {
    let Config { plant, mocap, position, trajectory, .. } = Config::default();
    let (square, chirp) = (trajectory.square, trajectory.attitude_chirp);
    let ways = (square.duration_s / square.dwell_s).floor();
    let speed_m_s = position.horizontal_velocity_limit_m_s;
    let acceleration = plant.gravity_m_s2 * position.tilt_limit_deg.to_radians().tan();
    let way_s = square.side_m / speed_m_s + speed_m_s / acceleration;
    let late_ms = mocap.latency_ms + plant.command_delay_ms + plant.rate_lag_ms;
    let travelled = ways * square.side_m / square.duration_s;
    let tuned = nominal.iter().filter(|flown| flown.law.variant == Variant::Ours);
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
    let mut values = search_values(laws, progress)?;
    values.extend(numbers.map(|(name, number)| (name, number.into())));
    Ok(values)
}

/// Values of the texts on the search for gains.
fn search_values(laws: &[StudyLaw], progress: &Progress) -> Result<TextValues, Failure> {
    let Budget { points, seed, optimiser } = Budget::default();
    let weights = METRIC.iter().map(|metric| format!("{} {}", metric.title, metric.weight));
    let tuned = laws.iter().filter(|law| law.variant == Variant::Ours);
    let searches: Result<Vec<String>, Failure> = tuned
        .map(|law| {
            let [shipped, tuned] = search::before_and_after(law, progress)?;
            let [shipped, tuned] = [shipped, tuned].map(|objective| match objective.is_finite() {
                true => format!("{objective:.3}"),
                false => "none, for a flight does not land".to_owned(),
            });
            Ok(format!("{} {shipped}, {tuned}", law.controller))
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
    /// Columns with mean and deviation, which a single run does not have.
    const SPREADS: [&str; 3] = ["position_error_m", "velocity_error_m_s", "attitude_error_deg"];

    fn assert_numbers(rows: &Value) {
        for row in rows.as_array().unwrap().iter().filter(|row| row["variant"] != "paper") {
            for key in NUMBERS {
                assert!(row[key].is_number(), "{key}: {row:#}");
            }
            for key in SPREADS {
                assert!(row[key]["mean"].is_number() && row[key]["sd"].is_null(), "{row:#}");
            }
        }
    }

    #[test]
    fn every_figure_of_every_law_on_every_plant_is_a_number() {
        let mut laws = all_laws();
        laws.retain(|law| ["lqr", "oqtal-dt"].contains(&law.controller));
        let flown = fly(&laws, 200..201, &Progress::default()).unwrap();
        let max_q: Vec<MaxQ> = laws.iter().map(|law| max_q(law).unwrap()).collect();
        let table = main(&flown[0], &flown[1..], &max_q).to_json();
        assert_eq!(table["rows"].as_array().unwrap().len(), 3 + laws.len());
        assert_numbers(&table["rows"]);
        let mismatched = table["mismatched"].as_array().unwrap();
        assert_eq!(mismatched.len(), 5);
        for plant in mismatched {
            assert_eq!(plant["rows"].as_array().unwrap().len(), laws.len());
            assert_numbers(&plant["rows"]);
        }
    }
}
