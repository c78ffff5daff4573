//! `telemetry.csv`: one row for each tick, units in the column names, an empty cell for an unknown value.
//!
//! `csv/columns.md` is the list of the columns and their dictionary, a part of `docs/data.md`; `csv/row.rs` makes the cells, in
//! the same order.

mod row;

use std::collections::HashMap;
use std::io::Write;

use crate::flight::{AppliedCommand, Flight};

use row::Row;

/// The columns as a table in Markdown: names, unit and frame, instant, meaning.
const DICTIONARY: &str = include_str!("csv/columns.md");

/// Writes the ticks of `flight` to `out`; `t_s` counts from [`Flight::origin`].
///
/// # Errors
/// `out` cannot be written.
pub fn write(flight: &Flight, out: impl Write) -> ::csv::Result<()> {
    let mut writer = ::csv::Writer::from_writer(out);
    writer.write_record(names())?;
    let applied: HashMap<u64, &AppliedCommand> =
        flight.applied.iter().map(|command| (command.sequence, command)).collect();
    let origin = flight.origin();
    for sample in &flight.samples {
        let applied = applied.get(&sample.telemetry.command_sequence).copied();
        writer.write_record(Row { sample, applied, origin }.cells())?;
    }
    writer.flush()?;
    Ok(())
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
