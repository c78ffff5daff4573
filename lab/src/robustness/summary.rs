//! One row for each law: what it reaches over the draws.

use super::flown::Judged;
use super::statistics::Quantiles;
use crate::campaign::metric::{ATTITUDE, CHIRP, DOUBLET, HOVER, JITTER, SETTLE};
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

const COLUMNS: [Column; 10] = [
    ("landed_percent", "all four landed [%]"),
    ("hover_median_mm", "hover, median [mm]"),
    ("hover_p95_mm", "hover, 95 % point [mm]"),
    ("hover_worst_mm", "hover, worst [mm]"),
    ("chirp_median_deg", "chirp, median [°]"),
    ("chirp_p95_deg", "chirp, 95 % point [°]"),
    ("doublet_median_s", "doublet settled, median [s]"),
    ("settle_median_s", "path settled, median [s]"),
    ("attitude_median_deg", "attitude on the path, median [°]"),
    ("jitter_median_rad_s", "jitter, median [rad/s]"),
];

const NOTE: &str = "A flight that did not land counts as worse than any that did: where a value is missing, so many did not. Jitter \
     is what the command costs.";

/// The table.
#[must_use]
pub fn table(judged: &[Judged]) -> Sheet {
    Sheet {
        name: "summary".to_owned(),
        title: "The laws over the draws".to_owned(),
        notes: vec![NOTE.to_owned()],
        columns: COLUMNS.to_vec(),
        rows: judged.iter().map(row).collect(),
        ..Sheet::default()
    }
}

fn row(law: &Judged) -> SheetRow {
    let of = |metric: usize| Quantiles::of(&law.values(metric));
    let (hover, chirp) = (of(HOVER), of(CHIRP));
    let landed = law.figures.iter().filter(|figures| Judged::all_landed(figures)).count();
    let figures = [
        1e2 * landed as f64 / law.figures.len() as f64,
        hover.median,
        hover.p95,
        hover.worst,
        chirp.median,
        chirp.p95,
        of(DOUBLET).median,
        of(SETTLE).median,
        of(ATTITUDE).median,
        of(JITTER).median,
    ];
    let cells = figures.map(SheetCell::Number).to_vec();
    SheetRow::new(Variant::Ours, law.rival.name.clone(), law.rival.remark.clone(), cells)
}
