//! The tables of the Monte-Carlo study.

use std::collections::BTreeSet;

use oqtal_control::statistics::{mean, rank_correlation};
use toml::Value;

use super::against;
use super::draws::Draw;
use super::spread::{PlantSpread, SpreadKey};
use crate::sheet::{Sheet, SheetCell, Variant};
use crate::study::failure::{self, Changes, FailedFlights};
use crate::study::flights::{Test, TestEnd};
use crate::study::metric::{ATTITUDE, CHIRP, DOUBLET, HOVER, JITTER, METRIC, SETTLE};
use crate::study::table::{StudyColumn, column, not_flown};
use crate::study::{Flown, Run};

/// Note of the headline with one law besides `oqtal-dt`, with one that has several sets of gains, and with several laws.
const ONE_RIVAL: &str = "The other law flies with an estimator and a position loop of its own.";
const SEVERAL_GAINS: &str = "The other law flies with an estimator and a position loop of its own. Each figure in its row is that of the \
     set of gains that is best in this figure; no set has all of them.";
const SEVERAL_RIVALS: &str = "The other laws fly with an estimator and a position loop of their own. Each figure of their row is that of the \
     best law in it.";

/// Number of keys per law in the table of dependences \[-\].
const STRONGEST: usize = 4;
/// Least number of draws for a rank correlation \[-\]: over fewer it is often near 1 by chance.
const LEAST_DRAWS: usize = 9;
/// Name of the table of failures.
pub const FAILURES: &str = "failures";
/// Number of draws with a failed flight shown per law \[-\].
const MOST_FAILURES: usize = 5;

/// Figures of the laws over the draws, and the draws in which a law did not land as planned.
pub fn all(flown: &[Flown], draws: &[Draw]) -> Vec<Sheet> {
    let against = Some(against::table(flown)).filter(|sheet| !sheet.rows.is_empty());
    let details =
        [as_planned(flown), failures(flown, draws), distributions(flown), broken(flown, draws)];
    let headline = Some(headline(flown)).filter(|sheet| sheet.rows.len() > 1);
    headline.into_iter().chain([summary(flown)]).chain(against).chain(details).collect()
}

/// The figures by which the README compares: those of each row of `oqtal-dt`, and in each column the best of the laws with an
/// estimator and a position loop of their own. Without rows if no such law was flown.
fn headline(flown: &[Flown]) -> Sheet {
    type Row<'a> = (String, Vec<&'a Flown>);
    let best = |figure: fn(&Flown) -> f64| {
        move |(_, laws): &Row<'_>| laws.iter().map(|law| figure(law)).fold(f64::NAN, f64::min)
    };
    let columns = [
        column("hover_p95_mm", "hover, 95 % point [mm]", best(|law| law.quantile(HOVER, 0.95))),
        column("chirp_median_deg", "chirp, median [°]", best(|law| law.median(CHIRP))),
        column("jitter_median_rad_s", "jitter, median [rad/s]", best(|law| law.median(JITTER))),
    ];
    let is_ours = |law: &&Flown| law.law.controller == against::OURS;
    let own = flown.iter().filter(is_ours).map(|law| (law.law.name.clone(), vec![law]));
    let others: Vec<&Flown> =
        flown.iter().filter(|law| !is_ours(law) && !law.law.is_predictive()).collect();
    let names: BTreeSet<&str> = others.iter().map(|law| law.law.controller).collect();
    let (best, note) = match (names.len(), others.len()) {
        (1, 1) => ("the other law".to_owned(), ONE_RIVAL),
        (1, gains) => (format!("best of {gains} sets of gains of the other law"), SEVERAL_GAINS),
        (count, _) => (format!("best of {count} other laws"), SEVERAL_RIVALS),
    };
    let best = (best, others);
    let rows: Vec<Row<'_>> = match best.1.is_empty() {
        true => Vec::new(),
        false => own.chain([best]).collect(),
    };
    let names = |(name, _): &Row<'_>| (name.clone(), Variant::Ours, String::new());
    Sheet::tabulate(
        ("headline", "oqtal-dt and the best of the other laws in each column"),
        &columns,
        &rows,
        names,
    )
    .with_note(note)
    .without(&not_flown(flown, &columns))
}

/// Failed flights of the draws.
fn failures(flown: &[Flown], draws: &[Draw]) -> Sheet {
    let columns = [
        column("cause", "cause", |group: &FailedFlights<'_>| group.cause),
        column("flights", "flights", |group: &FailedFlights<'_>| group.conditions.len() as u64),
        column("draws", "draws", |group: &FailedFlights<'_>| {
            let seeds = group.conditions.iter().map(|condition| condition.seed);
            let runs: Vec<String> = seeds
                .filter_map(|seed| draws.iter().find(|draw| draw.seed == seed))
                .map(|draw| draw.run.to_string())
                .collect();
            SheetCell::Text(runs.join(" "))
        }),
    ];
    failed((FAILURES, ""), &columns, flown)
}

/// Flights that did not land as planned, or with a step that did not settle, by law, test and cause, with the remedies; `name` is the
/// name of the table and the beginning of its title.
pub fn failed<'a>(
    (name, of): (&str, &str),
    columns: &[StudyColumn<'_, FailedFlights<'a>>],
    flown: &'a [Flown],
) -> Sheet {
    let groups = failure::failed(flown);
    let names = |group: &FailedFlights<'_>| {
        (group.law.name.clone(), Variant::Ours, group.test.name().to_owned())
    };
    let title = "Flights that did not land as planned, or with a step that did not settle";
    let title = format!("{of}{title}");
    let sheet = Sheet::tabulate((name, &title), columns, &groups, names).as_detail();
    let remedies = failure::remedies(&groups, Changes::All);
    remedies.trim().lines().fold(sheet, |sheet, remedy| sheet.with_note(remedy.trim()))
}

/// One row for each law.
fn summary(flown: &[Flown]) -> Sheet {
    let median = |metric: usize| move |law: &Flown| law.median(metric);
    let p95 = |metric: usize| move |law: &Flown| law.quantile_interval(metric, 0.95);
    let columns = [
        column("as_planned_percent", "all as planned [%]", |law: &Flown| {
            law.percent(Run::all_as_planned)
        }),
        column("hover_median_mm", "hover, median [mm]", median(HOVER)),
        column("hover_p95_mm", "hover, 95 % point [mm]", p95(HOVER)),
        column("hover_worst_mm", "hover, worst [mm]", |law: &Flown| law.quantile(HOVER, 1.0)),
        column("chirp_median_deg", "chirp, median [°]", median(CHIRP)),
        column("chirp_p95_deg", "chirp, 95 % point [°]", p95(CHIRP)),
        column("doublet_median_s", "doublet settled, median [s]", median(DOUBLET)),
        column("settle_median_s", "path settled, median [s]", median(SETTLE)),
        column("attitude_median_deg", "attitude on the path, median [°]", median(ATTITUDE)),
        column("jitter_median_rad_s", "jitter, median [rad/s]", median(JITTER)),
    ];
    Sheet::tabulate(("summary", "The laws over the draws"), &columns, flown, Flown::names)
        .with_note(SUMMARY_NOTE)
        .without(&not_flown(flown, &columns))
}

const SUMMARY_NOTE: &str = "A flight that did not land as planned, for example because the fence held it for a time, counts as \
     worse than any that did; a value is missing where the median or quantile is such a flight. The 95 % point is the least value that 95 % of the draws do \
     not exceed. Beside each 95 % point is its 95 % confidence interval, by the bootstrap over the draws. Jitter is the activity of the command.";

fn as_planned(flown: &[Flown]) -> Sheet {
    let one = |test: Test| move |law: &Flown| law.percent(|run| run.is_as_planned(test));
    let columns = [
        column("all", "all [%]", |law: &Flown| law.percent(Run::all_as_planned)),
        column("path", "path [%]", one(Test::Path)),
        column("hover", "hover [%]", one(Test::Hover)),
        column("chirp", "chirp [%]", one(Test::Chirp)),
        column("doublet", "doublet [%]", one(Test::Doublet)),
        column("landed", "all landed, held by the fence or not [%]", |law: &Flown| {
            law.percent(Run::all_landed)
        }),
    ];
    let title = "Share of the draws in which the flights landed as planned";
    Sheet::tabulate(("as_planned", title), &columns, flown, Flown::names)
        .as_detail()
        .without(&not_flown(flown, &columns))
}

fn distributions(flown: &[Flown]) -> Sheet {
    type Row = (usize, usize);
    let quantile = |share: f64| move |(metric, law): &Row| flown[*law].quantile(*metric, share);
    let columns = [
        column("median", "median", |(metric, law): &Row| flown[*law].median(*metric)),
        column("p95", "95 % point", quantile(0.95)),
        column("worst", "worst", quantile(1.0)),
        column("worst_draw", "in draw", |(metric, law): &Row| {
            let worst = flown[*law].quantile(*metric, 1.0);
            // The first of equal values.
            flown[*law].values(*metric).iter().position(|value| *value == worst).map(|k| k as u64)
        }),
        column(
            "worse_than_best_other_percent",
            "worse than the best other row, the same law with other gains included [% of draws]",
            |(metric, law): &Row| 1e2 * worse_than_the_best_other(flown, *law, *metric),
        ),
    ];
    let is_flown = |test: &Test| flown.iter().any(|law| law.has_flown(*test));
    let metrics = Test::ALL.into_iter().filter(is_flown).flat_map(Test::figures);
    let rows: Vec<Row> =
        metrics.flat_map(|metric| (0..flown.len()).map(move |law| (metric, law))).collect();
    let names = |(metric, law): &Row| flown[*law].names_with(METRIC[*metric].title);
    Sheet::tabulate(("distributions", "Figures over the draws"), &columns, &rows, names)
        .with_note(DISTRIBUTIONS_NOTE)
        .as_detail()
}

const DISTRIBUTIONS_NOTE: &str = "A flight that did not land as planned counts as worse than any that did; a value is missing where the \
     quantile is such a flight. Jitter is the activity of the command, not a figure of merit by itself.";

/// Fraction of draws in which `law` has a worse figure than the best other law \[0..1\]; NaN without another law.
fn worse_than_the_best_other(flown: &[Flown], law: usize, metric: usize) -> f64 {
    let others: Vec<&Flown> =
        flown.iter().enumerate().filter(|(index, _)| *index != law).map(|(_, law)| law).collect();
    let own = flown[law].values(metric);
    if others.is_empty() || own.is_empty() {
        return f64::NAN;
    }
    let is_worse =
        |(draw, figure): &(usize, &f64)| **figure > against::best(&others, (*draw, metric));
    own.iter().enumerate().filter(is_worse).count() as f64 / own.len() as f64
}

/// Draws of each law in which a flight did not land as planned, and the draw with the worst hover.
fn broken(flown: &[Flown], draws: &[Draw]) -> Sheet {
    type Row<'a> = (&'a Flown, usize);
    let columns = [
        column("hover_rms_mm", "hover RMS [mm]", |(law, draw): &Row<'_>| {
            law.runs[*draw].figures[HOVER]
        }),
        column("failed", "not as planned", |(law, draw): &Row<'_>| not_landed(&law.runs[*draw])),
        column("again", "again", |(law, draw): &Row<'_>| {
            let failed = law.runs[*draw].ends.iter().find(|end| end.cause.is_some());
            let test = failed.map_or(Test::Hover, |end| end.test);
            SheetCell::Text(failure::again(&law.law, &law.conditions[*draw], test))
        }),
    ];
    let rows = flown.iter().flat_map(|law| shown_draws(law).into_iter().map(move |k| (law, k)));
    let rows: Vec<Row<'_>> = rows.collect();
    let names = |(law, k): &Row<'_>| law.names_with(format!("draw {}", draws[*k].run));
    Sheet::tabulate(
        ("broken", "Draws in which a flight failed, and the worst hover of each law"),
        &columns,
        &rows,
        names,
    )
    .with_note(BROKEN_NOTE)
    .as_detail()
}

/// The first draws in which a flight of `law` did not land as planned, and the draw with the greatest hover error.
fn shown_draws(law: &Flown) -> Vec<usize> {
    let failed = (0..law.runs.len()).filter(|draw| !law.runs[*draw].all_as_planned());
    let mut shown: Vec<usize> = failed.take(MOST_FAILURES).collect();
    let hover = law.values(HOVER);
    let landed = (0..hover.len()).filter(|draw| hover[*draw].is_finite());
    let worst = landed.max_by(|a, b| hover[*a].total_cmp(&hover[*b]));
    shown.extend(worst.filter(|worst| !shown.contains(worst)));
    shown
}

/// Tests of a run that did not land as planned.
fn not_landed(run: &Run) -> SheetCell {
    let cause = |end: &TestEnd| Some(format!("{}: {}", end.test.name(), end.cause.as_ref()?));
    let failed: Vec<String> = run.ends.iter().filter_map(cause).collect();
    if failed.is_empty() { SheetCell::None } else { SheetCell::Text(failed.join(", ")) }
}

const BROKEN_NOTE: &str = "Of each law the first draws in which a flight did not land as planned, and the one with the greatest \
     error in hover, each with the command that flies it again. On the chirp the position loop is open and the vehicle drifts: one \
     that does not come back within 3 s of the sweep's end, or that the fence held for 10 s, is landed by the daemon, although its \
     attitude was held.";

/// Keys with the strongest rank correlation with the hover error, for each law.
pub fn dependences(flown: &[Flown], draws: &[Draw], spread: &PlantSpread) -> Sheet {
    type Row<'a> = (&'a Flown, String, f64);
    let strongest = |law| {
        let of_key = |SpreadKey { key, .. }: &SpreadKey| {
            (law, key.clone(), dependence(&Flown::values(law, HOVER), draws, key))
        };
        let mut keys: Vec<Row<'_>> =
            spread.keys.iter().map(of_key).filter(|(.., share)| share.is_finite()).collect();
        keys.sort_by(|a, b| b.2.abs().total_cmp(&a.2.abs()));
        keys.truncate(STRONGEST);
        keys
    };
    let rows: Vec<Row<'_>> = flown.iter().flat_map(strongest).collect();
    let title = "rank correlation with the hover's error";
    let columns = [column("rank_correlation", title, |(.., share): &Row<'_>| *share)];
    let names = |(law, key, _): &Row<'_>| law.names_with(key.as_str());
    let title = "Keys on which the error in hover depends";
    let note = match draws.len() < LEAST_DRAWS {
        true => format!("Not evaluated: it takes at least {LEAST_DRAWS} draws, as with `--runs {LEAST_DRAWS}`."),
        false => "Spearman's rank correlation over all draws: 1 where the error always rises with the key.".to_owned(),
    };
    Sheet::tabulate(("dependences", title), &columns, &rows, names).with_note(note).as_detail()
}

/// Spearman's rank correlation of a figure with a drawn key \[-1..1\]; NaN if either is constant over all draws, or if there
/// are too few draws.
fn dependence(values: &[f64], draws: &[Draw], key: &str) -> f64 {
    let drawn: Vec<f64> = draws.iter().filter_map(|draw| draw.value(key)).map(mean_of).collect();
    let is_enough = drawn.len() == values.len() && drawn.len() >= LEAST_DRAWS;
    if is_enough { rank_correlation(values, &drawn) } else { f64::NAN }
}

/// Drawn value as one number: the mean of a list, 0 or 1 for a truth value, the length of a word.
fn mean_of(value: &Value) -> f64 {
    match value {
        Value::Array(values) => mean(&values.iter().map(mean_of).collect::<Vec<_>>()),
        Value::Boolean(truth) => f64::from(u8::from(*truth)),
        Value::String(word) => word.len() as f64,
        other => other.as_float().or(other.as_integer().map(|n| n as f64)).unwrap_or(f64::NAN),
    }
}

/// Table of the spread itself.
pub fn spread(spread: &PlantSpread) -> Sheet {
    let columns = [column("drawn", "drawn", |it: &SpreadKey| SheetCell::Text(it.form.words()))];
    let names = |it: &SpreadKey| ("all".to_owned(), Variant::Ours, it.key.clone());
    let sheet = Sheet::tabulate(("spread", "The spread"), &columns, &spread.keys, names);
    SPREAD_NOTES.into_iter().fold(sheet, Sheet::with_note)
}

const SPREAD_NOTES: [&str; 2] = [
    "Evenly between the bounds, each key independently.",
    "A spread of your own is a TOML file with one of these forms for each key of the configuration: `between = [LOW, HIGH]`, a \
     number; `factor = [LOW, HIGH]`, the configured value times a number; `each-factor`, each element of a list times its own \
     number; `one-factor`, a randomly chosen element times a number; `choose = [VALUES]`, one of them. Example: `mass-kg = { \
     factor = [0.9, 1.1] }` in `[plant]`.",
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::tests::flown;
    use oqtal_config::Setting;

    #[test]
    fn laws_are_compared_draw_by_draw_with_the_best_of_the_others() {
        let laws = [
            flown("pid", &[1.0, 5.0, f64::INFINITY]),
            flown("lqr", &[2.0, 4.0, 9.0]),
            flown("oqtal", &[3.0, 3.0, 1.0]),
        ];
        assert_eq!(worse_than_the_best_other(&laws, 0, HOVER), 2.0 / 3.0);
        assert_eq!(worse_than_the_best_other(&laws, 2, HOVER), 1.0 / 3.0);
        assert!(worse_than_the_best_other(&laws[..1], 0, HOVER).is_nan());
    }

    #[test]
    fn one_law_with_several_sets_of_gains_has_no_headline() {
        let draws = [Draw { run: 0, seed: 0, settings: Vec::new() }];
        let both = [flown("oqtal-dt", &[1.0]), flown("oqtal-dt", &[2.0])];
        let names =
            |flown: &[Flown]| all(flown, &draws).into_iter().map(|it| it.name).collect::<Vec<_>>();
        assert!(!names(&both).contains(&"headline".to_owned()));
        let with_rival = [&both[..], &[flown("pid", &[3.0])]].concat();
        assert!(names(&with_rival).contains(&"headline".to_owned()));
    }

    #[test]
    fn the_worst_draw_is_the_first_of_the_worst() {
        let laws = [flown("pid", &[1.0, f64::INFINITY, f64::INFINITY])];
        let sheet = distributions(&laws);
        assert_eq!(sheet.rows[0].number(&sheet.columns, "worst_draw"), 1.0);
        assert_eq!(shown_draws(&laws[0]), [1, 2, 0]);
    }

    #[test]
    fn a_draw_that_failed_is_flown_again_with_the_settings_of_the_study_itself() {
        let mut law = flown("pid", &[1.0, f64::INFINITY]);
        let of_file = |key: &str, value: f64| Setting {
            origin: "my.toml:3".to_owned(),
            ..Setting::flag("", key, value)
        };
        law.law.settings =
            vec![of_file("vehicle.mass-kg", 1.3), Setting::flag("--set", "mocap.latency-ms", 12.0)];
        let draw =
            Draw { run: 1, seed: 1, settings: vec![Setting::flag("spread", "plant.mass-kg", 1.2)] };
        law.conditions = Draw::case("", &[draw.clone(), draw.clone()]).conditions.into();
        let sheet = broken(&[law.clone()], &[draw.clone(), draw.clone()]);
        let again = |row: usize| sheet.rows[row].cells[2].show();
        let settings = "--config my.toml --set mocap.latency-ms=12.0 --set plant.mass-kg=1.2";
        let flown = "oqtal fly --clock in-process --controller pid --seed 1";
        assert_eq!(again(0), format!("{flown} {settings}"), "the failed path");
        assert_eq!(again(1), format!("{flown} {settings} --trajectory hover"), "the worst hover");
        assert_eq!(draw.arguments(&law.law.settings), settings);
    }

    #[test]
    fn a_flight_that_the_fence_held_has_landed_and_not_as_planned() {
        let mut law = flown("pid", &[1.0, 1.0]);
        law.runs[0].ends[1].cause = Some(oqtal_observe::flight::HELD.to_owned());
        let sheet = as_planned(&[law]);
        let share = |key: &str| sheet.rows[0].number(&sheet.columns, key);
        assert_eq!(["all", "hover", "path", "landed"].map(share), [50.0, 50.0, 100.0, 100.0]);
    }

    #[test]
    fn a_figure_depends_on_the_key_that_it_rises_with() {
        let draw = |run: u64, lag: f64| Draw {
            run,
            seed: run,
            settings: vec![Setting::flag("", "plant.rate-lag-ms", lag)],
        };
        let draws: Vec<Draw> = (0..9).map(|run| draw(run, (run * run) as f64)).collect();
        let rising: Vec<f64> = (0..9).map(|run| f64::from(run).exp()).collect();
        let falling: Vec<f64> = rising.iter().map(|value| -value).collect();
        assert!((dependence(&rising, &draws, "plant.rate-lag-ms") - 1.0).abs() < 1e-12);
        assert!((dependence(&falling, &draws, "plant.rate-lag-ms") + 1.0).abs() < 1e-12);
        assert!(dependence(&rising, &draws, "plant.mass-kg").is_nan());
    }
}
