//! Test whether the vehicle accelerates in the direction in which it is tilted.
//!
//! Horizontal accelerations, as complex numbers, are compared after two integrations and a wash-out, in which an acceleration `a` is
//! `a / (s^2 + 2 z w s + w^2)` and a position `p` is `s^2 p / (...)`. A vehicle also tilts against drag, which the acceleration contains,
//! and against wind, which it does not: in a slow motion the two can then be perpendicular for a long time. The part that a disturbance of
//! limited size explains is therefore not counted.

use nalgebra::{Vector2, Vector3};

/// Corner of the filters \[rad/s\].
const CORNER_RAD_S: f64 = 2.0;
/// Damping of the filters \[-\].
const DAMPING: f64 = 0.7;
/// Least share of the acceleration by the tilt that counts as evidence when it is seen in the opposite direction, or across \[-\].
const LEAST_SHARE: f64 = 0.4;
/// Rate at which evidence is counted \[1/s\]: accelerations by gusts last for a good part of a second.
const COUNTS_PER_S: f64 = 8.0;
/// Horizontal acceleration by wind and imbalance that a vehicle balances by its tilt without moving \[m/s^2\].
const DISTURBANCE_M_S2: f64 = 0.1;
/// Effect of that disturbance after the filters \[m\].
const LEAST_M: f64 = DISTURBANCE_M_S2 / (CORNER_RAD_S * CORNER_RAD_S);

/// The two filtered accelerations and the sums of evidence.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DirectionTest {
    /// Filtered effect of the tilt \[m\] and its derivative \[m/s\].
    tilted: [Vector2<f64>; 2],
    /// Filtered position \[m\], and the velocity subtracted from it \[m/s\].
    seen: [Vector2<f64>; 2],
    last: Option<Vector2<f64>>,
    /// Opposite, to the left, to the right.
    sums: [f64; 3],
}

impl DirectionTest {
    /// Takes the position \[m, world\] after an interval of `dt_s` \[s\] in which thrust, tilt and drag gave the horizontal acceleration
    /// `acceleration` \[m/s^2, world\]; `deviation_m` is the noise of the position \[m\]. Returns the greatest sum \[-\].
    pub(super) fn take(
        &mut self,
        position: &Vector3<f64>,
        acceleration: &Vector2<f64>,
        deviation_m: f64,
        dt_s: f64,
    ) -> f64 {
        let position = position.xy();
        let moved = self.last.replace(position).map_or(Vector2::zeros(), |last| position - last);
        let damping = 2.0 * DAMPING * CORNER_RAD_S;
        let stiffness = CORNER_RAD_S * CORNER_RAD_S;
        let [tilted, speed] = &mut self.tilted;
        *speed += (acceleration - *speed * damping - *tilted * stiffness) * dt_s;
        *tilted += *speed * dt_s;
        let tilted = *tilted;
        let [seen, velocity] = &mut self.seen;
        let passed = *seen + moved - *velocity * dt_s;
        *seen = passed * (1.0 - (damping * dt_s).min(1.0));
        *velocity += passed * (stiffness * dt_s);
        let square = 0.5 * (tilted.norm_squared() + passed.norm_squared());
        let (along, across) = (tilted.dot(&passed), tilted.perp(&passed));
        let least = deviation_m * deviation_m + LEAST_M * LEAST_M;
        let scale = COUNTS_PER_S * dt_s / (least + square);
        for (sum, share) in self.sums.iter_mut().zip([-along, across, -across]) {
            *sum = (*sum + (share - LEAST_SHARE * (square + least)) * scale).max(0.0);
        }
        self.sums.into_iter().fold(0.0, f64::max)
    }
}
