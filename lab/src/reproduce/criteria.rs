//! Criteria by which the sweep over the weights compares laws, Figs. 6 to 9.

use oqtal_control::metrics::TableTwo;

/// Exponents (base two) of the weights q and r.
pub const EXPONENTS: std::ops::RangeInclusive<i32> = 0..=20;

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

/// Metrics of one law at every pair of weights, index `q * 21 + r` in exponents; `None` where the law lost control.
pub type Surface = Vec<Option<TableTwo>>;
