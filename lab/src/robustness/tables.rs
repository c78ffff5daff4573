//! The tables of the Monte-Carlo study.

use super::against;
use super::flown::{Draw, Judged};
use super::spread::{PlantSpread, SpreadKey};
use super::statistics::{Quantiles, dependence, worse_than_the_best_other};
use super::summary;
use crate::campaign::flights::Test;
use crate::campaign::metric::{HOVER, METRIC};
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

/// Keys that a figure depends on most, in the table of each law \[-\].
const STRONGEST: usize = 4;
/// Draws that are shown of those in which a law did not land \[-\].
const MOST_FAILURES: usize = 5;

/// What the laws reach on the draws, and where they do not.
#[must_use]
pub fn all(judged: &[Judged], draws: &[Draw]) -> Vec<Sheet> {
    let against = Some(against::table(judged)).filter(|sheet| !sheet.rows.is_empty());
    let details = [landed(judged), distributions(judged), broken(judged, draws)];
    [summary::table(judged)].into_iter().chain(against).chain(details).collect()
}

/// The sheets with `of` before their names.
#[must_use]
pub fn named(of: &str, sheets: Vec<Sheet>) -> Vec<Sheet> {
    let named = |sheet: Sheet| Sheet { name: format!("{of}_{}", sheet.name), ..sheet };
    sheets.into_iter().map(named).collect()
}

const LANDED: [Column; 5] = [
    ("landed", "all four landed [%]"),
    ("landed_path", "path [%]"),
    ("landed_hover", "hover [%]"),
    ("landed_chirp", "chirp [%]"),
    ("landed_doublet", "doublet [%]"),
];

fn landed(judged: &[Judged]) -> Sheet {
    let row = |law: &Judged| {
        let share = |landed: &dyn Fn(&crate::campaign::metric::Figures) -> bool| {
            let count = law.figures.iter().filter(|figures| landed(figures)).count();
            SheetCell::Number(1e2 * count as f64 / law.figures.len() as f64)
        };
        let one = |test: usize| share(&move |figures| Judged::landed(figures)[test].1);
        let all = share(&Judged::all_landed);
        row_of(
            law,
            &law.rival.remark,
            [all].into_iter().chain((0..Test::ALL.len()).map(one)).collect(),
        )
    };
    Sheet {
        name: "landed".to_owned(),
        title: "Share of the draws in which the flights landed as planned".to_owned(),
        columns: LANDED.to_vec(),
        rows: judged.iter().map(row).collect(),
        is_detail: true,
        ..Sheet::default()
    }
}

fn row_of(law: &Judged, settings: &str, cells: Vec<SheetCell>) -> SheetRow {
    SheetRow::new(Variant::Ours, law.rival.name.clone(), settings, cells)
}

const DISTRIBUTION: [Column; 5] = [
    ("median", "median"),
    ("p95", "95 % point"),
    ("worst", "worst"),
    ("worst_draw", "in draw"),
    (
        "worse_than_best_other_percent",
        "worse than the best other row, the same law with other gains included [% of draws]",
    ),
];

fn distributions(judged: &[Judged]) -> Sheet {
    let cells = |law: usize, metric: usize| {
        let quantiles = Quantiles::of(&judged[law].values(metric));
        vec![
            quantiles.median.into(),
            quantiles.p95.into(),
            quantiles.worst.into(),
            SheetCell::Count(quantiles.worst_draw as u64),
            SheetCell::Number(1e2 * worse_than_the_best_other(judged, law, metric)),
        ]
    };
    let mut rows = Vec::new();
    for (index, metric) in METRIC.iter().enumerate() {
        for (law, flown) in judged.iter().enumerate() {
            rows.push(row_of(flown, metric.title, cells(law, index)));
        }
    }
    Sheet {
        name: "distributions".to_owned(),
        title: "Figures over the draws".to_owned(),
        notes: vec![DISTRIBUTIONS_NOTE.to_owned()],
        columns: DISTRIBUTION.to_vec(),
        rows,
        is_detail: true,
        ..Sheet::default()
    }
}

const DISTRIBUTIONS_NOTE: &str = "A flight that did not land counts as worse than any that did; where a value is missing, so many \
     did not. Jitter is what the command costs, and is no figure of merit by itself.";

const BROKEN: [Column; 3] = [
    ("hover_rms_mm", "hover RMS [mm]"),
    ("failed", "not landed"),
    ("arguments", "arguments of `oqtal fly`"),
];

/// The draws that broke a law: those without a landing, and the one with the worst hover.
fn broken(judged: &[Judged], draws: &[Draw]) -> Sheet {
    let rows = judged.iter().flat_map(|law| {
        let failed = (0..draws.len()).filter(|draw| !Judged::all_landed(&law.figures[*draw]));
        let mut shown: Vec<usize> = failed.take(MOST_FAILURES).collect();
        let hover: Vec<f64> = law.values(HOVER);
        let finite = |index: &usize| hover[*index].is_finite();
        let worst = (0..draws.len()).filter(finite).max_by(|a, b| hover[*a].total_cmp(&hover[*b]));
        shown.extend(worst.filter(|worst| !shown.contains(worst)));
        shown.into_iter().map(|draw| broken_row(law, &draws[draw], draw)).collect::<Vec<_>>()
    });
    Sheet {
        name: "broken".to_owned(),
        title: "Flights that ended early".to_owned(),
        notes: vec![BROKEN_NOTE.to_owned()],
        columns: BROKEN.to_vec(),
        rows: rows.collect(),
        is_detail: true,
        ..Sheet::default()
    }
}

const BROKEN_NOTE: &str = "Of each law the first draws in which a flight did not land, and the one with the greatest error in \
     hover. On the chirp the position loop is open and the vehicle drifts: one that does not come back within 3 s of the sweep's \
     end is landed by the daemon, although its attitude was held. `oqtal fly --clock in-process --trajectory hover --controller \
     LAW` with these arguments flies the draw again, a chirp with `--trajectory attitude-chirp`; gains that are not those of the configuration are added by `--config deploy/tuned/LAW.toml`.";

fn broken_row(law: &Judged, draw: &Draw, index: usize) -> SheetRow {
    let figures = &law.figures[index];
    let failed: Vec<String> = Judged::landed(figures)
        .iter()
        .filter(|(_, landed)| !landed)
        .map(|(test, _)| test.name().to_owned())
        .collect();
    let arguments = format!("--seed {} {}", draw.seed, draw.arguments());
    let failed =
        if failed.is_empty() { SheetCell::None } else { failed.join(", ").as_str().into() };
    let cells = vec![figures[HOVER].into(), failed, arguments.as_str().into()];
    row_of(law, &format!("draw {}", draw.run), cells)
}

const DEPENDENCE: [Column; 1] = [("rank_correlation", "rank correlation with the hover's error")];

/// The keys that the error in hover of each law depends on most.
#[must_use]
pub fn dependences(judged: &[Judged], draws: &[Draw], spread: &PlantSpread) -> Sheet {
    let rows = judged.iter().flat_map(|law| {
        let values = law.values(HOVER);
        let of_key =
            |SpreadKey { key, .. }: &SpreadKey| (key.clone(), dependence(&values, draws, key));
        let mut keys: Vec<(String, f64)> =
            spread.keys.iter().map(of_key).filter(|(_, share)| share.is_finite()).collect();
        keys.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
        let row = |(key, share): (String, f64)| row_of(law, &key, vec![share.into()]);
        keys.into_iter().take(STRONGEST).map(row).collect::<Vec<_>>()
    });
    Sheet {
        name: "dependences".to_owned(),
        title: "What the error in hover depends on".to_owned(),
        notes: vec!["Spearman's rank correlation over all draws: 1 where the error always rises with the key.".to_owned()],
        columns: DEPENDENCE.to_vec(),
        rows: rows.collect(),
        is_detail: true,
        ..Sheet::default()
    }
}

/// The spread itself.
#[must_use]
pub fn spread_table(spread: &PlantSpread) -> Sheet {
    let row = |SpreadKey { key, form }: &SpreadKey| {
        SheetRow::new(Variant::Ours, "all", key.clone(), vec![form.words().as_str().into()])
    };
    Sheet {
        name: "spread".to_owned(),
        title: "The spread".to_owned(),
        notes: vec![SPREAD_NOTE.to_owned()],
        columns: vec![("drawn", "drawn")],
        rows: spread.keys.iter().map(row).collect(),
        ..Sheet::default()
    }
}

const SPREAD_NOTE: &str = "Evenly between the bounds, each key by itself. A spread of one's own is a file in TOML, each key of the \
     configuration with one of these forms: `between = [LOW, HIGH]`, a number; `factor = [LOW, HIGH]`, the configured value times a \
     number; `each-factor`, every element of a list times a number of its own; `one-factor`, one element of a list, drawn too, times a \
     number; `choose = [VALUES]`, one of them. As in `[plant]` with `mass-kg = { factor = [0.9, 1.1] }`.";
