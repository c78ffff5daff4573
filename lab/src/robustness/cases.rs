//! Single plants: the nominal one, and some at and beyond the edge of the spread.

use oqtal_config::Setting;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use super::flown::Rival;
use crate::campaign::flights::{Contender, NOMINAL, Trial};
use crate::campaign::metric::{CHIRP, Figures, HOVER, METRIC};
use crate::campaign::statistics::Runs;
use crate::progress::Progress;
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

/// A plant, by its name and its keys of `[plant]`.
type Case = (&'static str, &'static [(&'static str, f64)]);

/// The plants. Authority is a factor of the configured one.
const CASES: [Case; 12] = [
    ("nominal", &[]),
    ("rate lag 30 ms", &[("plant.rate-lag-ms", 30.0)]),
    ("rate lag 80 ms", &[("plant.rate-lag-ms", 80.0)]),
    ("rate lag 84 ms", &[("plant.rate-lag-ms", 84.0)]),
    ("rate lag 90 ms", &[("plant.rate-lag-ms", 90.0)]),
    ("rate lag 120 ms", &[("plant.rate-lag-ms", 120.0)]),
    ("authority -20 %, rate lag 80 ms", &[(AUTHORITY, 0.8), ("plant.rate-lag-ms", 80.0)]),
    ("hidden delay 30 ms", &[("plant.hidden-delay-ms", 30.0)]),
    ("hidden delay 40 ms", &[("plant.hidden-delay-ms", 40.0)]),
    (
        "rate lag 120 ms, hidden delay 40 ms",
        &[("plant.rate-lag-ms", 120.0), ("plant.hidden-delay-ms", 40.0)],
    ),
    ("authority doubled: 6 dB", &[(AUTHORITY, 2.0)]),
    ("authority halved", &[(AUTHORITY, 0.5)]),
];

const AUTHORITY: &str = "plant.rate-authority-rad-s";

/// Seeds of the flights.
const SEEDS: std::ops::Range<u64> = 300..305;

/// Flies every law on every plant. Returns hover and chirp with a column for each plant, and all figures with a row for each.
///
/// # Errors
/// A setting has no meaning.
pub fn tables(rivals: &[Rival], progress: &Progress) -> Result<[Sheet; 3], Failure> {
    let all = table(rivals, progress)?;
    let hover = beside(&all, ("plants_hover", "Single plants: hover [mm]"), METRIC[HOVER].key);
    let chirp = beside(&all, ("plants_chirp", "Single plants: chirp [°]"), METRIC[CHIRP].key);
    Ok([hover, chirp, all])
}

/// One figure of `all`, the plants beside each other.
fn beside(all: &Sheet, (name, title): (&str, &str), key: &str) -> Sheet {
    let of_first = all.rows.iter().filter(|row| row.settings == CASES[0].0);
    let rows = of_first.map(|first| {
        let own = all.rows.iter().filter(|row| row.controller == first.controller);
        let cells = own.map(|row| finite(row.number(&all.columns, key))).collect();
        SheetRow::new(Variant::Ours, first.controller.clone(), "", cells)
    });
    Sheet {
        name: name.to_owned(),
        title: title.to_owned(),
        notes: vec![NOTE.to_owned()],
        columns: CASES.map(|(case, _)| (case, case)).to_vec(),
        rows: rows.collect(),
        ..Sheet::default()
    }
}

fn finite(figure: f64) -> SheetCell {
    if figure.is_finite() { SheetCell::Number(figure) } else { SheetCell::None }
}

fn table(rivals: &[Rival], progress: &Progress) -> Result<Sheet, Failure> {
    let pairs: Vec<(&Case, &Rival)> =
        CASES.iter().flat_map(|case| rivals.iter().map(move |rival| (case, rival))).collect();
    let bar = progress.start("single plants", pairs.len());
    let rows: Result<Vec<SheetRow>, Failure> = pairs
        .into_par_iter()
        .map(|(case, rival)| {
            let figures = mean(case, rival)?;
            bar.inc();
            let cells = figures.map(finite).to_vec();
            Ok(SheetRow::new(Variant::Ours, rival.name.clone(), case.0, cells))
        })
        .collect();
    Ok(Sheet {
        name: "plants".to_owned(),
        title: "Single plants".to_owned(),
        notes: vec![NOTE.to_owned()],
        columns: METRIC.map(|metric| -> Column { (metric.key, metric.title) }).to_vec(),
        rows: rows?,
        is_detail: true,
        ..Sheet::default()
    })
}

const NOTE: &str = "Means of seeds 300 to 304; a dash stands where a flight did not land.";

/// The mean figures of a law on a plant.
fn mean((_, keys): &Case, rival: &Rival) -> Result<Figures, Failure> {
    let nominal = oqtal_config::Config::from_settings(&rival.settings)?;
    let setting = |(key, value): &(&str, f64)| match *key {
        AUTHORITY => {
            let scaled = nominal.plant.rate_authority_rad_s.map(|authority| value * authority);
            Setting::flag("case", key, scaled.to_vec())
        }
        key => Setting::flag("case", key, *value),
    };
    let own: Vec<Setting> = keys.iter().map(setting).collect();
    let settings = [&rival.settings[..], &own].concat();
    let trial = Trial::new(&Contender { controller: rival.controller, settings }, &NOMINAL)?;
    let flown: Result<Vec<_>, Failure> = SEEDS.map(|seed| trial.fly(seed)).collect();
    Ok(Runs::from_iter(flown?).mean())
}
