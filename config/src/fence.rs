//! `[fence]`: the space in which the vehicle may fly.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

/// Greatest number of corners of a fence: the daemon measures the distance to every side in every tick.
const MOST_CORNERS: usize = 64;

/// `[fence]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct FenceOptions {
    /// Limits along x \[m, world\]; not used with a polygon.
    pub x_m: [f64; 2],
    /// Limits along y \[m, world\]; not used with a polygon.
    pub y_m: [f64; 2],
    /// Limits along z \[m, world\].
    pub z_m: [f64; 2],
    /// Corners `[x, y]` of the fence in order \[m, world\], in place of the ranges of x and y; empty for none.
    pub polygon_m: Vec<[f64; 2]>,
    /// Distance of the soft border inside the hard one \[m\], at the sides and at the top.
    pub soft_margin_m: f64,
}

impl FenceOptions {
    /// Ranges of the box around the fence along x, y and z \[m, world\].
    pub fn ranges_m(&self) -> [[f64; 2]; 3] {
        let around = |axis: usize, range: [f64; 2]| {
            let along = || self.polygon_m.iter().map(|corner| corner[axis]);
            match self.polygon_m.is_empty() {
                true => range,
                false => [
                    along().fold(f64::INFINITY, f64::min),
                    along().fold(f64::NEG_INFINITY, f64::max),
                ],
            }
        };
        [around(0, self.x_m), around(1, self.y_m), self.z_m]
    }

    pub(crate) fn check(&self) -> Result<(), OptionError> {
        self.check_numbers().map_err(|error| error.within("fence"))
    }

    fn check_numbers(&self) -> Result<(), OptionError> {
        check_options([("soft-margin-m", self.soft_margin_m, Rule::NotNegative)])?;
        let ranges = [("x-m", &self.x_m), ("y-m", &self.y_m), ("z-m", &self.z_m)];
        for (key, [from, to]) in ranges {
            // A comparison with NaN is false.
            let width = to - from;
            if width.is_nan() || width <= 2.0 * self.soft_margin_m {
                let margin_m = self.soft_margin_m;
                let allowed = format!("a range wider than twice fence.soft-margin-m, {margin_m}");
                return Err(OptionError::new(key, format_args!("[{from}, {to}]"), allowed));
            }
        }
        let corners = self.polygon_m.len();
        let finite = self.polygon_m.iter().flatten().all(|number| number.is_finite());
        let is_counted = corners == 0 || (3..=MOST_CORNERS).contains(&corners) && finite;
        if !is_counted {
            let allowed = format!("empty, or 3 to {MOST_CORNERS} corners of finite numbers");
            return Err(OptionError::new("polygon-m", format_args!("{corners} corners"), allowed));
        }
        match crossing(&self.polygon_m) {
            Some((a, b)) => {
                let found = format!("with sides that cross, those that begin at {a:?} and {b:?}");
                Err(OptionError::new(
                    "polygon-m",
                    found,
                    "the corners in their order around the room",
                ))
            }
            None => Ok(()),
        }
    }
}

/// First corners of two sides of a polygon that cross; `None` if no sides do.
fn crossing(corners: &[[f64; 2]]) -> Option<([f64; 2], [f64; 2])> {
    let side = |k: usize| (corners[k], corners[(k + 1) % corners.len()]);
    let pairs = (0..corners.len()).flat_map(|a| (a + 2..corners.len()).map(move |b| (a, b)));
    let crossing = pairs.into_iter().find(|(a, b)| do_cross(side(*a), side(*b)));
    crossing.map(|(a, b)| (corners[a], corners[b]))
}

/// Whether each of two sides has the ends of the other on both of its sides; sides that only touch do not cross.
fn do_cross((p, q): ([f64; 2], [f64; 2]), (r, s): ([f64; 2], [f64; 2])) -> bool {
    // Twice the area of a triangle, positive if its corners are counterclockwise.
    let area = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    area(p, q, r) * area(p, q, s) < 0.0 && area(r, s, p) * area(r, s, q) < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_whose_sides_cross_are_found_in_any_order_around_the_room() {
        let square = [[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]];
        let l = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 2.0], [2.0, 4.0], [0.0, 4.0]];
        assert!(crossing(&square).is_none() && crossing(&l).is_none() && crossing(&[]).is_none());
        let clockwise: Vec<_> = l.into_iter().rev().collect();
        assert!(crossing(&clockwise).is_none());
        let [a, b, c, d] = square;
        assert_eq!(crossing(&[a, c, b, d]), Some((a, b)));
        assert_eq!(crossing(&[a, b, d, c]), Some((b, c)));
    }
}
