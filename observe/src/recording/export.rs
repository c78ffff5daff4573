//! Recordings as text: CSV with one row per message, and trajectories in the format of the TUM benchmark.

use std::collections::BTreeMap;
use std::fmt::Write;

use oqtal_bus::message::{Field, FieldType, Header, Stamps, TelemetryV1};
use oqtal_bus::time::Time;
use oqtal_bus::topic::{ObservedTopic, Sample};

use super::schema::member_name;
use crate::sink::{Reception, Sink};

/// Names of vector components in columns.
const COMPONENTS: [&str; 4] = ["x", "y", "z", "w"];
/// Unit of a field that contains the bytes of a text.
const TEXT: &str = "text";

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
        let (topic, message) = (sample.topic(), sample.body());
        let table = self.tables.entry(topic.to_string()).or_insert_with(|| {
            let fields = [Header::FIELDS, Stamps::FIELDS, message.fields()].concat();
            let names: Vec<_> = fields.iter().flat_map(columns).collect();
            format!("received_at_ns,{}\n", names.join(","))
        });
        let Header { sequence, pose_sequence, schema, source, stamps } = &reception.header;
        let words = [reception.received_at.nanos(), *sequence, *pose_sequence, *schema, *source];
        let words = words.into_iter().chain(stamps.to_words());
        let mut cells: Vec<String> = words.map(|word| word.to_string()).collect();
        let packed = message.packed();
        let mut rest = packed.as_slice();
        for field in message.fields() {
            let (bytes, behind) = rest.split_at(field.size());
            rest = behind;
            match field.unit {
                TEXT => cells.push(quoted(bytes)),
                _ => cells.extend(
                    bytes.chunks(field.element.size()).map(|bytes| text_of(field.element, bytes)),
                ),
            }
        }
        table.push_str(&cells.join(","));
        table.push('\n');
    }

    /// Ignores losses; a recording contains them as events.
    fn lost(&mut self, _: ObservedTopic, _: u64) {}
}

/// Columns of a field: one for each element.
fn columns(field: &Field) -> Vec<String> {
    let name = member_name(field);
    match field.length {
        1 => vec![name],
        _ if field.unit == TEXT => vec![name],
        length => {
            COMPONENTS[..length].iter().map(|component| format!("{name}_{component}")).collect()
        }
    }
}

/// The bytes of a text as a quoted cell, without the trailing zeros.
fn quoted(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    format!("\"{}\"", text.trim_end_matches('\0').replace('"', "\"\""))
}

/// An element as text; empty for NaN.
fn text_of(element: FieldType, bytes: &[u8]) -> String {
    let mut word = [0; 8];
    word[..bytes.len()].copy_from_slice(bytes);
    let number = u64::from_le_bytes(word);
    match element {
        FieldType::U8 | FieldType::U32 | FieldType::U64 | FieldType::Time => number.to_string(),
        FieldType::I64 => number.cast_signed().to_string(),
        FieldType::F64 if f64::from_bits(number).is_nan() => String::new(),
        FieldType::F64 => f64::from_bits(number).to_string(),
    }
}

/// Export of trajectories as lines `time x y z qx qy qz qw` \[s; m, world; body to world\], for trajectory evaluation
/// tools: `pose` at its capture, `truth`, `estimate` and `reference`.
#[derive(Debug, Default)]
pub struct TumExport {
    /// Trajectories by name.
    pub tables: Tables,
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
                let TelemetryV1 { time, position, attitude, .. } = *telemetry;
                self.line("estimate", time, (position, attitude));
                let TelemetryV1 { reference_position, attitude_command, .. } = *telemetry;
                self.line("reference", time, (reference_position, attitude_command));
            }
            _ => {}
        }
    }

    /// Ignores losses; a recording contains them as events.
    fn lost(&mut self, _: ObservedTopic, _: u64) {}
}
