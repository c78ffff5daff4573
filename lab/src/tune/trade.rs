//! Figures that a search traded: each component of the objective, and the margins in hover, before and after.

use oqtal_observe::plot::unit::rounded;

use crate::robustness::frequency::Margins;
use crate::robustness::margins::in_hover;
use crate::sheet::{Sheet, SheetCell, Variant};
use crate::study::Flown;
use crate::study::args::say_notes;
use crate::study::law::StudyLaw;
use crate::study::metric::{Figures, JITTER, METRIC};
use crate::study::table::column;

/// Default number of points of a search \[-\].
pub const DEFAULT_POINTS: usize = 300;

/// Relative change for the worse above which a component is warned of \[-\].
const WORSE: f64 = 0.05;

/// Upper bound of a figure over the reference, also for a flight that did not land \[-\].
pub(super) const WORST_SHARE: f64 = 20.0;

/// Weights of the metrics in the objective \[-\].
pub type MetricWeights = Figures;

/// The weights used unless others are given.
pub fn default_weights() -> MetricWeights {
    METRIC.map(|metric| metric.weight)
}

/// A figure before and after a search.
#[derive(Clone, Debug, PartialEq)]
pub struct TradedFigure {
    /// Name in `--weights`.
    pub key: &'static str,
    /// Name with unit.
    pub title: &'static str,
    /// Weight in the objective \[-\]; `None` for a margin, which is not part of it.
    pub weight: Option<f64>,
    /// Values at the configured gains and at the gains found \[unit of the title\]; an error is infinite if a flight did not land, a
    /// margin if nothing limits it.
    pub values: [f64; 2],
    /// Whether each value contains the time until the next step for a step that did not settle.
    pub is_least: [bool; 2],
}

impl TradedFigure {
    /// Relative change \[-\]; `None` without two values that can be compared.
    fn change(&self) -> Option<f64> {
        let [before, after] = self.values;
        let change = after / before - 1.0;
        (before.is_finite() && change.is_finite()).then_some(change)
    }

    /// Whether the figure got worse by more than 5 %: a greater error, or a smaller margin.
    fn is_worse(&self) -> bool {
        let [before, after] = self.values;
        match self.weight {
            Some(_) => after > before * (1.0 + WORSE),
            None => after < before * (1.0 - WORSE) || (after.is_nan() && !before.is_nan()),
        }
    }

    /// A value as text; `is_after` for the one at the gains found.
    fn shown(&self, is_after: usize) -> String {
        let least = if self.is_least[is_after] { "≥ " } else { "" };
        match (self.values[is_after], self.weight) {
            (value, _) if value.is_finite() => format!("{least}{}", rounded(value, 4)),
            (_, Some(_)) => "not as planned".to_owned(),
            (value, None) if value.is_nan() => "unstable".to_owned(),
            (_, None) => "no limit".to_owned(),
        }
    }
}

/// The components of the objective, those without a meaning left out. `flown` and `figures` are those at the configured gains and
/// at the gains found.
pub fn components(
    weights: &MetricWeights,
    flown: &[Flown; 2],
    figures: [Figures; 2],
) -> Vec<TradedFigure> {
    let component = |index: usize| TradedFigure {
        key: METRIC[index].key,
        title: METRIC[index].title,
        weight: Some(weights[index]),
        values: figures.map(|figures| figures[index]),
        is_least: flown
            .each_ref()
            .map(|flown| flown.runs.iter().any(|run| run.figures[index] != run.bounded(index))),
    };
    let all = (0..METRIC.len()).map(component);
    all.filter(|component| component.values.iter().all(|value| !value.is_nan())).collect()
}

/// Margins in hover, measured in flight; empty for a vehicle that is not commanded by rates, and, with a note, where the settings do
/// not allow the flights.
pub fn margins(before: &StudyLaw, after: &StudyLaw) -> Vec<TradedFigure> {
    let both = in_hover(before).and_then(|before| Ok(before.zip(in_hover(after)?)));
    let both = both.unwrap_or_else(|failure| {
        say_notes([format!("no margins in hover: {failure}")]);
        None
    });
    let Some((before, after)) = both else { return Vec::new() };
    let margin = |k: usize| {
        let (key, title) = Margins::COLUMNS[k];
        let values = [before[k], after[k]];
        TradedFigure { key, title, weight: None, values, is_least: [false; 2] }
    };
    // The last column is not a margin.
    let all = (0..before.len() - 1).map(margin);
    all.filter(|margin| margin.values.iter().any(|value| !value.is_infinite())).collect()
}

/// Table of the components; `is_of_draws` if they are those of the draws of a spread.
pub fn sheet(components: &[TradedFigure], is_of_draws: bool) -> Sheet {
    let shown = |is_after: usize| move |it: &TradedFigure| SheetCell::Text(it.shown(is_after));
    let columns = [
        column("weight", "weight", |it: &TradedFigure| it.weight),
        column("before", "before", shown(0)),
        column("after", "after", shown(1)),
        column("change", "change", |it: &TradedFigure| {
            it.change().map(|change| SheetCell::Text(format!("{:+.1} %", 1e2 * change)))
        }),
    ];
    let title = match is_of_draws {
        false => {
            "Components of the objective, and margins in hover with the adaptation off".to_owned()
        }
        true => format!(
            "Components of the objective, quadratic means in which a flight that does not land counts as {WORST_SHARE} times the reference, and margins in hover with the adaptation off"
        ),
    };
    let names = |it: &TradedFigure| (it.title.to_owned(), Variant::Ours, String::new());
    Sheet::tabulate(("trade", &title), &columns, components, names)
}

/// Way to gains with more margin, of a law on the predictive stack or on the default one. On the predictive stack, less jitter is
/// reached by a lower bandwidth of the commands, which takes margin away.
pub fn way_to_more_margin(is_predictive: bool) -> String {
    match is_predictive {
        true => "keep the previous gains if their margins are enough".to_owned(),
        false => format!(
            "a greater weight of the jitter, as in --weights {}=W, gives softer gains",
            METRIC[JITTER].key
        ),
    }
}

/// Warnings about components that got worse by more than 5 % in a search with `points`, under a law on the predictive stack or on the
/// default one. A short search may end before a weight has its effect.
pub fn warnings(components: &[TradedFigure], is_predictive: bool, points: usize) -> Vec<String> {
    let longer = match points < DEFAULT_POINTS && !is_predictive {
        true => format!(", in a search of enough points, as with --budget {DEFAULT_POINTS}"),
        false => String::new(),
    };
    let warning = |component: &TradedFigure| {
        let remedy = match component.weight {
            Some(_) => format!("; a greater weight, as in --weights {}=W, keeps it", component.key),
            None => format!("; {}{longer}", way_to_more_margin(is_predictive)),
        };
        let by = match component.change() {
            Some(change) => format!(" by {:.0} %", 1e2 * change.abs()),
            None => format!(": {} before, {} after", component.shown(0), component.shown(1)),
        };
        format!("{} got worse{by}{remedy}", component.title)
    };
    components.iter().filter(|component| component.is_worse()).map(warning).collect()
}

/// Reason why gains with these `components` have too little margin to be applied in flight; `None` unless the disk margin in hover is below
/// `least` \[-\] and below that of the gains before, the loop is unstable, or its margins are unknown.
pub fn too_little_margin(components: &[TradedFigure], least: f64) -> Option<String> {
    let Some(disk) = components.iter().find(|it| it.key == Margins::COLUMNS[Margins::DISK].0)
    else {
        return (least > 0.0).then(|| "the margins in hover could not be measured".to_owned());
    };
    let [before, after] = disk.values;
    let suffices = after >= least || after >= before || before.is_nan() && !after.is_nan();
    (!suffices).then(|| {
        let [before, after] = [0, 1].map(|is_after| disk.shown(is_after));
        format!(
            "the disk margin in hover is {after}, {before} before, and must be at least {least}"
        )
    })
}

/// Parses weights, `KEY=NUMBER,…`, of which those not given keep their defaults.
///
/// # Errors
/// A key is not that of a component, or a weight is negative or not a number.
pub fn parse_weights(texts: &[String]) -> Result<MetricWeights, String> {
    let mut weights = default_weights();
    for text in texts {
        let known = METRIC.map(|metric| metric.key).join(", ");
        let form = || format!("`{text}` is not KEY=WEIGHT; the keys are {known}");
        let (key, weight) = text.split_once('=').ok_or_else(form)?;
        let index = METRIC.iter().position(|metric| metric.key == key.trim()).ok_or_else(form)?;
        let weight = weight.trim().parse().ok().filter(|w: &f64| (0.0..=1e6).contains(w));
        weights[index] =
            weight.ok_or_else(|| format!("`{text}`: a weight is from 0 to 1000000"))?;
    }
    match weights.iter().any(|weight| *weight > 0.0) {
        true => Ok(weights),
        false => Err("all weights are 0; give at least one above 0".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn component(weight: Option<f64>, after: f64) -> TradedFigure {
        let values = [1.0, after];
        TradedFigure { key: "hover_rms_mm", title: "hover", weight, values, is_least: [false; 2] }
    }

    #[test]
    fn only_what_got_worse_by_more_than_5_percent_is_warned_of() {
        let all = [
            component(Some(1.0), 1.04),
            component(Some(1.0), 1.2),
            component(Some(1.0), 0.5),
            component(None, 0.8),
            component(None, 2.0),
        ];
        let said = warnings(&all, false, DEFAULT_POINTS);
        assert_eq!(said.len(), 2, "{said:?}");
        assert!(said[1].contains("--weights jitter_rad_s=W"), "{said:?}");
        assert!(!warnings(&all, true, 60)[1].contains("--weights"));
        let short = warnings(&all, false, 60);
        assert_eq!(short[0], said[0]);
        assert!(short[1].starts_with(&said[1]) && short[1].ends_with("--budget 300"), "{short:?}");
        assert!(said[0].contains("20 %") && said[0].contains("--weights hover_rms_mm=W"));
    }

    #[test]
    fn gains_are_too_close_to_oscillation_below_the_least_disk_margin_unless_they_were_closer_before()
     {
        let refused = |before, after| {
            let disk = TradedFigure {
                key: Margins::COLUMNS[Margins::DISK].0,
                values: [before, after],
                ..component(None, 0.0)
            };
            too_little_margin(&[disk], 0.15).is_some()
        };
        assert_eq!(Margins::COLUMNS[Margins::DISK].0, "disk_margin");
        assert!(refused(0.42, 0.13) && refused(0.42, f64::NAN) && refused(f64::INFINITY, 0.1));
        assert!(!refused(0.42, 0.16) && !refused(0.12, 0.13) && !refused(f64::NAN, 0.1));
        assert!(refused(f64::NAN, f64::NAN));
        let unmeasured = |least| too_little_margin(&[component(None, 0.1)], least);
        assert!(unmeasured(0.15).is_some() && unmeasured(0.0).is_none());
    }

    #[test]
    fn flights_that_do_not_land_and_margins_without_a_limit_are_named_and_not_compared() {
        let traded = |weight, before, after| TradedFigure {
            values: [before, after],
            ..component(weight, 0.0)
        };
        let none = f64::INFINITY;
        let all = [
            traded(Some(1.0), none, 2.0),
            traded(Some(1.0), 2.0, none),
            traded(Some(1.0), none, none),
            traded(None, none, 2.0),
            traded(None, 2.0, none),
            traded(None, 2.0, f64::NAN),
        ];
        let text = sheet(&all, false).to_text();
        assert!(!text.contains('%') && text.contains("not as planned"), "{text}");
        let said = warnings(&all, false, DEFAULT_POINTS);
        assert_eq!(said.len(), 3, "{said:?}");
        assert!(said[2].contains("2.000 before, unstable after"), "{said:?}");
        assert!(said[0].contains("2.000 before, not as planned after"), "{said:?}");
        assert!(said[1].contains("no limit before, 2.000 after"), "{said:?}");
    }

    #[test]
    fn weights_are_named_and_those_not_given_keep_their_defaults() {
        let weights = parse_weights(&["jitter_rad_s=0.5".to_owned()]).unwrap();
        let changed: Vec<usize> =
            (0..METRIC.len()).filter(|k| weights[*k] != METRIC[*k].weight).collect();
        assert_eq!(changed, [crate::study::metric::JITTER]);
        for wrong in ["jitter=1", "jitter_rad_s", "jitter_rad_s=-1", "jitter_rad_s=x"] {
            assert!(parse_weights(&[wrong.to_owned()]).is_err(), "{wrong}");
        }
    }
}
