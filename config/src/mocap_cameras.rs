//! `[mocap.cameras]` and `[mocap.markers]`: the cameras of the room and the markers on the body, for `model = "markers"`.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

/// Greatest number of cameras, and of markers.
const MOST: usize = 16;

/// `[mocap.cameras]`. All cameras are of one kind, level about their viewing direction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct CameraOptions {
    /// Positions of the cameras \[m, world\].
    pub positions_m: Vec<[f64; 3]>,
    /// Point at which each camera is aimed \[m, world\].
    pub aims_m: Vec<[f64; 3]>,
    /// Horizontal field of view \[deg\].
    pub field_of_view_deg: f64,
    /// Width and height of the image \[pixels\].
    pub resolution_px: [u32; 2],
    /// Standard deviation of a marker's image point along each image axis \[pixels\].
    pub pixel_noise_px: f64,
    /// Exposure \[ms\]: a moving marker is imaged at its position in the middle of the exposure.
    pub exposure_ms: f64,
    /// Numbers, from 1, of covered cameras.
    pub covered: Vec<usize>,
}

/// `[mocap.markers]`: markers, the body that hides them, and limits of an accepted fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct MarkerOptions {
    /// Positions of the markers \[m, body\].
    pub positions_m: Vec<[f64; 3]>,
    /// Semi-axes of the ellipsoid about the body's origin that hides markers behind it \[m, body\]; 0 hides none.
    pub hull_m: [f64; 3],
    /// Numbers, from 1, of markers that are hidden from every camera.
    pub hidden: Vec<usize>,
    /// Probability that a marker becomes hidden in a frame \[0..1\].
    pub vanish_probability: f64,
    /// Mean number of frames for which it stays hidden \[frames\], geometric.
    pub vanish_frames: f64,
    /// Probability that two markers are swapped from a frame on \[0..1\].
    pub swap_probability: f64,
    /// Mean number of frames for which they stay swapped \[frames\], geometric.
    pub swap_frames: f64,
    /// Least number of markers of a tracked body \[-\].
    pub least_visible: usize,
    /// Greatest root mean square distance of the markers from the body fitted to them \[mm\]; above it the body is lost.
    pub max_residual_mm: f64,
    /// Greatest root mean square distance between measured and reprojected image points of a marker \[pixels\]; above it the
    /// marker is not used.
    pub max_reprojection_px: f64,
}

impl CameraOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        let cameras = self.positions_m.len();
        check_points("positions-m", &self.positions_m, 2)?;
        check_points("aims-m", &self.aims_m, 2)?;
        if self.aims_m.len() != cameras {
            let allowed = format!("a point for each of the {cameras} cameras of positions-m");
            let found = format!("a list of {}", self.aims_m.len());
            return Err(OptionError::new("aims-m", found, allowed));
        }
        if self.positions_m.iter().zip(&self.aims_m).any(|(at, aim)| straight_up(at, aim)) {
            let allowed =
                "off the vertical through its camera: the image has to have an upper side";
            return Err(OptionError::new("aims-m", "above or below its camera", allowed));
        }
        check_numbers("covered", &self.covered, cameras)?;
        let [width, height] = self.resolution_px.map(f64::from);
        check_options([
            ("field-of-view-deg", self.field_of_view_deg, Rule::Between(1.0, 170.0)),
            ("resolution-px", width.min(height), Rule::Between(16.0, 65536.0)),
            ("pixel-noise-px", self.pixel_noise_px, Rule::NotNegative),
            ("exposure-ms", self.exposure_ms, Rule::Between(0.0, 1000.0)),
        ])
    }
}

impl MarkerOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        let markers = self.positions_m.len();
        check_points("positions-m", &self.positions_m, 3)?;
        check_numbers("hidden", &self.hidden, markers)?;
        let share = Rule::Between(0.0, 1.0);
        let frames = Rule::Between(1.0, f64::MAX);
        let least = Rule::Between(3.0, markers as f64);
        check_options([
            ("hull-m", self.hull_m.iter().copied().fold(0.0, f64::max), Rule::Between(0.0, 10.0)),
            ("hull-m", self.hull_m.iter().copied().fold(0.0, f64::min), Rule::Between(0.0, 10.0)),
            ("vanish-probability", self.vanish_probability, share),
            ("vanish-frames", self.vanish_frames, frames),
            ("swap-probability", self.swap_probability, share),
            ("swap-frames", self.swap_frames, frames),
            ("least-visible", self.least_visible as f64, least),
            ("max-residual-mm", self.max_residual_mm, Rule::Positive),
            ("max-reprojection-px", self.max_reprojection_px, Rule::Positive),
        ])
    }
}

/// Checks that `points` has at least `least` finite points and at most the maximum.
fn check_points(key: &str, points: &[[f64; 3]], least: usize) -> Result<(), OptionError> {
    let is_finite = points.iter().flatten().all(|number| number.is_finite());
    if is_finite && (least..=MOST).contains(&points.len()) {
        return Ok(());
    }
    let found = format!("a list of {}", points.len());
    Err(OptionError::new(key, found, format!("a list of {least} to {MOST} finite points")))
}

/// Checks that `numbers` are among 1 to `most`.
fn check_numbers(key: &str, numbers: &[usize], most: usize) -> Result<(), OptionError> {
    match numbers.iter().find(|number| !(1..=most).contains(number)) {
        None => Ok(()),
        Some(wrong) => Err(OptionError::new(key, wrong, format!("between 1 and {most}"))),
    }
}

/// Whether a camera is aimed straight up or down.
fn straight_up(at: &[f64; 3], aim: &[f64; 3]) -> bool {
    let horizontal = (aim[0] - at[0]).hypot(aim[1] - at[1]);
    horizontal < 1e-3 * (aim[2] - at[2]).abs().max(1e-3)
}
