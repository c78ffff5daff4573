//! `telemetry.csv`: one row for each tick, units in the column names, an empty cell for an unknown value.
//!
//! `csv/columns.md` is the list of the columns and their dictionary, a part of `docs/data.md`; `csv/row.rs` makes the cells, in
//! the same order; `csv/column.rs` has their types, and columns of them.

mod column;
mod row;

use std::io::Write;

use crate::flight::Flight;

pub use column::{ColumnValues, FieldCell};
use row::Row;

/// The columns as a table in Markdown: names, unit and frame, instant, meaning.
pub const DICTIONARY: &str = include_str!("csv/columns.md");

/// Writes the ticks of `flight` to `out`; `t_s` counts from [`Flight::origin`].
///
/// # Errors
/// `out` cannot be written.
pub fn write(flight: &Flight, out: impl Write) -> ::csv::Result<()> {
    let mut writer = ::csv::Writer::from_writer(out);
    writer.write_record(names())?;
    for row in rows(flight) {
        writer.write_record(row.cells().iter().map(FieldCell::to_string))?;
    }
    writer.flush()?;
    Ok(())
}

/// The ticks of `flight` as columns, in the order and with the names of the file.
pub fn columns(flight: &Flight) -> Vec<(&'static str, ColumnValues)> {
    let mut columns: Vec<_> = names().map(|name| (name, ColumnValues::EMPTY)).collect();
    for row in rows(flight) {
        let cells = columns.iter_mut().zip(row.cells());
        cells.for_each(|((_, column), cell)| column.push(cell));
    }
    columns
}

/// The rows of the file, one for each tick.
fn rows(flight: &Flight) -> impl Iterator<Item = Row<'_>> {
    let origin = flight.origin();
    flight.samples_with_commands().map(move |(sample, applied)| Row { sample, applied, origin })
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
        assert_eq!(columns.iter().map(|(name, _)| *name).collect::<Vec<_>>(), names);
        let number = |number: &f64| FieldCell::Number(*number).to_string();
        for (index, (name, values)) in columns.into_iter().enumerate() {
            let text: Vec<String> = match values {
                ColumnValues::Numbers(numbers) => numbers.iter().map(number).collect(),
                ColumnValues::Counts(counts) => counts.iter().map(u64::to_string).collect(),
                ColumnValues::Signed(_) => panic!("{name} has spans of time"),
                ColumnValues::Words(words) => words,
            };
            let cells = rows.iter().map(|row| row[index].clone());
            assert_eq!(text, cells.collect::<Vec<_>>(), "{name}");
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
