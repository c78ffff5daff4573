//! The fence: distances to the borders of the space in which the vehicle may fly.

use std::sync::Arc;

use nalgebra::{Vector2, Vector3};
use oqtal_config::{Config, FenceOptions};

/// Share of the greatest acceleration with which a vehicle brakes \[-\]; the rest is for corrections.
const BRAKING_SHARE: f64 = 0.75;

/// Model of a stop: after a reaction time, a constant deceleration.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Braking {
    /// Horizontal deceleration \[m/s^2\].
    horizontal_m_s2: f64,
    /// Vertical deceleration \[m/s^2\].
    vertical_m_s2: f64,
    /// Reaction time until the vehicle brakes: delay of the command, lag, and the turn of the attitude \[s\].
    pub(crate) reaction_s: f64,
}

impl Braking {
    /// The braking of the vehicle of `config` within its limits of tilt and vertical acceleration.
    pub(crate) fn of(config: &Config) -> Self {
        let (vehicle, position) = (&config.vehicle, &config.position);
        let tilt_rad = position.tilt_limit_deg.to_radians();
        let lift = vehicle.max_thrust_n / vehicle.mass_kg - vehicle.gravity_m_s2;
        let [roll, pitch, _] = vehicle.rate_authority_rad_s;
        let lag_ms = vehicle.command_delay_ms + vehicle.rate_lag_ms.max(vehicle.thrust_lag_ms);
        Self {
            horizontal_m_s2: BRAKING_SHARE * vehicle.gravity_m_s2 * tilt_rad.tan(),
            vertical_m_s2: BRAKING_SHARE * position.vertical_acceleration_limit_m_s2.min(lift),
            reaction_s: lag_ms * 1e-3 + 2.0 * tilt_rad / roll.min(pitch),
        }
    }

    /// Greatest deceleration in the direction of `velocity` \[m/s, world\] \[m/s^2\].
    pub(crate) fn along(&self, velocity: &Vector3<f64>) -> f64 {
        let horizontal = velocity.xy().norm() / self.horizontal_m_s2;
        let s = horizontal.hypot(velocity.z / self.vertical_m_s2);
        if s > 0.0 { velocity.norm() / s } else { self.horizontal_m_s2.min(self.vertical_m_s2) }
    }

    /// The point at which a vehicle at `position` \[m, world\] with `velocity` \[m/s, world\] and the horizontal `acceleration`
    /// \[m/s^2, world\] stops. The acceleration decreases to zero, linearly, within the reaction time.
    pub(crate) fn stopping_point(
        &self,
        position: &Vector3<f64>,
        velocity: &Vector3<f64>,
        acceleration: &Vector2<f64>,
    ) -> Vector3<f64> {
        let (t_s, acceleration) = (self.reaction_s, acceleration.push(0.0));
        let mut way = (velocity + acceleration * (t_s / 3.0)) * t_s;
        // A descent ends at the floor, and not at the lower border.
        way.z = way.z.max(0.0);
        let velocity = velocity + acceleration * (t_s / 2.0);
        position + way + velocity * (0.5 * velocity.norm() / self.along(&velocity))
    }
}

/// The borders. A copy shares the corners, so that copying does not allocate.
#[derive(Clone, Debug)]
pub struct Fence {
    low: Vector3<f64>,
    high: Vector3<f64>,
    corners: Arc<[Vector2<f64>]>,
    soft_margin: f64,
}

impl Fence {
    /// The fence of `[fence]`.
    pub fn new(options: &FenceOptions) -> Self {
        let ranges = [options.x_m, options.y_m, options.z_m];
        let side = |index: usize| Vector3::from(ranges.map(|range: [f64; 2]| range[index]));
        let corners = options.polygon_m.iter().map(|corner| Vector2::from(*corner)).collect();
        Self { low: side(0), high: side(1), corners, soft_margin: options.soft_margin_m }
    }

    /// Distance from `position` \[m, world\] to the hard border \[m\]: positive inside.
    pub fn inside_m(&self, position: &Vector3<f64>) -> f64 {
        self.inside_by_m(position, 0.0)
    }

    /// Distance from `position` \[m, world\] to a border that lies `margin` \[m\] further inside at the sides and at the top, but
    /// not at the bottom \[m\]: positive inside.
    pub fn inside_by_m(&self, position: &Vector3<f64>, margin: f64) -> f64 {
        // The minimum of a number and NaN is the number.
        if position.iter().any(|coordinate| !coordinate.is_finite()) {
            return f64::NAN;
        }
        (self.inside_upper_m(position) - margin).min(position.z - self.low.z)
    }

    /// Distance from `position` \[m, world\] to the soft border \[m\]: positive inside.
    pub fn inside_soft_m(&self, position: &Vector3<f64>) -> f64 {
        self.inside_by_m(position, self.soft_margin)
    }

    /// Distance to the sides and to the top \[m\]: positive inside.
    pub(crate) fn inside_upper_m(&self, position: &Vector3<f64>) -> f64 {
        self.inside_sides_m(position).min(self.high.z - position.z)
    }

    /// Distance to the sides \[m\]: positive inside.
    pub(crate) fn inside_sides_m(&self, position: &Vector3<f64>) -> f64 {
        if self.corners.is_empty() {
            let (below, above) = (position - self.low, self.high - position);
            below.xy().min().min(above.xy().min())
        } else {
            self.inside_polygon_m(&position.xy())
        }
    }

    fn inside_polygon_m(&self, point: &Vector2<f64>) -> f64 {
        let (mut nearest, mut is_inside) = (f64::INFINITY, false);
        let mut from = self.corners[self.corners.len() - 1];
        for to in self.corners.iter() {
            let (side, relative) = (to - from, point - from);
            let along = (relative.dot(&side) / side.norm_squared()).clamp(0.0, 1.0);
            // The clamp leaves NaN of a side without length: its ends belong to other sides.
            nearest = nearest.min((relative - side * along).norm());
            // Sides that a ray along x crosses, counted even or odd.
            let spans = (from.y > point.y) != (to.y > point.y);
            if spans && point.x < from.x + side.x * (point.y - from.y) / side.y {
                is_inside = !is_inside;
            }
            from = *to;
        }
        if is_inside { nearest } else { -nearest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fence(polygon_m: &[[f64; 2]]) -> Fence {
        Fence::new(&FenceOptions {
            x_m: [-2.0, 3.0],
            y_m: [-1.0, 1.0],
            z_m: [-0.5, 2.5],
            polygon_m: polygon_m.to_vec(),
            soft_margin_m: 0.4,
        })
    }

    #[test]
    fn the_distance_to_a_box_is_that_to_its_nearest_side() {
        let fence = fence(&[]);
        let at = |x, y, z| fence.inside_m(&Vector3::new(x, y, z));
        assert!((at(0.0, 0.0, 1.0) - 1.0).abs() < 1e-12, "y");
        assert!((at(2.9, 0.0, 1.0) - 0.1).abs() < 1e-12, "x");
        assert!((at(0.0, 0.0, -0.3) - 0.2).abs() < 1e-12, "floor");
        assert!((at(0.0, 0.0, 2.4) - 0.1).abs() < 1e-12, "top");
        assert!((at(0.0, 1.25, 1.0) + 0.25).abs() < 1e-12, "outside");
        let soft = |z| fence.inside_soft_m(&Vector3::new(0.0, 0.0, z));
        assert!((soft(1.0) - 0.6).abs() < 1e-12 && (soft(0.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_polygon_may_have_a_notch() {
        // An L: the upper right quarter is missing.
        let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 2.0], [2.0, 4.0], [0.0, 4.0]];
        let fence = fence(&corners);
        let at = |x, y| fence.inside_m(&Vector3::new(x, y, 1.0));
        assert!((at(1.0, 1.0) - 1.0).abs() < 1e-12);
        assert!((at(3.0, 1.5) - 0.5).abs() < 1e-12);
        assert!((at(3.0, 3.0) + 1.0).abs() < 1e-12, "in the notch");
        assert!((at(-0.5, 1.0) + 0.5).abs() < 1e-12);
    }

    #[test]
    fn nowhere_is_inside_if_the_position_is_not_finite() {
        for corners in [&[][..], &[[0.0, 0.0], [4.0, 0.0], [4.0, 2.0]]] {
            let one =
                |axis: usize| Vector3::from_fn(|row, _| if row == axis { f64::NAN } else { 0.5 });
            for nowhere in [Vector3::repeat(f64::NAN), one(0), one(1), one(2)] {
                let is_inside = fence(corners).inside_m(&nowhere) > 0.0;
                assert!(!is_inside, "{nowhere}");
            }
        }
    }
}
