//! Statistics of the emulated cameras, compared with those of recordings.

use std::path::Path;

use oqtal_bus::message::TruthV1;
use oqtal_config::Config;
use oqtal_control::quaternion::Attitude;
use oqtal_mocap_emu::emulation::record;
use oqtal_mocap_emu::recording::Recording;
use oqtal_mocap_emu::statistics::{GridStatistics, RestStatistics, RoomStatistics};
use oqtal_runtime::process::{Exit, Failure};
use serde_json::{Value, json};

use crate::text_table::markdown;

/// Figure of a recording: name, and value; `None` if it cannot be computed from the recording.
type NamedFigure = (&'static str, fn(&RoomStatistics) -> Option<f64>);

/// Compared figures.
const FIGURES: [NamedFigure; 21] = [
    ("rate [Hz]", |s| Some(s.rate_hz)),
    ("arrival intervals, SD [ms]", |s| Some(s.interval_ms)),
    ("shorter than 5 ms [%]", |s| Some(s.shares_percent[0])),
    ("5 to 15 ms [%]", |s| Some(s.shares_percent[1])),
    ("15 to 25 ms [%]", |s| Some(s.shares_percent[2])),
    ("25 to 35 ms [%]", |s| Some(s.shares_percent[3])),
    ("35 to 50 ms [%]", |s| Some(s.shares_percent[4])),
    ("over 50 ms [per 1000 s]", |s| Some(s.gaps[0])),
    ("over 80 ms [per 1000 s]", |s| Some(s.gaps[1])),
    ("over 250 ms [per 1000 s]", |s| Some(s.gaps[2])),
    ("capture grid [Hz]", |s| grid(s, |g| g.rate_hz)),
    ("coherence with the grid", |s| grid(s, |g| g.coherence_ratio)),
    ("capture intervals, SD [ms]", |s| grid(s, |g| g.interval_ms)),
    ("correlation, capture and arrival", |s| grid(s, |g| g.correlation_ratio)),
    ("capture to arrival, SD [ms]", |s| grid(s, |g| g.latency_ms)),
    ("position at rest, SD [mm]", |s| rest(s, |r| r.position_mm)),
    ("attitude at rest, SD [deg]", |s| rest(s, |r| r.attitude_deg)),
    ("Allan slope, position", |s| rest(s, |r| r.position_slope_ratio)),
    ("Allan slope, attitude", |s| rest(s, |r| r.attitude_slope_ratio)),
    ("correlation, position and attitude", |s| rest(s, |r| r.coupling_ratio)),
    ("greatest kurtosis", |s| rest(s, |r| r.kurtosis_ratio)),
];

fn grid(statistics: &RoomStatistics, of: fn(&GridStatistics) -> f64) -> Option<f64> {
    statistics.grid.as_ref().map(of)
}

fn rest(statistics: &RoomStatistics, of: fn(&RestStatistics) -> f64) -> Option<f64> {
    statistics.rest.as_ref().map(of)
}

/// Figures of the emulated cameras and of recordings.
#[derive(Clone, Debug)]
pub struct CameraStudy {
    emulated: [Option<f64>; FIGURES.len()],
    recordings: Vec<(String, [Option<f64>; FIGURES.len()])>,
}

impl CameraStudy {
    /// Emulates the cameras of `config` with a body at rest and one in motion for `seconds`, and reads `files`.
    ///
    /// # Errors
    /// A file cannot be read or is not a recording (exit code 65), or the cameras see no body.
    pub fn of(config: &Config, seconds: f64, files: &[&Path]) -> Result<Self, Failure> {
        let watch = |motion: fn(f64) -> TruthV1| {
            let watched = record((&config.mocap, config.clock.seed), seconds, motion);
            let reason = "no pose arrives: check [mocap] for dropouts and markers";
            let watched = watched.ok_or_else(|| Failure::new(Exit::Flight, reason))?;
            Ok::<_, Failure>(RoomStatistics::of(&watched.recording))
        };
        let (still, moving) = (watch(at_rest)?, watch(lemniscate)?);
        let emulated = RoomStatistics { grid: moving.grid, ..still };
        let read = |file: &&Path| {
            let recording = Recording::read(file)
                .map_err(|error| Failure::new(Exit::Data, error.to_string()))?;
            Ok((name_among(files, file), figures(&RoomStatistics::of(&recording))))
        };
        let recordings = files.iter().map(read).collect::<Result<_, Failure>>()?;
        Ok(Self { emulated: figures(&emulated), recordings })
    }

    /// Whether a figure of the emulated cameras is within the range of the recordings; `None` with fewer than two recordings.
    pub fn is_within(&self, figure: usize) -> Option<bool> {
        let found: Vec<f64> = self.recordings.iter().filter_map(|(_, all)| all[figure]).collect();
        let value = self.emulated[figure].filter(|_| found.len() > 1)?;
        Some(found.iter().any(|it| *it <= value) && found.iter().any(|it| *it >= value))
    }

    /// The study as a table in Markdown.
    pub fn to_text(&self) -> String {
        let names = self.recordings.iter().map(|(name, _)| name.as_str());
        let headings: Vec<&str> =
            ["figure", "emulated"].into_iter().chain(names).chain(["within"]).collect();
        let row = |(k, (name, _)): (usize, &NamedFigure)| {
            let values = self.recordings.iter().map(|(_, all)| all[k]);
            let values = std::iter::once(self.emulated[k]).chain(values).map(cell);
            let within = match self.is_within(k) {
                Some(true) => "yes",
                Some(false) => "no",
                None => "-",
            };
            [(*name).to_owned()].into_iter().chain(values).chain([within.to_owned()]).collect()
        };
        markdown(&headings, FIGURES.iter().enumerate().map(row))
    }

    /// The study as JSON: `{"figures": [{"name", "emulated", "recordings": {NAME: value}, "within"}]}`.
    pub fn to_json(&self) -> Value {
        let figures = FIGURES.iter().enumerate().map(|(k, (name, _))| {
            let recordings: serde_json::Map<String, Value> =
                self.recordings.iter().map(|(name, all)| (name.clone(), json!(all[k]))).collect();
            json!({ "name": name, "emulated": self.emulated[k], "recordings": recordings,
                "within": self.is_within(k) })
        });
        json!({ "figures": figures.collect::<Vec<Value>>() })
    }
}

/// Name of a recording: that of its file without the extension, or the path if another of `files` has that name.
fn name_among(files: &[&Path], file: &Path) -> String {
    let is_like = |other: &&&Path| other.file_stem() == file.file_stem();
    let stem = file.file_stem().filter(|_| files.iter().filter(is_like).count() == 1);
    stem.unwrap_or(file.as_os_str()).to_string_lossy().into_owned()
}

fn figures(statistics: &RoomStatistics) -> [Option<f64>; FIGURES.len()] {
    FIGURES.map(|(_, of)| of(statistics))
}

fn cell(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
}

/// A body at rest in the middle of the room.
fn at_rest(_: f64) -> TruthV1 {
    TruthV1 { position: [0.0, 0.0, 1.0], attitude: Attitude::LEVEL.xyzw(), ..TruthV1::default() }
}

/// Lemniscate with speeds up to 1 m/s.
fn lemniscate(t_s: f64) -> TruthV1 {
    let angle = 1.1 * t_s;
    TruthV1 {
        position: [0.65 * angle.sin(), 0.325 * (2.0 * angle).sin(), 1.0],
        velocity: [0.715 * angle.cos(), 0.715 * (2.0 * angle).cos(), 0.0],
        ..at_rest(t_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_with_one_file_name_are_named_by_their_paths() {
        let files = ["a/flight.csv", "b/flight.csv", "b/rest.csv"].map(Path::new);
        let names = files.map(|file| name_among(&files, file));
        assert_eq!(names, ["a/flight.csv", "b/flight.csv", "rest"]);
    }
}
