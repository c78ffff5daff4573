//! Figs. 6 to 9: the criteria by which the sweep over the weights compares laws, classic LQR and OQTAL on the same axes.

use std::ops::Range;

use maud::Markup;
use oqtal_control::metrics::TableTwo;

use oqtal_observe::plot::axis::extent;
use oqtal_observe::plot::palette::Ink;

use super::scene::{Edge, Scene};

/// Exponents (base two) of the weights q and r.
pub const EXPONENTS: std::ops::RangeInclusive<i32> = 0..=20;

/// Number of exponents \[-\].
pub const SIDE: usize = 21;

/// A criterion of Table II, in the order of Figs. 6 to 9.
#[derive(Clone, Copy, Debug)]
pub struct Criterion {
    /// Number of the figure in the paper.
    pub figure: u8,
    /// Name, with its unit.
    pub name: &'static str,
    /// Label of its axis.
    pub symbol: &'static str,
    /// Reads the criterion from the metrics of a flight.
    pub value: fn(&TableTwo) -> f64,
}

/// The four criteria.
pub const CRITERIA: [Criterion; 4] = [
    Criterion {
        figure: 6,
        name: "quaternion error ∫|ε| [s]",
        symbol: "∫|ε| [s]",
        value: |m| m.quaternion_error,
    },
    Criterion {
        figure: 7,
        name: "position error ∫|x̃| [m s]",
        symbol: "∫|x̃| [m s]",
        value: |m| m.position_error,
    },
    Criterion {
        figure: 8,
        name: "calculations",
        symbol: "number",
        value: |m| m.riccati_solves as f64,
    },
    Criterion {
        figure: 9,
        name: "effort ∫|τ| [N m s]",
        symbol: "∫|τ| [N m s]",
        value: |m| m.effort,
    },
];

/// Metrics of one law at every pair of weights, index `q * SIDE + r` in exponents; `None` where the law lost control.
pub type Surface = Vec<Option<TableTwo>>;

const NAMES: [(&str, Ink); 2] = [("classic LQR", Ink::Second), ("OQTAL", Ink::Actual)];

/// The four figures.
pub fn all(surfaces: [&Surface; 2]) -> Vec<Markup> {
    CRITERIA.iter().map(|criterion| figure(criterion, surfaces)).collect()
}

fn figure(criterion: &Criterion, surfaces: [&Surface; 2]) -> Markup {
    let height = |metrics: &TableTwo| (criterion.value)(metrics).max(1e-12).log10();
    let values = surfaces.into_iter().flatten().flatten().map(height);
    let Range { start, end } = extent(values);
    let exponents = 0.0..f64::from(*EXPONENTS.end());
    let power_of_two = |value: f64| power(2, value);
    let mut scene = Scene::new([
        Edge { name: "q", range: exponents.clone(), label: power_of_two },
        Edge { name: "r", range: exponents, label: power_of_two },
        Edge {
            name: criterion.symbol,
            range: start.floor()..end.ceil().max(start.floor() + 1.0),
            label: |value| power(10, value),
        },
    ]);
    scene.surfaces(&NAMES, SIDE, |surface, q, r| {
        let metrics = surfaces[surface][q * SIDE + r].as_ref()?;
        Some([q as f64, r as f64, height(metrics)])
    });
    let number = criterion.figure;
    let title =
        format!("Fig. {number}: {} over q and r; open where control is lost", criterion.name);
    scene.figure(&title)
}

/// Power with a superscript exponent.
fn power(base: u32, exponent: f64) -> String {
    const RAISED: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let raised = |digit: char| digit.to_digit(10).map_or('⁻', |digit| RAISED[digit as usize]);
    let exponent: String = format!("{:.0}", exponent).chars().map(raised).collect();
    format!("{base}{exponent}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_are_raised() {
        assert_eq!([power(2, 20.0), power(10, -3.0), power(10, 0.0)], ["2²⁰", "10⁻³", "10⁰"]);
    }
}
