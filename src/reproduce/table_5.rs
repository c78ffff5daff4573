//! Table V: the square on the simulated testbed, 25 runs of every law, and plants that are not what the laws expect.

use oqtal_bus::config::{Config, Setting};
use oqtal_bus::process::Failure;
use rayon::prelude::*;

use crate::campaign::flights::{Contender, MISMATCHED, NOMINAL, Prepared, Test};
use crate::campaign::metric::{METRIC, METRICS, Metric, POSITION};
use crate::campaign::statistics::{EVALUATION_SEEDS, TRAINING_SEEDS};
use crate::campaign::table::{self, BEST, COLUMNS, Entrant, Flown, PAPER};
use crate::tune::{self, search::Budget};

use super::judgement::{self, Evidence};
use super::sheet::{Cell, Column, Row, Sheet, Variant};
use super::words::{about, figure, listed};
use super::{Chapter, Context, figures};

/// What the paper prints: mean and deviation of position, velocity and attitude error, greatest q, calculations.
type Printed = (&'static str, [(f64, f64); 3], Option<f64>, u64);

const PRINTED: [Printed; 3] = [
    ("pid", [(0.330, 0.005), (0.147, 0.004), (1.192, 0.098)], None, 0),
    ("lqr", [(0.323, 0.005), (0.143, 0.002), (1.575, 0.047)], Some(20.0), 89),
    ("oqtal", [(0.306, 0.012), (0.139, 0.001), (1.184, 0.039)], Some(200.0), 1),
];

/// Flies Table V, the mismatched plants, and the counts by cell rule.
///
/// # Errors
/// A setting has no meaning.
pub fn chapter(context: &Context) -> Result<Chapter, Failure> {
    let entrants = entrants(context)?;
    let nominal = table::fly(&entrants, &NOMINAL, &PAPER, &context.progress)?;
    let scope = table::Scope { raises_weights: false, ..PAPER };
    let others: Result<Vec<Vec<Flown>>, Failure> = MISMATCHED
        .iter()
        .map(|plant| table::fly(&entrants, plant, &scope, &context.progress))
        .collect();
    let others = others?;
    let evidence = Evidence { plant: NOMINAL.name, flown: &nominal };
    let elsewhere: Vec<Evidence<'_>> = MISMATCHED
        .iter()
        .zip(&others)
        .map(|(plant, flown)| Evidence { plant: plant.name, flown })
        .collect();
    let mismatched = elsewhere.iter().map(|Evidence { plant, flown }| {
        sheet(plant, format!("The same with {plant}"), table::rows(flown, BEST))
    });
    let rows = paper().chain(table::rows(&nominal, BEST)).collect();
    let main = Sheet {
        notes: notes(&nominal),
        mismatched: mismatched.collect(),
        ..sheet("V", TITLE.to_owned(), rows)
    };
    let judged = [
        judgement::duels(&evidence, &elsewhere),
        judgement::intervals(&evidence),
        judgement::ranking(&evidence),
    ];
    let more = [outer(context)?, counts(context)?];
    Ok(Chapter {
        title: "Square on the testbed",
        intro: vec![INTRO.to_owned()],
        sheets: [main].into_iter().chain(judged).chain(more).collect(),
        figures: figures::square::all(&entrants)?,
    })
}

/// The laws, tuned anew if that is asked for.
fn entrants(context: &Context) -> Result<Vec<Entrant>, Failure> {
    let mut entrants = table::entrants();
    if context.retune {
        for entrant in entrants.iter_mut().filter(|entrant| entrant.variant == Variant::Ours) {
            let name = entrant.contender.controller;
            let tuned = tune::tune(name, Default::default(), &context.progress)?;
            context.keep(&format!("tuned/{name}.toml"), &tuned.to_toml())?;
            entrant.contender.settings = tuned.settings();
            entrant.settings = "tuned alike, anew".to_owned();
        }
    }
    Ok(entrants)
}

fn sheet(name: &str, title: String, rows: Vec<Row>) -> Sheet {
    Sheet { name: name.to_owned(), title, columns: COLUMNS.to_vec(), rows, ..Sheet::default() }
}

const TITLE: &str = "Table V: repeated square";

const INTRO: &str = "The Hummingbird of Eq. (61) with a rate loop that lags by 50 ms, a radio delay of 20 ms, cameras with 15 ms \
     latency, 0.5 mm and 0.2 degrees of noise, drift, a small force and gusts: a simulation, where the paper had a laboratory. \
     So the paper's numbers are not comparable one by one; how the laws compare with each other is. The reference jumps \
     from corner to corner of a square of 1.3 m.";

fn notes(nominal: &[Flown]) -> Vec<String> {
    vec![FIGURES.to_owned(), tuning(), max_q(nominal), bound(nominal)]
}

const FIGURES: &str = "Position, velocity and attitude: mean and deviation of the best runs by position error, as in the paper; all \
     other figures are means of all runs. The velocity error is against the velocity that the position loops command, the \
     attitude error against the attitude they command: a smoother command makes both smaller without flying any better. So the \
     table also has what no command of its own can improve: hover, corners, and a prescribed attitude with the position loops \
     open.";

/// How the gains of our block were found.
fn tuning() -> String {
    let Budget { points, seed, optimiser } = Budget::default();
    let name = optimiser.name();
    let weights: Vec<String> =
        METRIC.iter().map(|metric| format!("{} {}", metric.title, metric.weight)).collect();
    format!(
        "\"Ours\": every law with its gains and the position loops around it tuned by the same optimiser, {name}, with the same \
         budget of {points} points, seed {seed}, from the shipped gains, for the same mean of these figures over those of the \
         shipped oqtal, on seeds {} to {}, of which four fly on slightly mismatched plants; judged on seeds {} to {}. Weights of \
         the figures: {}. Of what no command of a law's own can improve, two figures are of a prescribed attitude; hover, which is the only one of \
         the position, counts double.",
        TRAINING_SEEDS.start,
        TRAINING_SEEDS.end - 1,
        EVALUATION_SEEDS.start,
        EVALUATION_SEEDS.end - 1,
        weights.join(", ")
    )
}

/// What the greatest weights of the paper's two LQRs come to.
fn max_q(nominal: &[Flown]) -> String {
    let of = |name: &str| {
        let printed = nominal.iter().filter(|flown| !flown.is_tuned() && flown.name() == name);
        printed.filter_map(Flown::max_q).fold(0.0, f64::max)
    };
    let (lqr, oqtal) = (of("lqr"), of("oqtal"));
    format!(
        "Max q: the weight (for laws without one, the gain) raised by a factor of 1.41 at a time until the mean attitude error is \
         25 % above the least. With the paper's gains lqr comes to {} and oqtal to {}, {} times as far; printed are 20 and 200. \
         By algebra it is four times at small angles, because eps is half an angle.",
        figure(lqr),
        figure(oqtal),
        about(oqtal / lqr)
    )
}

/// What limits on speed and tilt leave of the position error, and how near the laws are.
fn bound(nominal: &[Flown]) -> String {
    let Config { vehicle, mocap, position, trajectory, .. } = Config::default();
    let side = trajectory.square.side_m;
    let duration = trajectory.square.duration_s;
    let ways = (duration / trajectory.square.dwell_s).floor();
    let speed = position.horizontal_velocity_limit_m_s;
    let acceleration = vehicle.gravity_m_s2 * position.tilt_limit_deg.to_radians().tan();
    let way_s = side / speed + speed / acceleration;
    let least = ways * side * way_s / 2.0 / duration;
    let late_ms = mocap.latency_ms + vehicle.radio_delay_ms + vehicle.rate_lag_ms;
    let late = ways * side * late_ms * 1e-3 / duration;
    let tuned: Vec<f64> = nominal
        .iter()
        .filter(|flown| flown.is_tuned())
        .map(|flown| flown.interval(POSITION).mean)
        .collect();
    let [from, to] = [f64::min, f64::max].map(|pick| tuned.iter().copied().fold(tuned[0], pick));
    format!(
        "The position error is bounded by the limits on speed and tilt, not by the law: {side} m at {speed} m/s, with {} degrees \
         to speed up and brake, take {way_s:.2} s, and {ways} such ways in {duration} s make a mean error of {least:.3} m \
         without any delay; delay and lag of {late_ms} ms add {late:.3} m. The tuned laws come to {from:.3} to {to:.3} m.",
        position.tilt_limit_deg
    )
}

fn paper() -> impl Iterator<Item = Row> {
    PRINTED.into_iter().map(|(name, errors, max_q, solves)| {
        let mut cells = vec![Cell::None; COLUMNS.len()];
        for (cell, (mean, sd)) in cells.iter_mut().zip(errors) {
            *cell = Cell::Spread(mean, sd);
        }
        cells[METRICS] = solves.into();
        cells[METRICS + 1] = max_q.into();
        cells[METRICS + 2] = Cell::Count(25);
        cells[METRICS + 3] = Cell::Count(5);
        Row::new(Variant::Paper, name, "laboratory", cells)
    })
}

/// The shipped `oqtal` with the outer loops as shipped, and tuned one at a time.
fn outer(context: &Context) -> Result<Sheet, Failure> {
    let tuned = match context.retune {
        true => {
            let tuned = tune::tune("outer", Default::default(), &context.progress)?;
            context.keep("tuned/outer.toml", &tuned.to_toml())?;
            tuned.settings()
        }
        false => tune::gains::tuned("outer"),
    };
    let entrants =
        [("as shipped", Vec::new()), ("tuned one at a time", tuned)].map(|(outer, settings)| {
            Entrant {
                contender: Contender { controller: "oqtal", settings },
                variant: Variant::Ours,
                settings: format!("q 80, outer loops {outer}"),
            }
        });
    let scope = table::Scope { raises_weights: false, ..PAPER };
    let flown = table::fly(&entrants, &NOMINAL, &scope, &context.progress)?;
    let notes = vec![OUTER.to_owned(), changed(&flown[0], &flown[1])];
    Ok(Sheet { notes, ..sheet("outer", OUTER_TITLE.to_owned(), table::rows(&flown, BEST)) })
}

const OUTER_TITLE: &str = "The six outer PIDs, tuned one at a time";
const OUTER: &str = "As the paper's reference [27] does in flight: one loop after the other, single input and single output, the inner \
     ones first, each for its own error and a calm command; X and Y share their gains. The paper keeps the result for all \
     three attitude laws.";

/// What tuning the loops one at a time changed, told apart or not.
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

/// How often a Riccati equation is solved in a square, by the rule for cells and their width.
fn counts(context: &Context) -> Result<Sheet, Failure> {
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
        let settings = vec![
            Setting::flag("cells", &key("cells"), *rule),
            Setting::flag("cells", &key("delta-rad"), *delta),
        ];
        let contender = Contender { controller: law, settings };
        let flown = Prepared::new(&contender, Test::Square, &NOMINAL)?.fly(200)?;
        let solves = flown.and_then(|(flight, _)| {
            flight.samples.last().map(|sample| sample.telemetry.riccati_solves)
        });
        bar.inc();
        Ok(Row::new(
            Variant::AsPrinted,
            *law,
            "shipped gains, seed 200",
            vec![(*rule).into(), (*width).into(), solves.into()],
        ))
    };
    let rows: Result<Vec<Row>, Failure> = cases.par_iter().map(fly).collect();
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

/// A count within this factor of a printed one fits.
const FITS: f64 = 3.0;

/// Which rules and widths fit the paper's 89 and 1 calculations.
fn fitting(rows: &[Row]) -> String {
    let (lqr, oqtal) = rows.split_at(rows.len() / 2);
    let fits = |(lqr, oqtal): (&Row, &Row)| match (&lqr.cells[2], &oqtal.cells[2]) {
        (Cell::Count(many), Cell::Count(1)) => {
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
