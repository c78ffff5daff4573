//! Noise of a pose computed from simulated markers, by position in the room.

use nalgebra::Vector3;
use oqtal_bus::message::TruthV1;
use oqtal_config::Config;
use oqtal_control::quaternion::Attitude;
use oqtal_control::statistics::{mean, population_deviation};
use oqtal_mocap_emu::markers::{MarkerCameras, MarkerFrame};
use serde::Serialize;

use crate::text_table::markdown;

/// Positions: name and coordinates \[m, world\].
const PLACES: [(&str, [f64; 3]); 6] = [
    ("centre", [0.0, 0.0, 1.0]),
    ("centre, on the floor", [0.0, 0.0, 0.05]),
    ("centre, high", [0.0, 0.0, 1.8]),
    ("corner of the square", [0.65, 0.65, 1.0]),
    ("half way to the edge", [1.3, 0.0, 1.0]),
    ("edge", [2.3, 0.0, 1.0]),
];

/// Noise at one position.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PlaceNoise {
    /// Name of the position.
    #[serde(rename = "place")]
    pub name: &'static str,
    /// Coordinates of the position \[m, world\].
    pub position_m: [f64; 3],
    /// Standard deviation of the position along each axis \[mm, world\].
    pub position_mm: [f64; 3],
    /// Standard deviation of the attitude about each axis \[deg, body\].
    pub attitude_deg: [f64; 3],
    /// Mean number of cameras that see a marker \[-\].
    #[serde(rename = "cameras")]
    pub cameras_ratio: f64,
    /// Pixel noise estimated from the reprojection \[px\]; equals the configured noise if the model is correct.
    #[serde(rename = "reprojection_px")]
    pub reprojection_ratio: f64,
    /// Root mean square distance of the markers from the fitted body \[mm\].
    pub residual_mm: f64,
    /// Share of the frames in which the body is tracked \[percent\].
    pub tracked_percent: f64,
}

/// Noise at every position, each from `frames` frames of a level body at rest.
pub fn map(config: &Config, frames: u64) -> Vec<PlaceNoise> {
    PLACES.iter().map(|(name, place)| at(config, frames, (name, *place))).collect()
}

fn at(config: &Config, frames: u64, (name, place): (&'static str, [f64; 3])) -> PlaceNoise {
    let mut cameras = MarkerCameras::new(&config.mocap, config.clock.seed);
    let truth = |capture| TruthV1 {
        capture,
        position: place,
        attitude: Attitude::LEVEL.xyzw(),
        ..TruthV1::default()
    };
    let seen: Vec<MarkerFrame> = (1..=frames).map(|frame| cameras.observe(&truth(frame))).collect();
    let bodies: Vec<_> = seen.iter().filter_map(|frame| frame.body).collect();
    let points: Vec<_> = seen.iter().flat_map(|frame| frame.markers).flatten().collect();
    let cameras: Vec<f64> = points.iter().map(|point| point.cameras as f64).collect();
    let freedom: f64 = cameras.iter().map(|count| 2.0 * count - 3.0).sum();
    let squared_px: f64 = points.iter().map(|point| point.squared_px).sum();
    let squared_m: Vec<f64> = bodies.iter().map(|body| body.residual_m.powi(2)).collect();
    let places: Vec<_> = bodies.iter().map(|body| body.position).collect();
    let turns: Vec<_> =
        bodies.iter().map(|body| Attitude::LEVEL.rotation_to(&body.attitude)).collect();
    PlaceNoise {
        name,
        position_m: place,
        position_mm: (deviation(&places) * 1e3).into(),
        attitude_deg: deviation(&turns).map(f64::to_degrees).into(),
        cameras_ratio: mean(&cameras),
        reprojection_ratio: (squared_px / freedom).sqrt(),
        residual_mm: mean(&squared_m).sqrt() * 1e3,
        tracked_percent: 100.0 * bodies.len() as f64 / seen.len() as f64,
    }
}

/// Standard deviation of each component.
fn deviation(values: &[Vector3<f64>]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| {
        population_deviation(&values.iter().map(|value| value[axis]).collect::<Vec<_>>())
    })
}

/// The map as a table in Markdown.
pub fn to_text(map: &[PlaceNoise]) -> String {
    let headings = [
        "place",
        "x, y, z [m]",
        "position, SD x, y, z [mm]",
        "attitude, SD roll, pitch, yaw [deg]",
        "cameras per marker",
        "reprojection [px]",
        "residual [mm]",
        "tracked [%]",
    ];
    let three = |numbers: [f64; 3], places: usize| {
        numbers.map(|number| format!("{number:.places$}")).join(", ")
    };
    let row = |row: &PlaceNoise| {
        vec![
            row.name.to_owned(),
            three(row.position_m, 2),
            three(row.position_mm, 3),
            three(row.attitude_deg, 3),
            format!("{:.1}", row.cameras_ratio),
            format!("{:.3}", row.reprojection_ratio),
            format!("{:.2}", row.residual_mm),
            format!("{:.1}", row.tracked_percent),
        ]
    };
    markdown(&headings, map.iter().map(row))
}
