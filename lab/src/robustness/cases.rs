//! Single plants: the nominal one, and some at and beyond the edge of the spread.

use oqtal_runtime::process::Failure;

use super::tables::{self, FAILURES};
use crate::progress::Progress;
use crate::sheet::Sheet;
use crate::study::failure::FailedFlights;
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

const NOTE: &str = "Means of seeds 300 to 304; a dash marks a figure for which at least one of the five flights did not land as \
     planned (for example, the fence held it for a time) or had a step that did not settle.";

/// Flies every law on every plant. Returns the rows grouped by law.
///
/// # Errors
/// A setting is invalid.
pub fn fly(laws: &[StudyLaw], progress: &Progress) -> Result<Vec<Flown>, Failure> {
    let cases = PLANTS.map(|plant| Case::on(plant, SEEDS));
    Study { name: "single plants", laws, cases: &cases }.fly(progress)
}

/// Whether the row is one of a single plant.
pub fn is_single_plant(row: &Flown) -> bool {
    PLANTS.iter().any(|plant| plant.name == row.case)
}

/// Tables of the rows of [`fly`]: hover and chirp with one column per plant, all figures with one row per plant, and the flights that
/// failed, if any did.
pub fn tables(flown: &[Flown]) -> Vec<Sheet> {
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
    let failures = Some(failures(flown)).filter(|sheet| !sheet.rows.is_empty());
    [hover, chirp, all.with_note(NOTE).as_detail()].into_iter().chain(failures).collect()
}

/// Failed flights by law, test, plant and cause.
fn failures(flown: &[Flown]) -> Sheet {
    let columns = [
        column("plant", "plant", |group: &FailedFlights<'_>| group.case),
        column("cause", "cause", |group: &FailedFlights<'_>| group.cause),
        column("flights", "flights", |group: &FailedFlights<'_>| group.conditions.len() as u64),
    ];
    tables::failed((&format!("plants_{FAILURES}"), "Single plants: "), &columns, flown)
}

/// Table of one figure, with one column per plant.
fn beside(of_laws: &[&[Flown]], (name, title): (&str, &str), metric: usize) -> Sheet {
    let figure = |k: usize| move |of: &&[Flown]| finite(of[k].mean()[metric]);
    let columns: [_; PLANTS.len()] =
        std::array::from_fn(|k| column(PLANTS[k].name, PLANTS[k].name, figure(k)));
    let names = |of: &&[Flown]| of[0].names_with("");
    Sheet::tabulate((name, title), &columns, of_laws, names).with_note(NOTE)
}

fn finite(figure: f64) -> Option<f64> {
    Some(figure).filter(|figure| figure.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::tests::flown;

    #[test]
    fn a_failed_flight_of_a_single_plant_is_listed_with_plant_and_cause() {
        let case =
            |plant: &PlantVariant| Flown { case: plant.name.to_owned(), ..flown("pid", &[1.0]) };
        let mut rows: Vec<Flown> = PLANTS.iter().map(case).collect();
        assert_eq!(tables(&rows).len(), 3);
        rows[1].runs[0] = crate::study::tests::run(f64::INFINITY, 0);
        rows[1].runs[0].ends.iter_mut().for_each(|end| end.cause = Some("held".to_owned()));
        let failures = &tables(&rows)[3];
        assert!(failures.name.ends_with(FAILURES), "the remedies are printed");
        let cells: Vec<String> = failures.rows[0].cells.iter().map(|cell| cell.show()).collect();
        assert_eq!(
            (failures.rows.len(), &cells[..]),
            (4, &["rate lag 30 ms", "held", "1"].map(str::to_owned)[..])
        );
        assert!(rows.iter().all(is_single_plant) && !is_single_plant(&flown("pid", &[1.0])));
    }
}
