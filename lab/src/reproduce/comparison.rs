//! Statistical comparison of the laws of Table V: differences, ratios and their confidence intervals.

use std::collections::BTreeMap;

use oqtal_control::statistics::{Interval, mean};
use oqtal_observe::plot::unit::rounded;

use crate::campaign::table::COLUMNS;
use crate::study::metric::{
    ATTITUDE, CHIRP, DOUBLET, HOVER, METRIC, METRICS, POSITION, SETTLE, VELOCITY,
};
use crate::study::{Flown, Run};

use super::expression::TextValues;
use super::text::{self, listed};
use crate::sheet::{Sheet, SheetCell, SheetRow, Variant};

/// Law that is compared with the others.
const OURS: &str = "oqtal-dt";

/// Goal for a metric.
#[derive(Clone, Copy)]
enum Goal {
    /// Upper bound of the metric itself \[unit of the metric\].
    AtMost(f64),
    /// Lower bound of the ratio of the best other law's metric to that of [`OURS`] \[-\].
    Times(f64),
}

/// At most 8 % worse: for metrics determined by the limits of speed and tilt.
const PARITY: Goal = Goal::Times(1.0 / 1.08);

const GOALS: [(usize, Goal); 9] = [
    (POSITION, Goal::AtMost(0.27)),
    (POSITION, PARITY),
    (VELOCITY, Goal::AtMost(0.07)),
    (ATTITUDE, Goal::AtMost(0.3)),
    (SETTLE, PARITY),
    (HOVER, Goal::AtMost(2.5)),
    (HOVER, Goal::Times(2.0)),
    (CHIRP, Goal::Times(3.0)),
    (DOUBLET, Goal::Times(1.8)),
];
/// Goal on mismatched plants.
const MISMATCHED_GOAL: (usize, Goal) = (CHIRP, Goal::Times(2.0));

/// Flights of all laws on one plant.
pub struct FlownLaws {
    /// Description of the plant.
    pub plant: &'static str,
    /// Flights of every law.
    pub flown: Vec<Flown>,
}

impl FlownLaws {
    fn tuned(&self) -> impl Iterator<Item = &Flown> {
        self.flown.iter().filter(|flown| flown.law.variant == Variant::Ours)
    }

    /// The flights of [`OURS`].
    fn ours(&self) -> Option<&Flown> {
        self.tuned().find(|flown| flown.law.controller == OURS)
    }

    /// Best of the other tuned laws by a metric, with its interval.
    fn rival(&self, metric: usize) -> Option<(&'static str, Interval)> {
        let others = self.tuned().filter(|flown| flown.law.controller != OURS);
        let figures = others.map(|flown| (flown.law.controller, flown.interval(metric)));
        figures.min_by(|a, b| a.1.mean.total_cmp(&b.1.mean))
    }
}

/// [`OURS`] and the best other law by one metric.
struct LawComparison {
    metric: usize,
    ours: Interval,
    rival: (&'static str, Interval),
}

impl LawComparison {
    fn of(laws: &FlownLaws, metric: usize) -> Option<Self> {
        let (ours, rival) = (laws.ours()?.interval(metric), laws.rival(metric)?);
        Some(Self { metric, ours, rival })
    }

    /// Ratio of the other law's metric to that of [`OURS`], with its interval.
    fn times(&self) -> Interval {
        let (a, b) = (&self.ours, &self.rival.1);
        let mean = b.mean / a.mean;
        Interval { mean, half: mean * (a.half / a.mean).hypot(b.half / b.mean) }
    }

    fn is_apart(&self) -> bool {
        self.ours.is_apart_from(&self.rival.1)
    }

    /// Whether the whole interval meets a goal.
    fn meets(&self, goal: Goal) -> bool {
        match goal {
            Goal::AtMost(limit) => self.ours.high() <= limit,
            Goal::Times(least) => self.times().low() >= least,
        }
    }

    fn title(&self) -> &'static str {
        METRIC[self.metric].title
    }

    fn row(&self, plant: &str, goal: Option<Goal>) -> SheetRow {
        let spread = |interval: &Interval| SheetCell::Interval(interval.mean, interval.half);
        let (kind, number) = match goal {
            Some(Goal::AtMost(most)) => ("at most", Some(most)),
            Some(Goal::Times(least)) => ("times, at least", Some(least)),
            None => ("", None),
        };
        let cells = vec![
            plant.into(),
            self.title().into(),
            spread(&self.ours),
            self.rival.0.into(),
            spread(&self.rival.1),
            spread(&self.times()),
            yes_or_no(self.is_apart()).into(),
            kind.into(),
            number.into(),
            goal.map(|goal| yes_or_no(self.meets(goal))).into(),
        ];
        SheetRow::new(Variant::Ours, OURS, "against the best of the other tuned laws", cells)
    }
}

fn yes_or_no(holds: bool) -> &'static str {
    if holds { "yes" } else { "no" }
}

/// Table of `oqtal-dt` against the best other law: every metric on the nominal plant, the chirp on the mismatched ones.
pub fn against_the_best(nominal: &FlownLaws, mismatched: &[FlownLaws]) -> Sheet {
    let goals = |metric| GOALS.iter().filter(move |(of, _)| *of == metric).map(|(_, goal)| *goal);
    let mut rows = Vec::new();
    let mut missed = Vec::new();
    for metric in 0..METRICS {
        let Some(pair) = LawComparison::of(nominal, metric) else { continue };
        missed.extend(goals(metric).filter(|goal| !pair.meets(*goal)).map(|_| pair.title()));
        let goals: Vec<Option<Goal>> = goals(metric).map(Some).collect();
        let shown = if goals.is_empty() { vec![None] } else { goals };
        rows.extend(shown.into_iter().map(|goal| pair.row(nominal.plant, goal)));
    }
    for laws in mismatched {
        let (metric, goal) = MISMATCHED_GOAL;
        let Some(pair) = LawComparison::of(laws, metric) else { continue };
        missed.extend((!pair.meets(goal)).then_some(laws.plant));
        rows.push(pair.row(laws.plant, Some(goal)));
    }
    let mut values = distinguished(nominal);
    values.insert("missed", listed(&missed).into());
    values.insert("unstable", listed(&unstable(mismatched)).into());
    text::with_notes(text::table("V-verdict", rows), &values)
}

/// Metrics in which [`OURS`] is better, worse or equal, with the ratios.
fn distinguished(nominal: &FlownLaws) -> TextValues {
    let mut lists: BTreeMap<&'static str, Vec<String>> =
        ["better", "worse", "open"].map(|name| (name, Vec::new())).into();
    for pair in (0..METRICS).filter_map(|metric| LawComparison::of(nominal, metric)) {
        let name = match (pair.is_apart(), pair.ours.mean < pair.rival.1.mean) {
            (true, true) => "better",
            (true, false) => "worse",
            (false, _) => "open",
        };
        let times = rounded(pair.times().mean, 2);
        lists.entry(name).or_default().push(format!("{} ({times})", pair.title()));
    }
    lists.into_iter().map(|(name, metrics)| (name, listed(&metrics).into())).collect()
}

/// Plants on which a flight of [`OURS`] did not land.
fn unstable(mismatched: &[FlownLaws]) -> Vec<&'static str> {
    let landed = |flown: &Flown| flown.runs.iter().all(Run::all_as_planned);
    let lost = mismatched.iter().filter(|laws| !laws.ours().is_some_and(landed));
    lost.map(|laws| laws.plant).collect()
}

/// Mean of every metric with its interval, for each tuned law.
pub fn intervals(nominal: &FlownLaws) -> Sheet {
    let row = |flown: &Flown| {
        let cell = |metric| {
            let Interval { mean, half } = flown.interval(metric);
            SheetCell::Interval(mean, half)
        };
        let cells = (0..METRICS).map(cell).collect();
        SheetRow::new(Variant::Ours, flown.law.controller, "all runs", cells)
    };
    let rows = nominal.tuned().map(row).collect();
    text::table_of("V-intervals", COLUMNS[..METRICS].to_vec(), rows)
}

/// Pairwise comparison of the paper's laws, seed by seed.
pub fn ranking(nominal: &FlownLaws) -> Sheet {
    const PAIRS: [[&str; 2]; 3] = [["pid", "lqr"], ["pid", "oqtal"], ["lqr", "oqtal"]];
    let find = |name: &str| nominal.tuned().find(|flown| flown.law.controller == name);
    let (mut rows, mut orders) = (Vec::new(), Vec::new());
    for [a, b] in PAIRS {
        let Some((one, other)) = find(a).zip(find(b)) else { continue };
        let differences = std::array::from_fn(|metric| difference(one, other, metric));
        let order = PairRanking::of([a, b], &differences);
        let cells =
            differences.iter().map(|percent| SheetCell::Interval(percent.mean, percent.half));
        let counts = [order.better, order.worse].map(|count| SheetCell::Count(count as u64));
        rows.push(SheetRow::new(
            Variant::Ours,
            a,
            format!("against {b}"),
            cells.chain(counts).collect(),
        ));
        orders.push(order);
    }
    let mut columns = COLUMNS[..METRICS].to_vec();
    columns.extend([("better", "better by"), ("worse", "worse by")]);
    let order: Vec<String> = orders.iter().map(PairRanking::text).collect();
    let ranked = orders.iter().any(PairRanking::is_a_ranking);
    let values = TextValues::from([
        ("order", order.join("; ").into()),
        ("ranked", f64::from(u8::from(ranked)).into()),
    ]);
    text::with_notes(text::table_of("V-ranking", columns, rows), &values)
}

/// Number of metrics in which the first of two laws is better, or worse, beyond the interval.
struct PairRanking {
    laws: [&'static str; 2],
    better: usize,
    worse: usize,
}

impl PairRanking {
    fn of(laws: [&'static str; 2], differences: &[Interval; METRICS]) -> Self {
        let better = differences.iter().filter(|percent| percent.high() < 0.0).count();
        let worse = differences.iter().filter(|percent| percent.low() > 0.0).count();
        Self { laws, better, worse }
    }

    /// Whether one law is better in at least one metric and worse in none.
    fn is_a_ranking(&self) -> bool {
        (self.better == 0) != (self.worse == 0)
    }

    fn text(&self) -> String {
        let Self { laws: [a, b], better, worse } = self;
        match (better, worse) {
            (0, 0) => format!("{a} and {b} do not differ by any figure"),
            (_, 0) => format!("{a} ranks before {b}, better by {better} and worse by none"),
            (0, _) => format!("{b} ranks before {a}, better by {worse} and worse by none"),
            _ => format!("{a} is better than {b} by {better} and worse by {worse}"),
        }
    }
}

/// Difference of `one` and `other`, seed by seed, in per cent of the mean of `other`.
fn difference(one: &Flown, other: &Flown, metric: usize) -> Interval {
    let (a, b) = (one.values(metric), other.values(metric));
    let mean = mean(&b);
    let percent: Vec<f64> = a.iter().zip(&b).map(|(a, b)| 100.0 * (a - b) / mean).collect();
    Interval::of(&percent)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn interval(mean: f64) -> Interval {
        Interval { mean, half: 1.0 }
    }

    #[test]
    fn a_law_is_ranked_only_if_it_is_worse_by_nothing() {
        let of = |first: f64, second: f64| {
            let mut differences = [interval(0.0); METRICS];
            (differences[0], differences[1]) = (interval(first), interval(second));
            PairRanking::of(["a", "b"], &differences)
        };
        assert!(of(-2.0, 0.5).is_a_ranking() && of(0.5, 2.0).is_a_ranking());
        assert!(!of(-2.0, 2.0).is_a_ranking() && !of(0.5, -0.5).is_a_ranking());
        assert!(of(-2.0, 2.0).text().contains("a is better than b by 1 and worse by 1"));
        assert!(of(-2.0, 0.0).text().contains("a ranks before b"));
    }

    #[test]
    fn a_goal_is_met_by_the_whole_interval() {
        let pair = |ours, rival| LawComparison {
            metric: HOVER,
            ours: Interval { mean: ours, half: 0.1 },
            rival: ("pid", Interval { mean: rival, half: 0.1 }),
        };
        assert!(
            pair(2.3, 5.0).meets(Goal::AtMost(2.5)) && !pair(2.45, 5.0).meets(Goal::AtMost(2.5))
        );
        assert!(pair(2.0, 4.5).meets(Goal::Times(2.0)) && !pair(2.2, 4.5).meets(Goal::Times(2.0)));
    }
}
