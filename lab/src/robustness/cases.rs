//! Single plants: the nominal one, and some at and beyond the edge of the spread.

use oqtal_runtime::process::Failure;

use crate::progress::Progress;
use crate::sheet::{Sheet, SheetRow, Variant};
use crate::study::flights::{AUTHORITY, Change, NOMINAL, PlantVariant, RATE_LAG};
use crate::study::law::StudyLaw;
use crate::study::metric::{CHIRP, HOVER, METRIC, METRICS};
use crate::study::table::column;
use crate::study::{Case, Flown, Study};

const HIDDEN_DELAY: &str = "plant.hidden-delay-ms";

/// The plants.
const PLANTS: [PlantVariant; 12] = [
    NOMINAL,
    PlantVariant { name: "rate lag 30 ms", changes: &[Change::To(RATE_LAG, 30.0)] },
    PlantVariant { name: "rate lag 80 ms", changes: &[Change::To(RATE_LAG, 80.0)] },
    PlantVariant { name: "rate lag 84 ms", changes: &[Change::To(RATE_LAG, 84.0)] },
    PlantVariant { name: "rate lag 90 ms", changes: &[Change::To(RATE_LAG, 90.0)] },
    PlantVariant { name: "rate lag 120 ms", changes: &[Change::To(RATE_LAG, 120.0)] },
    PlantVariant {
        name: "authority -20 %, rate lag 80 ms",
        changes: &[Change::Times(AUTHORITY, 0.8), Change::To(RATE_LAG, 80.0)],
    },
    PlantVariant { name: "hidden delay 30 ms", changes: &[Change::To(HIDDEN_DELAY, 30.0)] },
    PlantVariant { name: "hidden delay 40 ms", changes: &[Change::To(HIDDEN_DELAY, 40.0)] },
    PlantVariant {
        name: "rate lag 120 ms, hidden delay 40 ms",
        changes: &[Change::To(RATE_LAG, 120.0), Change::To(HIDDEN_DELAY, 40.0)],
    },
    PlantVariant { name: "authority doubled: 6 dB", changes: &[Change::Times(AUTHORITY, 2.0)] },
    PlantVariant { name: "authority halved", changes: &[Change::Times(AUTHORITY, 0.5)] },
];

/// Seeds of the flights.
const SEEDS: std::ops::Range<u64> = 300..305;

const NOTE: &str = "Means of seeds 300 to 304; a dash marks a flight that did not land.";

/// Flies every law on every plant. Returns tables of hover and chirp with one column per plant, and of all figures with one row
/// per plant.
///
/// # Errors
/// A setting is invalid.
pub fn tables(laws: &[StudyLaw], progress: &Progress) -> Result<[Sheet; 3], Failure> {
    let cases = PLANTS.map(|plant| Case::on(plant, SEEDS));
    let flown = Study { name: "single plants", laws, cases: &cases }.fly(progress)?;
    let of_laws: Vec<&[Flown]> = flown.chunks(PLANTS.len()).collect();
    let hover = beside(&of_laws, ("plants_hover", "Single plants: hover [mm]"), HOVER);
    let chirp = beside(&of_laws, ("plants_chirp", "Single plants: chirp [°]"), CHIRP);
    let metric = |metric: usize| {
        let (key, title) = (METRIC[metric].key, METRIC[metric].title);
        column(key, title, move |row: &&Flown| finite(row.mean()[metric]))
    };
    let columns: [_; METRICS] = std::array::from_fn(metric);
    let rows = (0..PLANTS.len()).flat_map(|plant| of_laws.iter().map(move |of| &of[plant]));
    let rows: Vec<&Flown> = rows.collect();
    let names = |row: &&Flown| row.names_with(row.case.as_str());
    let all = Sheet::tabulate(("plants", "Single plants"), &columns, &rows, names);
    Ok([hover, chirp, all.with_note(NOTE).as_detail()])
}

/// Table of one figure, with one column per plant.
fn beside(of_laws: &[&[Flown]], (name, title): (&str, &str), metric: usize) -> Sheet {
    let row = |of: &&[Flown]| {
        let cells = of.iter().map(|row| finite(row.mean()[metric]).into()).collect();
        SheetRow::new(Variant::Ours, of[0].law.name.clone(), "", cells)
    };
    Sheet {
        name: name.to_owned(),
        title: title.to_owned(),
        notes: vec![NOTE.to_owned()],
        columns: PLANTS.map(|plant| (plant.name, plant.name)).to_vec(),
        rows: of_laws.iter().map(row).collect(),
        ..Sheet::default()
    }
}

fn finite(figure: f64) -> Option<f64> {
    Some(figure).filter(|figure| figure.is_finite())
}
