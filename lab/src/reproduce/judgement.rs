//! Statistical comparison of the laws of Table V: differences, ratios and their confidence intervals.

use oqtal_control::statistics::Interval;

use crate::campaign::metric::{
    ATTITUDE, CHIRP, DOUBLET, HOVER, METRIC, METRICS, POSITION, SETTLE, VELOCITY,
};
use crate::campaign::table::{COLUMNS, Flown};

use super::words::{about, either, listed};
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

/// The law that is compared with the others.
const OURS: &str = "oqtal-dt";

/// A goal of a metric.
#[derive(Clone, Copy)]
enum Goal {
    /// Upper bound of the metric itself \[unit of the metric\].
    AtMost(f64),
    /// Lower bound of the ratio of the best rival's metric to ours \[-\].
    Times(f64),
}

/// No worse than 8 %: for metrics that the limits on speed and tilt decide.
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
/// The goal on mismatched plants.
const MISMATCHED_GOAL: (usize, Goal) = (CHIRP, Goal::Times(2.0));

/// The flights of all laws on one plant.
#[derive(Clone, Copy)]
pub struct Evidence<'a> {
    /// Description of the plant.
    pub plant: &'a str,
    /// The flights of every law.
    pub flown: &'a [Flown],
}

impl Evidence<'_> {
    fn tuned(&self) -> impl Iterator<Item = &Flown> {
        self.flown.iter().filter(|flown| flown.is_tuned())
    }

    /// The flights of [`OURS`].
    fn ours(&self) -> Option<&Flown> {
        self.tuned().find(|flown| flown.name() == OURS)
    }

    /// The best of the other tuned laws by a metric, with its interval.
    fn rival(&self, metric: usize) -> Option<(&'static str, Interval)> {
        let others = self.tuned().filter(|flown| flown.name() != OURS);
        let figures = others.map(|flown| (flown.name(), flown.interval(metric)));
        figures.min_by(|a, b| a.1.mean.total_cmp(&b.1.mean))
    }
}

/// [`OURS`] and the best rival by one metric.
struct Duel {
    metric: usize,
    ours: Interval,
    rival: (&'static str, Interval),
}

impl Duel {
    fn of(evidence: &Evidence<'_>, metric: usize) -> Option<Self> {
        let (ours, rival) = (evidence.ours()?.interval(metric), evidence.rival(metric)?);
        Some(Self { metric, ours, rival })
    }

    /// Ratio of the rival's metric to ours, with its interval.
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
        let cells = vec![
            plant.into(),
            self.title().into(),
            spread(&self.ours),
            self.rival.0.into(),
            spread(&self.rival.1),
            spread(&self.times()),
            either(self.is_apart(), "yes", "no").into(),
            goal.map_or("", |goal| match goal {
                Goal::AtMost(_) => "at most",
                Goal::Times(_) => "times, at least",
            })
            .into(),
            goal.map(|goal| match goal {
                Goal::AtMost(number) | Goal::Times(number) => number,
            })
            .into(),
            goal.map(|goal| either(self.meets(goal), "yes", "no")).into(),
        ];
        SheetRow::new(Variant::Ours, OURS, "against the best of the other tuned laws", cells)
    }
}

const DUEL: [Column; 10] = [
    ("plant", "plant"),
    ("metric", "figure"),
    ("ours", "oqtal-dt"),
    ("rival", "best rival"),
    ("rival_figure", "its figure"),
    ("times_better", "times better"),
    ("intervals_apart", "intervals apart"),
    ("goal_kind", "goal"),
    ("goal", ""),
    ("met", "met"),
];

/// The table of `oqtal-dt` against the best rival: every metric on the nominal plant, the chirp on the mismatched ones.
#[must_use]
pub fn duels(nominal: &Evidence<'_>, mismatched: &[Evidence<'_>]) -> Sheet {
    let goals = |metric| GOALS.iter().filter(move |(of, _)| *of == metric).map(|(_, goal)| *goal);
    let mut rows = Vec::new();
    let mut missed = Vec::new();
    for metric in 0..METRICS {
        let Some(duel) = Duel::of(nominal, metric) else { continue };
        missed.extend(goals(metric).filter(|goal| !duel.meets(*goal)).map(|_| duel.title()));
        let goals: Vec<Option<Goal>> = goals(metric).map(Some).collect();
        let shown = if goals.is_empty() { vec![None] } else { goals };
        rows.extend(shown.into_iter().map(|goal| duel.row(nominal.plant, goal)));
    }
    for evidence in mismatched {
        let (metric, goal) = MISMATCHED_GOAL;
        let Some(duel) = Duel::of(evidence, metric) else { continue };
        missed.extend((!duel.meets(goal)).then_some(evidence.plant));
        rows.push(duel.row(evidence.plant, Some(goal)));
    }
    let goals = format!("Goals not met by the whole interval: {}.", listed(&missed));
    Sheet {
        name: "V-verdict".to_owned(),
        title: "oqtal-dt against the best of the other tuned laws".to_owned(),
        notes: vec![INTERVALS.to_owned(), told_apart(nominal), goals, stability(mismatched)],
        columns: DUEL.to_vec(),
        rows,
        ..Sheet::default()
    }
}

/// The metrics by which [`OURS`] is better or worse, with the ratios, as text.
fn told_apart(nominal: &Evidence<'_>) -> String {
    let (mut better, mut open, mut worse) = (Vec::new(), Vec::new(), Vec::new());
    for duel in (0..METRICS).filter_map(|metric| Duel::of(nominal, metric)) {
        let list = match (duel.is_apart(), duel.ours.mean < duel.rival.1.mean) {
            (true, true) => &mut better,
            (true, false) => &mut worse,
            (false, _) => &mut open,
        };
        list.push(format!("{} ({})", duel.title(), about(duel.times().mean)));
    }
    format!(
        "oqtal-dt on the nominal plant, in brackets how many times better it is. Better, intervals apart: {}. Worse, intervals \
         apart: {}. Not told apart: {}.",
        listed(&better),
        listed(&worse),
        listed(&open)
    )
}

const INTERVALS: &str = "Behind ± is half of a 95 % confidence interval of the mean: Student's t times the standard error over all \
     runs, one for each seed, the same seeds for every law. That of a ratio has the relative widths of both, added as squares. \
     Two laws are told apart where their intervals have nothing in common. The intervals cover noise, drift and gusts, not \
     where the search for gains happened to end.";

fn stability(mismatched: &[Evidence<'_>]) -> String {
    let unstable: Vec<&str> = mismatched
        .iter()
        .filter(|evidence| {
            let landed = |flown: &Flown| flown.runs.figures.iter().flatten().all(|f| f.is_finite());
            !evidence.ours().is_some_and(landed)
        })
        .map(|evidence| evidence.plant)
        .collect();
    let plants = mismatched.len();
    match unstable.as_slice() {
        [] => format!("On all {plants} mismatched plants every flight of oqtal-dt landed."),
        some => format!("Not every flight of oqtal-dt landed on: {}.", listed(some)),
    }
}

/// The mean of every metric with its interval, for each tuned law.
#[must_use]
pub fn intervals(nominal: &Evidence<'_>) -> Sheet {
    let row = |flown: &Flown| {
        let cell = |metric| {
            let Interval { mean, half } = flown.interval(metric);
            SheetCell::Interval(mean, half)
        };
        let cells = (0..METRICS).map(cell).collect();
        SheetRow::new(Variant::Ours, flown.name(), "all runs", cells)
    };
    Sheet {
        name: "V-intervals".to_owned(),
        title: "The tuned laws, all runs, with 95 % confidence intervals".to_owned(),
        columns: COLUMNS[..METRICS].to_vec(),
        rows: nominal.tuned().map(row).collect(),
        ..Sheet::default()
    }
}

/// The paper's laws against each other, seed by seed.
#[must_use]
pub fn ranking(nominal: &Evidence<'_>) -> Sheet {
    const PAIRS: [[&str; 2]; 3] = [["pid", "lqr"], ["pid", "oqtal"], ["lqr", "oqtal"]];
    let find = |name: &str| nominal.tuned().find(|flown| flown.name() == name);
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
    Sheet {
        name: "V-ranking".to_owned(),
        title: "pid, lqr and oqtal against each other: difference in %".to_owned(),
        notes: vec![PAIRED.to_owned(), is_there_a_ranking(&orders)],
        columns,
        rows,
        ..Sheet::default()
    }
}

/// Number of metrics by which the first of two laws is better or worse beyond the interval.
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

    /// Whether one law is better by some metric and worse by none.
    fn is_a_ranking(&self) -> bool {
        (self.better == 0) != (self.worse == 0)
    }

    fn said(&self) -> String {
        let Self { laws: [a, b], better, worse } = self;
        match (better, worse) {
            (0, 0) => format!("{a} and {b} are not told apart by anything"),
            (_, 0) => format!("{a} ranks before {b}, better by {better} and worse by none"),
            (0, _) => format!("{b} ranks before {a}, better by {worse} and worse by none"),
            _ => format!("{a} is better than {b} by {better} and worse by {worse}"),
        }
    }
}

fn is_there_a_ranking(orders: &[PairRanking]) -> String {
    let said: Vec<String> = orders.iter().map(PairRanking::said).collect();
    let ranked = orders.iter().any(PairRanking::is_a_ranking);
    format!(
        "Is there an honest ranking among the paper's laws? One law is ranked before another if it is better by some of the \
         {METRICS} figures and worse by none. {}. {}",
        said.join("; "),
        either(
            ranked,
            "So where one is ranked before another, it is for the gains at which this search ended.",
            "So there is none: what a law gains by one figure it gives back by another."
        )
    )
}

const PAIRED: &str = "Differences of runs with the same seed, in % of the second law's mean; negative is better. Behind ± again half \
     of a 95 % interval. At small angles pid, lqr and oqtal are one law with two gains; lqr and oqtal differ by nothing but \
     where the search ended, so a difference of that size between others says nothing either.";

/// Difference of `one` and `other`, seed by seed, in per cent of the other's mean.
fn difference(one: &Flown, other: &Flown, metric: usize) -> Interval {
    let (a, b) = (one.runs.values(metric), other.runs.values(metric));
    let mean = b.iter().sum::<f64>() / b.len() as f64;
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
        assert!(is_there_a_ranking(&[of(-2.0, 2.0)]).contains("So there is none"));
        assert!(is_there_a_ranking(&[of(-2.0, 0.0)]).contains("a ranks before b"));
    }

    #[test]
    fn a_goal_is_met_by_the_whole_interval() {
        let duel = |ours, rival| Duel {
            metric: HOVER,
            ours: Interval { mean: ours, half: 0.1 },
            rival: ("pid", Interval { mean: rival, half: 0.1 }),
        };
        assert!(
            duel(2.3, 5.0).meets(Goal::AtMost(2.5)) && !duel(2.45, 5.0).meets(Goal::AtMost(2.5))
        );
        assert!(duel(2.0, 4.5).meets(Goal::Times(2.0)) && !duel(2.2, 4.5).meets(Goal::Times(2.0)));
    }
}
