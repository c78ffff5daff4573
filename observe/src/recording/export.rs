//! Recordings for other tools: CSV with one row per message, columns for MAT-files, and trajectories in the format of the TUM
//! benchmark.

use std::collections::BTreeMap;
use std::fmt::Write;

use oqtal_bus::message::TelemetryV1;
use oqtal_bus::time::Time;
use oqtal_bus::topic::Sample;

use super::cell;
use crate::csv::{ColumnValues, FieldCell};
use crate::sink::{Reception, Sink};

/// Texts by name.
pub type Tables = BTreeMap<String, String>;

/// Export of every topic as CSV: header and body of each message, with units in the column names.
#[derive(Debug, Default)]
pub struct CsvExport {
    /// Tables by topic.
    pub tables: Tables,
}

impl Sink for CsvExport {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        let table = self.tables.entry(sample.topic().to_string()).or_insert_with(|| {
            let names = cell::names(sample.body().fields());
            names.join(",") + "\n"
        });
        let cells: Vec<String> = cell::cells(reception, &sample).map(text_of).collect();
        table.push_str(&cells.join(","));
        table.push('\n');
    }
}

/// Export of every topic as columns: header and body of each message, with units in the names.
#[derive(Debug, Default)]
pub struct ColumnExport {
    /// Columns by topic.
    pub tables: BTreeMap<String, Vec<(String, ColumnValues)>>,
}

impl Sink for ColumnExport {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        let table = self.tables.entry(sample.topic().to_string()).or_insert_with(|| {
            let names = cell::names(sample.body().fields()).into_iter();
            names.map(|name| (name, ColumnValues::EMPTY)).collect()
        });
        let cells = table.iter_mut().zip(cell::cells(reception, &sample));
        cells.for_each(|((_, column), cell)| column.push(cell));
    }
}

/// Formats a cell: a text in quotation marks, NaN as an empty cell.
fn text_of(cell: FieldCell) -> String {
    match cell {
        FieldCell::Text(text) => format!("\"{}\"", text.replace('"', "\"\"")),
        other => other.to_string(),
    }
}

/// Export of trajectories as lines `time x y z qx qy qz qw` \[s; m, world; body to world\], for trajectory evaluation
/// tools: `pose` and `estimate` at the capture of a pose, `truth` and `reference`.
#[derive(Debug, Default)]
pub struct TumExport {
    /// Trajectories by name.
    pub tables: Tables,
    /// Capture of the last estimate.
    estimated_at: Time,
}

impl TumExport {
    fn line(&mut self, name: &str, at: Time, pose: ([f64; 3], [f64; 4])) {
        let ([x, y, z], [qx, qy, qz, qw]) = pose;
        let numbers = [x, y, z, qx, qy, qz, qw];
        if !numbers.iter().all(|number| number.is_finite()) {
            return;
        }
        let (seconds, nanos) = (at.nanos() / 1_000_000_000, at.nanos() % 1_000_000_000);
        let table = self.tables.entry(name.to_owned()).or_default();
        let _ = writeln!(table, "{seconds}.{nanos:09} {x} {y} {z} {qx} {qy} {qz} {qw}");
    }
}

impl Sink for TumExport {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        match sample {
            Sample::Truth(truth) => {
                self.line("truth", truth.time, (truth.position, truth.attitude))
            }
            Sample::Pose(pose) if pose.tracked == 1 => {
                let at = reception.header.stamps.captured_at;
                self.line("pose", at, (pose.position, pose.attitude));
            }
            Sample::Telemetry(telemetry) => {
                let TelemetryV1 { pose_captured_at, position, attitude, .. } = *telemetry;
                // Between two poses the estimate stays.
                if pose_captured_at > self.estimated_at {
                    self.estimated_at = pose_captured_at;
                    self.line("estimate", pose_captured_at, (position, attitude));
                }
                let TelemetryV1 { time, reference_position, attitude_command, .. } = *telemetry;
                self.line("reference", time, (reference_position, attitude_command));
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_estimate_has_the_instant_of_its_capture_once() {
        let mut export = TumExport::default();
        let attitude = [0.0, 0.0, 0.0, 1.0];
        for (tick_s, captured_s) in [(1, 0), (3, 2), (4, 2), (6, 5)] {
            let [time, pose_captured_at] =
                [tick_s, captured_s].map(|seconds| Time::from_nanos(seconds * 1_000_000_000));
            let telemetry =
                TelemetryV1 { time, pose_captured_at, attitude, ..TelemetryV1::default() };
            let received_at = Time::from_nanos(9);
            let reception = Reception { header: Default::default(), received_at };
            export.sample(&reception, Sample::Telemetry(&telemetry));
        }
        let lines: Vec<_> = export.tables["estimate"].lines().map(|line| &line[..12]).collect();
        assert_eq!(lines, ["2.000000000 ", "5.000000000 "]);
    }
}
