//! Quasi-Newton search within the unit cube, in whole batches, for an objective that is smooth except for the cliffs beyond which a
//! flight is lost or oscillates.
//!
//! An iteration evaluates two batches. Points on both sides of the best one, along each coordinate, give gradient and diagonal of the
//! Hessian; changes of the gradient give its other elements by the symmetric rank-one update, J. Nocedal and S. J. Wright, *Numerical
//! Optimization*, 2nd ed., Eq. (6.24). The minima of this model, and of its diagonal alone, within boxes of several sizes around the
//! best point are the second batch. The box of the best of them is the next trust region, which shrinks by at
//! most half. Once it is small, points far away are evaluated; the search begins again at one that is better.

use nalgebra::{DMatrix, DVector};

use super::bee_colony::Best;

/// Initial half width of the trust region, and its bounds; below the lower one the search has converged \[-\].
const FIRST_REGION: f64 = 0.1;
const REGION: [f64; 2] = [4e-3, 0.4];
/// Distance of the points for the derivatives: at first, and later over the half width of the trust region \[-\].
const FIRST_DISTANCE: f64 = 0.05;
const DISTANCE: f64 = 0.3;
/// Half widths of the boxes over that of the trust region \[-\].
const BOXES: [f64; 4] = [0.25, 0.5, 1.0, 2.0];
/// Half width of the trust region below which points far away are evaluated, until none of them is better: a model of small
/// differences does not see beyond a flat part \[-\].
const POLLED_BELOW: f64 = 0.03;
/// Distance of these points along each coordinate \[-\].
const POLL_DISTANCE: f64 = 0.2;
/// Greatest rise of a value for the derivatives, over the least objective: cliffs shall not dominate them \[-\].
const CLIFF: f64 = 0.3;
/// Least cosine between the step and the change of the gradient that the Hessian does not explain, for an update \[-\].
const LEAST_COSINE: f64 = 0.1;

/// A quadratic model around the best point.
struct Model {
    gradient: DVector<f64>,
    hessian: DMatrix<f64>,
    /// Point of the model; empty before the first.
    at: DVector<f64>,
}

/// Searches from the point of `best`, which has a finite value, until `points` are evaluated or the trust region has shrunk to a point.
pub(super) fn minimise(
    best: &mut Best,
    points: usize,
    mut evaluate: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
) {
    let n = best.point.len();
    let mut model =
        Model { gradient: DVector::zeros(n), hessian: DMatrix::zeros(n, n), at: DVector::zeros(0) };
    let (mut region, mut has_polled) = (FIRST_REGION, false);
    while region > REGION[0] && best.evaluations + model.points() <= points {
        let is_first = model.is_first();
        let distance = if is_first { FIRST_DISTANCE } else { DISTANCE * region };
        let centre = best.clone();
        let offsets = offsets(&centre.point, distance);
        let around = around(&centre.point, &offsets);
        let values = evaluate(&around);
        model.update(&centre, &offsets, &values);
        let diagonal = DMatrix::from_diagonal(&model.hessian.diagonal());
        let hessians = if is_first { vec![&diagonal] } else { vec![&model.hessian, &diagonal] };
        let step = |hessian, share| model.minimum(hessian, share * region);
        let minima: Vec<Vec<f64>> = hessians
            .into_iter()
            .flat_map(|hessian| BOXES.map(|share| step(hessian, share)))
            .collect();
        best.note(&around, &values);
        let values = evaluate(&minima);
        let before = best.value;
        best.note(&minima, &values);
        let found = minima.iter().zip(BOXES.into_iter().cycle()).find(|(it, _)| **it == best.point);
        let share = found.filter(|_| best.value < before).map_or(0.5, |(_, share)| share.max(0.5));
        region = (region * share).min(REGION[1]);
        if region < POLLED_BELOW && !has_polled && best.evaluations + 2 * n <= points {
            let before = best.value;
            let far = far(&best.point);
            best.note(&far, &evaluate(&far));
            has_polled = best.value >= before;
            region = if has_polled { region } else { FIRST_REGION };
        }
    }
}

/// `point` moved by the distance of the poll along each coordinate, both ways, within the unit cube.
fn far(point: &[f64]) -> Vec<Vec<f64>> {
    let sides = [-POLL_DISTANCE, POLL_DISTANCE];
    let moved = |k: usize| {
        sides.map(|offset| {
            let mut moved = point.to_vec();
            moved[k] = (moved[k] + offset).clamp(0.0, 1.0);
            moved
        })
    };
    (0..point.len()).flat_map(moved).collect()
}

/// Two offsets per coordinate, at which the derivatives are taken: on both sides, or both on one side of a point near a face.
fn offsets(point: &[f64], distance: f64) -> Vec<[f64; 2]> {
    let of = |x: &f64| match (x - distance < 0.0, x + distance > 1.0) {
        (true, _) => [distance, 2.0 * distance],
        (_, true) => [-distance, -2.0 * distance],
        _ => [-distance, distance],
    };
    point.iter().map(of).collect()
}

/// `point` moved by each of the offsets, in order.
fn around(point: &[f64], offsets: &[[f64; 2]]) -> Vec<Vec<f64>> {
    let moved = |(index, offset): (usize, &f64)| {
        let mut moved = point.to_vec();
        moved[index / 2] += offset;
        moved
    };
    offsets.iter().flatten().enumerate().map(moved).collect()
}

impl Model {
    fn is_first(&self) -> bool {
        self.at.is_empty()
    }

    /// Number of points of the next iteration.
    fn points(&self) -> usize {
        // Without a second gradient both Hessians are the same.
        let minima = if self.is_first() { BOXES.len() } else { 2 * BOXES.len() };
        2 * self.gradient.len() + minima
    }

    /// Updates gradient and Hessian with the `values` at the offsets from `centre`.
    fn update(&mut self, centre: &Best, offsets: &[[f64; 2]], values: &[f64]) {
        let cliff = CLIFF * centre.value.abs();
        // The minimum of a limit and NaN is the limit.
        let rises: Vec<f64> = values.iter().map(|it| (it - centre.value).min(cliff)).collect();
        // The parabola through the centre and the two points
        let secants = |k: usize| [0, 1].map(|side| rises[2 * k + side] / offsets[k][side]);
        let curvature =
            |k: usize| 2.0 * (secants(k)[1] - secants(k)[0]) / (offsets[k][1] - offsets[k][0]);
        let n = offsets.len();
        let gradient =
            DVector::from_fn(n, |k, _| secants(k)[0] - 0.5 * curvature(k) * offsets[k][0]);
        let at = DVector::from_column_slice(&centre.point);
        if !self.is_first() {
            let step = &at - &self.at;
            let unexplained = &gradient - &self.gradient - &self.hessian * &step;
            let product = unexplained.dot(&step);
            if product.abs() > LEAST_COSINE * unexplained.norm() * step.norm() {
                self.hessian += &unexplained * unexplained.transpose() / product;
            }
        }
        self.hessian.set_diagonal(&DVector::from_fn(n, |k, _| curvature(k)));
        (self.gradient, self.at) = (gradient, at);
    }

    /// Minimum of the model with this Hessian in the box of this half width and the unit cube, by descent along one coordinate after the
    /// other.
    fn minimum(&self, hessian: &DMatrix<f64>, half_width: f64) -> Vec<f64> {
        const ROUNDS: usize = 100;
        let mut step = DVector::zeros(self.at.len());
        for _ in 0..ROUNDS {
            let before = step.clone();
            for k in 0..step.len() {
                let curvature = hessian[(k, k)];
                let slope = self.gradient[k] + hessian.column(k).dot(&step) - curvature * step[k];
                let low = (-half_width).max(-self.at[k]);
                let high = half_width.min(1.0 - self.at[k]);
                let rise = |to: f64| slope * to + 0.5 * curvature * to * to;
                step[k] = match -slope / curvature {
                    to if curvature > 0.0 => to.clamp(low, high),
                    _ if rise(low) < rise(high) => low,
                    _ => high,
                };
            }
            if (&step - before).amax() < 1e-9 {
                break;
            }
        }
        (&self.at + step).iter().map(|x| x.clamp(0.0, 1.0)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn minimum(objective: impl Fn(&[f64]) -> f64, start: &[f64], points: usize) -> Best {
        let value = objective(start);
        let mut best = Best { point: start.to_vec(), value, evaluations: 1 };
        minimise(&mut best, points, |points| points.iter().map(|x| objective(x)).collect());
        best
    }

    #[test]
    fn a_coupled_quadratic_of_ten_coordinates_costs_less_than_200_points() {
        let at = |k: usize| 0.3 + 0.04 * k as f64;
        let objective = |x: &[f64]| {
            let terms = x.iter().enumerate().map(|(k, x)| (1 + k) as f64 * (x - at(k)).powi(2));
            let coupled = x.windows(2).enumerate();
            let coupled = coupled.map(|(k, x)| (x[0] - at(k)) * (x[1] - at(k + 1)));
            1.0 + terms.sum::<f64>() + coupled.sum::<f64>()
        };
        let best = minimum(objective, &[0.5; 10], 200);
        assert!(best.value < 1.0 + 1e-4 && best.evaluations <= 200, "{best:?}");
    }

    #[test]
    fn a_lower_minimum_beyond_a_rise_is_found() {
        let well = |x: f64, at: f64, depth: f64| depth * (-((x - at) / 0.08).powi(2)).exp();
        let objective =
            |x: &[f64]| 2.0 - well(x[0], 0.4, 0.5) - well(x[0], 0.65, 1.0) + (x[1] - 0.3).powi(2);
        let best = minimum(objective, &[0.4, 0.5], 200);
        assert!(best.value < 1.01, "{best:?}");
    }

    #[test]
    fn a_minimum_on_a_face_is_found_there() {
        let best = minimum(|x| 2.0 + x[0] - x[1] + (x[2] - 0.4).powi(2), &[0.5; 3], 150);
        assert_eq!(best.point[..2], [0.0, 1.0], "{best:?}");
        assert!((best.point[2] - 0.4).abs() < 1e-3, "{best:?}");
    }

    #[test]
    fn a_minimum_before_a_cliff_is_approached() {
        let objective = |x: &[f64]| match x[0] + x[1] > 1.2 {
            true => f64::NAN,
            false => 3.0 - x[0] - x[1] + (x[0] - x[1]).powi(2),
        };
        let best = minimum(objective, &[0.2, 0.3], 300);
        assert!(best.value < 1.8 * 1.01, "{best:?}");
    }
}
