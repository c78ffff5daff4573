//! Figures that a search traded: each component of the objective, and the margins of the attitude loop, before and after.

use oqtal_config::{Config, Interface};
use serde_json::{Value, json};

use crate::robustness::frequency::Margins;
use crate::robustness::linear::LinearLoop;
use crate::sheet::{Sheet, SheetCell, SheetRow, Variant};
use crate::study::law::StudyLaw;
use crate::study::metric::{Figures, METRIC};

/// Relative change for the worse above which a component is warned of \[-\].
const WORSE: f64 = 0.05;

/// Weights of the metrics in the objective \[-\].
pub type MetricWeights = Figures;

/// The weights used unless others are given.
pub fn default_weights() -> MetricWeights {
    METRIC.map(|metric| metric.weight)
}

/// A figure before and after a search.
#[derive(Clone, Debug, PartialEq)]
pub struct TradedFigure {
    /// Name in JSON.
    pub key: &'static str,
    /// Name with unit.
    pub title: &'static str,
    /// Weight in the objective \[-\]; `None` for a margin, which is not part of it.
    pub weight: Option<f64>,
    /// Value at the configured gains \[unit of the title\].
    pub before: f64,
    /// Value at the gains found \[unit of the title\].
    pub after: f64,
}

impl TradedFigure {
    /// Relative change \[-\]; NaN without a value.
    fn change(&self) -> f64 {
        self.after / self.before - 1.0
    }

    /// Whether the figure got worse by more than 5 %: a greater error, or a smaller margin.
    fn is_worse(&self) -> bool {
        match self.weight {
            Some(_) => self.change() > WORSE,
            None => self.change() < -WORSE,
        }
    }
}

/// The components of the objective, those without a meaning left out.
pub fn components(weights: &MetricWeights, before: &Figures, after: &Figures) -> Vec<TradedFigure> {
    let component = |index: usize| TradedFigure {
        key: METRIC[index].key,
        title: METRIC[index].title,
        weight: Some(weights[index]),
        before: before[index],
        after: after[index],
    };
    let all = (0..METRIC.len()).map(component);
    all.filter(|component| !component.before.is_nan()).collect()
}

/// Least margins over the axes of the linear model; empty for a vehicle that is not commanded by rates.
pub fn margins(before: &StudyLaw, after: &StudyLaw) -> Vec<TradedFigure> {
    let [Some(before), Some(after)] = [before, after].map(|law| least(&law.config().ok()?)) else {
        return Vec::new();
    };
    let component = |k: usize| {
        let (key, title) = Margins::COLUMNS[k];
        TradedFigure { key, title, weight: None, before: before[k], after: after[k] }
    };
    (0..before.len()).map(component).filter(|component| component.before.is_finite()).collect()
}

/// Gain, phase, delay and disk margin, each the least of roll, pitch and yaw.
fn least(config: &Config) -> Option<[f64; 4]> {
    if config.vehicle.interface != Interface::Rate {
        return None;
    }
    let mut least = [f64::INFINITY; 4];
    for axis in 0..3 {
        let margins = LinearLoop::new(config, axis).ok()?.response().margins().numbers();
        least.iter_mut().zip(margins).for_each(|(least, margin)| *least = least.min(margin));
    }
    Some(least)
}

/// Table of the components.
pub fn sheet(components: &[TradedFigure]) -> Sheet {
    let row = |component: &TradedFigure| {
        let weight = component.weight.map_or(SheetCell::None, SheetCell::Number);
        let number = |number: f64| {
            if number.is_finite() { SheetCell::Number(number) } else { SheetCell::None }
        };
        let change = match 1e2 * component.change() {
            percent if percent.is_finite() => SheetCell::Text(format!("{percent:+.1} %")),
            _ => SheetCell::None,
        };
        let cells = vec![weight, number(component.before), number(component.after), change];
        SheetRow::new(Variant::Ours, component.title, "", cells)
    };
    Sheet {
        name: "trade".to_owned(),
        title: "Components of the objective, and margins of the linear model".to_owned(),
        columns: vec![
            ("weight", "weight"),
            ("before", "before"),
            ("after", "after"),
            ("change", "change"),
        ],
        rows: components.iter().map(row).collect(),
        ..Sheet::default()
    }
}

/// Warnings about components that got worse by more than 5 %.
pub fn warnings(components: &[TradedFigure]) -> Vec<String> {
    let warning = |component: &TradedFigure| {
        let remedy = match component.weight {
            Some(_) => format!("; a greater weight, as in --weights {}=W, keeps it", component.key),
            None => String::new(),
        };
        format!("{} got worse by {:.0} %{remedy}", component.title, 1e2 * component.change().abs())
    };
    components.iter().filter(|component| component.is_worse()).map(warning).collect()
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

/// The components as JSON.
pub fn to_json(components: &[TradedFigure]) -> Value {
    let object = |c: &TradedFigure| json!({ "key": c.key, "weight": c.weight, "before": c.before, "after": c.after });
    components.iter().map(object).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn component(weight: Option<f64>, after: f64) -> TradedFigure {
        TradedFigure { key: "hover_rms_mm", title: "hover", weight, before: 1.0, after }
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
        let said = warnings(&all);
        assert_eq!(said.len(), 2, "{said:?}");
        assert!(said[0].contains("20 %") && said[0].contains("--weights hover_rms_mm=W"));
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
