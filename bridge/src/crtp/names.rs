//! Parameters and log variables of a Crazyflie that the bridge uses, by the names of the firmware.

use oqtal_wire::crtp::TableKind;

/// Name: group, and name within it.
pub type TableName = (&'static str, &'static str);

/// Greatest number of names of one table \[-\].
pub const MAX_NAMES: usize = 11;

/// Log variables; the places are those of [`LogName`].
const LOG_NAMES: [TableName; 11] = [
    ("pm", "vbat"),
    ("supervisor", "info"),
    ("gyro", "x"),
    ("gyro", "y"),
    ("gyro", "z"),
    ("stateEstimate", "x"),
    ("stateEstimate", "y"),
    ("stateEstimate", "z"),
    ("stateEstimate", "roll"),
    ("stateEstimate", "pitch"),
    ("stateEstimate", "yaw"),
];
/// Place of the battery voltage among the log variables \[V\].
pub const BATTERY: usize = 0;
/// Place of the supervisor's bits.
pub const SUPERVISOR: usize = 1;
/// Place of the first axis of the gyroscope \[deg/s\].
pub const GYROSCOPE: usize = 2;
/// Place of the first of position and attitude, which follow one another \[m, degrees\].
pub const ESTIMATE: usize = 5;

/// Parameters.
const PARAMETER_NAMES: [TableName; 7] = [
    ("flightmode", "stabModeRoll"),
    ("flightmode", "stabModePitch"),
    ("flightmode", "stabModeYaw"),
    ("flightmode", "althold"),
    ("flightmode", "poshold"),
    ("flightmode", "posSet"),
    ("stabilizer", "estimator"),
];
/// Number of the parameters that every flight needs, the first ones; the others are set where the firmware has them.
pub const REQUIRED_PARAMETERS: usize = 3;
/// Place of the estimator's choice.
pub const ESTIMATOR: usize = 6;

/// The names that are looked for in a table.
pub fn names(table: TableKind) -> &'static [TableName] {
    match table {
        TableKind::Logging => &LOG_NAMES,
        TableKind::Parameters => &PARAMETER_NAMES,
    }
}
