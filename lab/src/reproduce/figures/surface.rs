//! Figs. 6 to 9: a criterion over the weights, classic LQR and OQTAL on the same axes.

use std::ops::Range;

use oqtal_control::metrics::TableTwo;

use crate::reproduce::criteria::{CRITERIA, Criterion, EXPONENTS, Surface};
use oqtal_observe::plot::axis::extent;
use oqtal_observe::plot::palette::Ink;

use super::Figure;
use super::scene::{Edge, Scene};

const NAMES: [(&str, Ink); 2] = [("classic LQR", Ink::Second), ("OQTAL", Ink::Actual)];

/// The four figures.
pub fn all(surfaces: [&Surface; 2]) -> Vec<Figure> {
    CRITERIA.iter().map(|criterion| figure(criterion, surfaces)).collect()
}

fn figure(criterion: &Criterion, surfaces: [&Surface; 2]) -> Figure {
    let side = (EXPONENTS.end() + 1) as usize;
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
    scene.surfaces(&NAMES, side, |surface, q, r| {
        let metrics = surfaces[surface][q * side + r].as_ref()?;
        Some([q as f64, r as f64, height(metrics)])
    });
    let number = criterion.figure;
    let title =
        format!("Fig. {number}: {} over q and r; open where control is lost", criterion.name);
    Figure { number, markup: scene.figure(&title) }
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
