//! `telemetry.csv`: one row for each tick, units in the column names, an empty cell for an unknown value.
//!
//! `t_s` is the instant of the tick, and that of `true_*`, `ref_*`, `cmd_*` and of what was sent. `pose_*`, `est_*`, `filter_*`
//! and `innovation_*` are for the capture of the newest accepted pose, `pose_captured_s`, on the same time axis.

use std::io::Write;

use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::message::TelemetryV1;
use oqtal_bus::time::Time;
use oqtal_control::trajectory::Phase;

use crate::flight::{Flight, FlightSample};

/// A column of words: name, and value of a tick; `None` leaves the cell empty.
type WordColumn = (&'static str, fn(&TelemetryV1) -> Option<String>);

const WORDS: [WordColumn; 4] = [
    ("mode", |t| Mode::from_code(t.mode).map(|mode| mode.to_string())),
    ("state", |t| SafetyState::from_code(t.state).map(|state| state.to_string())),
    ("cause", |t| Cause::from_code(t.cause).map(|cause| cause.to_string())),
    ("phase", |t| Phase::from_number(t.phase).map(|phase| phase.to_string())),
];

/// Adjacent columns of numbers: names, and values of a tick, of which as many are used as there are names.
type NumberColumns = (&'static [&'static str], fn(&FlightSample) -> [f64; 4]);

const NUMBERS: [NumberColumns; 31] = [
    (&["tick", "mission_s"], |s| two(s.telemetry.tick as f64, s.telemetry.mission_s)),
    (&["scored", "fresh", "saturated"], |s| {
        three([s.telemetry.scored, s.telemetry.fresh, s.telemetry.saturated].map(f64::from))
    }),
    (&["est_x_m", "est_y_m", "est_z_m"], |s| three(s.telemetry.position)),
    (&["est_vx_m_s", "est_vy_m_s", "est_vz_m_s"], |s| three(s.telemetry.velocity)),
    (&["est_qx", "est_qy", "est_qz", "est_qw"], |s| s.telemetry.attitude),
    (&["est_rate_x_rad_s", "est_rate_y_rad_s", "est_rate_z_rad_s"], |s| three(s.telemetry.rate)),
    (&["true_x_m", "true_y_m", "true_z_m"], |s| three(s.truth.map_or(UNKNOWN, |t| t.position))),
    (&["true_vx_m_s", "true_vy_m_s", "true_vz_m_s"], |s| {
        three(s.truth.map_or(UNKNOWN, |t| t.velocity))
    }),
    (&["true_qx", "true_qy", "true_qz", "true_qw"], |s| {
        s.truth.map_or([f64::NAN; 4], |t| t.attitude)
    }),
    (&["true_rate_x_rad_s", "true_rate_y_rad_s", "true_rate_z_rad_s"], |s| {
        three(s.truth.map_or(UNKNOWN, |t| t.rate))
    }),
    (&["ref_x_m", "ref_y_m", "ref_z_m"], |s| three(s.telemetry.reference_position)),
    (&["cmd_vx_m_s", "cmd_vy_m_s", "cmd_vz_m_s"], |s| three(s.telemetry.velocity_command)),
    (&["cmd_qx", "cmd_qy", "cmd_qz", "cmd_qw"], |s| s.telemetry.attitude_command),
    (&["stick_roll", "stick_pitch", "stick_yaw"], |s| three(s.telemetry.sticks)),
    (&["torque_x_nm", "torque_y_nm", "torque_z_nm"], |s| three(s.telemetry.torque)),
    (&["sent_qx", "sent_qy", "sent_qz", "sent_qw"], |s| s.telemetry.attitude_sent),
    (&["thrust"], |s| two(s.telemetry.thrust, f64::NAN)),
    (&["pose_age_ms", "wakeup_lateness_us"], |s| {
        two(s.telemetry.pose_age_s * 1e3, s.telemetry.wakeup_lateness_ns as f64 * 1e-3)
    }),
    (&["riccati_solves", "riccati_failures", "deadline_misses"], |s| {
        let TelemetryV1 { riccati_solves, riccati_failures, deadline_misses, .. } = s.telemetry;
        three([riccati_solves, riccati_failures, deadline_misses].map(|count| count as f64))
    }),
    (&["poses_lost", "poses_superseded", "poses_refused"], |s| {
        let TelemetryV1 { poses_lost, poses_superseded, poses_refused, .. } = s.telemetry;
        three([poses_lost, poses_superseded, poses_refused].map(|count| count as f64))
    }),
    (&["command_sequence"], |s| two(s.telemetry.command_sequence as f64, f64::NAN)),
    (&["pose_x_m", "pose_y_m", "pose_z_m"], |s| three(s.telemetry.pose_position)),
    (&["pose_qx", "pose_qy", "pose_qz", "pose_qw"], |s| s.telemetry.pose_attitude),
    (&["pose_sequence", "pose_residual_mm"], |s| {
        two(s.telemetry.pose_sequence as f64, s.telemetry.pose_residual_m * 1e3)
    }),
    (&["filter_x_m", "filter_y_m", "filter_z_m"], |s| three(s.telemetry.filter_position)),
    (&["filter_vx_m_s", "filter_vy_m_s", "filter_vz_m_s"], |s| three(s.telemetry.filter_velocity)),
    (&["filter_qx", "filter_qy", "filter_qz", "filter_qw"], |s| s.telemetry.filter_attitude),
    (&["filter_rate_x_rad_s", "filter_rate_y_rad_s", "filter_rate_z_rad_s"], |s| {
        three(s.telemetry.filter_rate)
    }),
    (&["innovation_x_m", "innovation_y_m", "innovation_z_m"], |s| {
        three(s.telemetry.innovation_position)
    }),
    (&["innovation_roll_rad", "innovation_pitch_rad", "innovation_yaw_rad"], |s| {
        three(s.telemetry.innovation_attitude)
    }),
    (&["nis_position", "nis_attitude"], |s| two(s.telemetry.nis[0], s.telemetry.nis[1])),
];

/// Adjacent columns of instants: names, and instants of a tick.
type InstantColumns = (&'static [&'static str], fn(&TelemetryV1) -> [Time; 2]);

/// The instants, on the time axis of `t_s`.
const INSTANTS: InstantColumns =
    (&["pose_captured_s", "pose_published_s"], |t| [t.pose_captured_at, t.pose_published_at]);

const UNKNOWN: [f64; 3] = [f64::NAN; 3];

fn two(a: f64, b: f64) -> [f64; 4] {
    [a, b, f64::NAN, f64::NAN]
}

fn three([x, y, z]: [f64; 3]) -> [f64; 4] {
    [x, y, z, f64::NAN]
}

/// Writes the ticks of `flight` to `out`; `t_s` counts from [`Flight::origin`].
///
/// # Errors
/// `out` cannot be written.
pub fn write(flight: &Flight, out: impl Write) -> ::csv::Result<()> {
    let mut writer = ::csv::Writer::from_writer(out);
    let names = NUMBERS.iter().flat_map(|(names, _)| names.iter());
    let names = INSTANTS.0.iter().chain(names);
    writer.write_record(["t_s"].iter().chain(WORDS.iter().map(|(name, _)| name)).chain(names))?;
    let origin = flight.origin();
    for sample in &flight.samples {
        let t_s = sample.telemetry.time.since(origin).seconds();
        let words = WORDS.iter().map(|(_, word)| word(&sample.telemetry).unwrap_or_default());
        let numbers = NUMBERS
            .iter()
            .flat_map(|(names, numbers)| numbers(sample).into_iter().take(names.len()).map(number));
        let instants = (INSTANTS.1)(&sample.telemetry)
            .map(|at| number(if at.is_set() { at.since(origin).seconds() } else { f64::NAN }));
        let cells = std::iter::once(number(t_s)).chain(words).chain(instants).chain(numbers);
        writer.write_record(cells)?;
    }
    writer.flush()?;
    Ok(())
}

/// The shortest decimal text that is read back as the same number; empty for NaN.
fn number(value: f64) -> String {
    if value.is_nan() { String::new() } else { value.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fixture;

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
    fn names_are_distinct_and_what_is_unknown_is_empty() {
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
