//! Parameters of the emulated autopilot that a set-up reads, with their factory settings except for the time-out.

use oqtal_bus::time::Span;
use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::{MavlinkContent, ParameterName, ParameterValue};

/// MAV_PARAM_TYPE_INT8.
const INT8: u8 = 2;

/// Parameters of ArduCopter: name, type, value.
const ARDUPILOT: [(&str, u8, f64); 13] = [
    ("VISO_TYPE", INT8, 0.0),
    ("VISO_DELAY_MS", 4, 10.0),
    ("EK3_SRC1_POSXY", INT8, 3.0),
    ("EK3_SRC1_VELXY", INT8, 3.0),
    ("EK3_SRC1_POSZ", INT8, 1.0),
    ("EK3_SRC1_VELZ", INT8, 3.0),
    ("EK3_SRC1_YAW", INT8, 1.0),
    ("GPS1_TYPE", INT8, 1.0),
    ("COMPASS_USE", INT8, 1.0),
    ("COMPASS_USE2", INT8, 1.0),
    ("COMPASS_USE3", INT8, 1.0),
    ("GUID_OPTIONS", ParameterValue::INT32, 0.0),
    ("FS_EKF_ACTION", INT8, 1.0),
];
/// Parameters of PX4.
const PX4: [(&str, u8, f64); 10] = [
    ("EKF2_EV_CTRL", ParameterValue::INT32, 0.0),
    ("EKF2_GPS_CTRL", ParameterValue::INT32, 7.0),
    ("EKF2_HGT_REF", ParameterValue::INT32, 1.0),
    ("EKF2_EV_DELAY", ParameterValue::REAL32, 0.0),
    ("EKF2_MAG_TYPE", ParameterValue::INT32, 0.0),
    ("EKF2_BARO_CTRL", ParameterValue::INT32, 1.0),
    ("COM_RC_IN_MODE", ParameterValue::INT32, 3.0),
    ("NAV_DLL_ACT", ParameterValue::INT32, 0.0),
    ("NAV_RCL_ACT", ParameterValue::INT32, 2.0),
    ("COM_RCL_EXCEPT", ParameterValue::INT32, 0.0),
];

/// Table of parameters; the first is the time without a set-point after which the autopilot takes over \[s\].
#[derive(Clone, Debug)]
pub(super) struct ParameterTable(Vec<(ParameterName, ParameterValue)>);

impl ParameterTable {
    /// Factory settings of an autopilot of this kind, with the time-out `time_out_s` \[s\].
    pub(super) fn new(kind: AutopilotKind, time_out_s: f64) -> Self {
        let (time_out, table) = match kind {
            AutopilotKind::ArduPilot => ("GUID_TIMEOUT", &ARDUPILOT[..]),
            AutopilotKind::Px4 => ("COM_OF_LOSS_T", &PX4[..]),
        };
        let as_bits = kind.sends_integers_as_bits();
        let time_out = [(time_out, ParameterValue::REAL32, time_out_s)];
        let entries = time_out.iter().chain(table).filter_map(|(name, code, number)| {
            let is_real = *code == ParameterValue::REAL32;
            let value = ParameterValue { raw: 0.0, is_real, code: *code };
            Some((ParameterName::new(name)?, value.with(*number, as_bits)))
        });
        Self(entries.collect())
    }

    /// Time without a set-point after which the autopilot takes over.
    pub(super) fn time_out(&self) -> Span {
        Span::from_seconds(self.0.first().map_or(0.0, |(_, value)| f64::from(value.raw)))
    }

    /// Sets that time \[s\].
    pub(super) fn set_time_out(&mut self, seconds: f32) {
        self.0.iter_mut().take(1).for_each(|(_, value)| value.raw = seconds);
    }

    /// Report of the parameter `name`; `None` if it is unknown.
    pub(super) fn get(&self, name: &ParameterName) -> Option<MavlinkContent> {
        let (name, value) = *self.0.iter().find(|(known, _)| known == name)?;
        Some(MavlinkContent::Parameter { name, value })
    }

    /// Sets the parameter `name` and returns its report; `None` if it is unknown.
    pub(super) fn set(
        &mut self,
        name: &ParameterName,
        value: ParameterValue,
    ) -> Option<MavlinkContent> {
        let (_, place) = self.0.iter_mut().find(|(known, _)| known == name)?;
        place.raw = value.raw;
        self.get(name)
    }
}
