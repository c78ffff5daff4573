//! `telemetry.csv`: one row for each tick, units in the column names, an empty cell for an unknown value.
//!
//! `csv/columns.md` is the list of the columns and their dictionary, a part of `docs/data.md`; `csv/row.rs` makes the cells, in
//! the same order; `csv/column.rs` collects them as columns.

mod column;
mod row;

use std::io::Write;

use crate::flight::Flight;

use column::ColumnSink;
pub use column::{ColumnValues, TelemetryColumn};
use row::{CellSink, Row};

/// The columns as a table in Markdown: names, unit and frame, instant, meaning.
const DICTIONARY: &str = include_str!("csv/columns.md");

/// Writes the ticks of `flight` to `out`; `t_s` counts from [`Flight::origin`].
///
/// # Errors
/// `out` cannot be written.
pub fn write(flight: &Flight, out: impl Write) -> ::csv::Result<()> {
    let mut writer = ::csv::Writer::from_writer(out);
    writer.write_record(names())?;
    let mut cells = TextCells::default();
    rows(flight).try_for_each(|row| {
        cells.0.clear();
        row.write(&mut cells);
        writer.write_record(&cells.0)
    })?;
    writer.flush()?;
    Ok(())
}

/// The ticks of `flight` as columns, in the order and with the names of the file.
pub fn columns(flight: &Flight) -> Vec<TelemetryColumn> {
    let mut sink = ColumnSink::new(names());
    rows(flight).for_each(|row| {
        sink.begin_row();
        row.write(&mut sink);
    });
    sink.into_columns()
}

/// The rows of the file, one for each tick.
fn rows(flight: &Flight) -> impl Iterator<Item = Row<'_>> {
    let origin = flight.origin();
    flight.samples_with_commands().map(move |(sample, applied)| Row { sample, applied, origin })
}

/// Cells as text: numbers as the shortest decimals that reproduce them exactly.
#[derive(Default)]
struct TextCells(Vec<String>);

impl CellSink for TextCells {
    fn number(&mut self, value: f64) {
        self.0.push(if value.is_nan() { String::new() } else { value.to_string() });
    }

    fn count(&mut self, value: u64) {
        self.0.push(value.to_string());
    }

    fn word(&mut self, word: String) {
        self.0.push(word);
    }
}

/// The columns as a table in Markdown: names, unit and frame, instant, meaning.
pub fn dictionary() -> &'static str {
    DICTIONARY
}

/// Names of the columns, in order: the words in code marks in the first cell of each line of the table.
fn names() -> impl Iterator<Item = &'static str> {
    let cells = DICTIONARY.lines().skip(2).filter_map(|line| line.split('|').nth(1));
    cells.flat_map(str::split_whitespace).map(|name| name.trim_matches('`'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::fixture;
    use oqtal_bus::time::Span;

    fn read(flight: &Flight) -> (Vec<String>, Vec<Vec<String>>) {
        let mut bytes = Vec::new();
        write(flight, &mut bytes).unwrap();
        let mut reader = ::csv::Reader::from_reader(bytes.as_slice());
        let names = reader.headers().unwrap().iter().map(str::to_owned).collect();
        let rows = reader.records().map(|row| row.unwrap().iter().map(str::to_owned).collect());
        (names, rows.collect())
    }

    #[test]
    fn every_tick_is_a_row_and_numbers_come_back_bit_for_bit() {
        let flight = fixture::square();
        let (names, rows) = read(&flight);
        assert_eq!(rows.len(), flight.samples.len());
        let column = |name: &str| names.iter().position(|other| other == name).unwrap();
        for (row, sample) in rows.iter().zip(&flight.samples) {
            let number = |name: &str| row[column(name)].parse::<f64>().unwrap();
            let truth = sample.truth.unwrap();
            assert_eq!(number("true_z_m"), truth.position[2]);
            assert_eq!(number("true_qw"), truth.attitude[3]);
            assert_eq!(number("ref_y_m"), sample.telemetry.reference_position[1]);
            assert_eq!(number("stick_pitch"), sample.telemetry.sticks[1]);
            assert_eq!(number("thrust"), sample.telemetry.thrust);
            assert_eq!(row[column("state")] == "Coast", sample.telemetry.fresh == 0);
        }
    }

    #[test]
    fn columns_have_the_cells_of_the_file() {
        let flight = fixture::square();
        let (names, rows) = read(&flight);
        let columns = columns(&flight);
        assert_eq!(columns.iter().map(|column| column.name).collect::<Vec<_>>(), names);
        for (index, TelemetryColumn { name, values }) in columns.iter().enumerate() {
            let mut text = TextCells::default();
            match values {
                ColumnValues::Numbers(numbers) => numbers.iter().for_each(|n| text.number(*n)),
                ColumnValues::Counts(counts) => counts.iter().for_each(|n| text.count(*n)),
                ColumnValues::Signed(_) => panic!("{name} has spans of time"),
                ColumnValues::Words(words) => text.0.clone_from(words),
            }
            let cells = rows.iter().map(|row| row[index].clone());
            assert_eq!(text.0, cells.collect::<Vec<_>>(), "{name}");
        }
    }

    #[test]
    fn hops_and_battery_are_those_of_the_command_of_the_tick() {
        let mut flight = fixture::square();
        flight
            .applied
            .retain(|command| command.sequence != flight.samples[7].telemetry.command_sequence);
        let (names, rows) = read(&flight);
        let column = |name: &str| names.iter().position(|other| other == name).unwrap();
        assert!(
            rows[7][column("battery_v")].is_empty()
                && rows[7][column("sensor_to_actuator_us")].is_empty()
        );
        let hops = ["capture_to_publish_us", "publish_to_daemon_us", "compute_us"];
        let rest = ["command_to_vehicle_us", "vehicle_to_applied_us"];
        let number = |name: &str| rows[8][column(name)].parse::<f64>().unwrap();
        let sum: f64 = hops.into_iter().chain(rest).map(number).sum();
        assert!((sum - number("sensor_to_actuator_us")).abs() < 1e-6, "{sum}");
    }

    #[test]
    fn a_command_of_a_later_daemon_with_the_same_number_is_another_one() {
        let mut flight = fixture::square();
        let (_, alone) = read(&flight);
        for mut command in flight.applied.clone() {
            let stamps = &mut command.stamps;
            stamps.woken_at = stamps.woken_at + Span::from_millis(60_000);
            flight.applied.push(command);
        }
        assert_eq!(read(&flight).1, alone);
    }

    #[test]
    fn names_are_distinct_and_unknown_values_are_empty_cells() {
        let (names, rows) = read(&fixture::replay());
        let distinct: std::collections::BTreeSet<_> = names.iter().collect();
        assert_eq!(distinct.len(), names.len());
        let truth = names.iter().zip(&rows[0]).filter(|(name, _)| name.starts_with("true_"));
        assert_eq!(truth.filter(|(_, cell)| cell.is_empty()).count(), 13);
    }

    #[test]
    fn an_empty_flight_is_a_header() {
        assert!(read(&fixture::empty()).1.is_empty());
    }
}
