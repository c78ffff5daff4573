//! Parameters and log variables of the emulated vehicle that hosts need to fly it, with the names of the firmware.

use oqtal_control::euler::EulerAngles;
use oqtal_control::quaternion::Attitude;
use oqtal_wire::crtp::{
    CrtpPose, LogType, ParameterType, Supervision, TableElement, TableInfo, TableKind,
};

/// Parameter: group, name, type, initial value \[-\].
type Parameter = (&'static str, &'static str, ParameterType, f64);

/// All parameters, numbered from 0.
pub(super) const PARAMETERS: [Parameter; 9] = [
    ("flightmode", "althold", ParameterType::U8, 0.0),
    ("flightmode", "poshold", ParameterType::U8, 0.0),
    ("flightmode", "posSet", ParameterType::U8, 0.0),
    ("flightmode", "stabModeRoll", ParameterType::U8, 1.0),
    ("flightmode", "stabModePitch", ParameterType::U8, 1.0),
    ("flightmode", "stabModeYaw", ParameterType::U8, 0.0),
    ("stabilizer", "estimator", ParameterType::U8, 1.0),
    ("locSrv", "extPosStdDev", ParameterType::F32, 0.01),
    ("locSrv", "extQuatStdDev", ParameterType::F32, 4.5e-3),
];
/// Indices of the parameters that select angles for roll, pitch and yaw.
pub(super) const STABILISATION: [usize; 3] = [3, 4, 5];

/// All log variables, numbered from 0.
const LOG_VARIABLES: [(&str, &str, LogType); 11] = [
    ("pm", "vbat", LogType::F32),
    ("supervisor", "info", LogType::U16),
    ("stateEstimate", "x", LogType::F32),
    ("stateEstimate", "y", LogType::F32),
    ("stateEstimate", "z", LogType::F32),
    ("stateEstimate", "roll", LogType::F32),
    ("stateEstimate", "pitch", LogType::F32),
    ("stateEstimate", "yaw", LogType::F32),
    ("gyro", "x", LogType::F32),
    ("gyro", "y", LogType::F32),
    ("gyro", "z", LogType::F32),
];

/// Element `id` of a table; `None` beyond its end.
pub(super) fn element(table: TableKind, id: u16) -> Option<TableElement<'static>> {
    let place = usize::from(id);
    let (group, name, kind) = match table {
        TableKind::Parameters => {
            PARAMETERS.get(place).map(|(group, name, kind, _)| (*group, *name, *kind as u8))?
        }
        TableKind::Logging => {
            LOG_VARIABLES.get(place).map(|(group, name, kind)| (*group, *name, *kind as u8))?
        }
    };
    Some(TableElement { id, kind, group, name })
}

/// Size and CRC of a table.
pub(super) fn info(table: TableKind) -> TableInfo {
    TableInfo::of((0..).map_while(|id| element(table, id)))
}

/// Values of the log variables.
#[derive(Clone, Copy, Debug)]
pub(super) struct Logged {
    pub(super) battery_v: f64,
    pub(super) supervision: Supervision,
    pub(super) estimate: CrtpPose,
    /// Body rate by the gyroscope \[rad/s, body\].
    pub(super) rate: [f64; 3],
}

impl Logged {
    /// Value of log variable `id` \[-\], in degrees with the vehicle's signs: pitch is positive nose up.
    pub(super) fn value(&self, id: u16) -> f64 {
        let position = |axis: usize| self.estimate.position[axis];
        let attitude = Attitude::from_xyzw(self.estimate.attitude).unwrap_or_default();
        let EulerAngles { roll, pitch, yaw } = EulerAngles::from_attitude(&attitude);
        match id {
            0 => self.battery_v,
            1 => f64::from(self.supervision.bits()),
            2..=4 => position(usize::from(id) - 2),
            5 => roll.to_degrees(),
            6 => -pitch.to_degrees(),
            7 => yaw.to_degrees(),
            8..=10 => self.rate[usize::from(id) - 8].to_degrees(),
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_fits_into_a_packet_and_has_its_number() {
        for table in [TableKind::Parameters, TableKind::Logging] {
            let count = info(table).count;
            assert!(element(table, count).is_none() && count > 0);
            let lengths = (0..count).map(|id| element(table, id).unwrap());
            assert!(lengths.map(|e| e.group.len() + e.name.len()).all(|length| length <= 24));
        }
        for (place, name) in STABILISATION.into_iter().zip(["Roll", "Pitch", "Yaw"]) {
            assert_eq!(PARAMETERS[place].1, format!("stabMode{name}"));
        }
    }
}
