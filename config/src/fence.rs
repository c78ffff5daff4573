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
        if corners == 0 || (3..=MOST_CORNERS).contains(&corners) && finite {
            return Ok(());
        }
        let allowed = format!("empty, or 3 to {MOST_CORNERS} corners of finite numbers");
        Err(OptionError::new("polygon-m", format_args!("{corners} corners"), allowed))
    }
}
