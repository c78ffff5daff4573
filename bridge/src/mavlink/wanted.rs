//! Parameters that an autopilot needs for flights by set-points and external poses, with reasons.

use oqtal_wire::link::AutopilotKind;

use crate::wanted::{WantedParameter, WantedValue};

/// Shorthand for the tables.
const fn exactly(name: &'static str, value: f64, reason: &'static str) -> WantedParameter {
    WantedParameter { name, value: WantedValue::Exactly(value), reason }
}

/// ArduCopter 4.x.
const ARDUPILOT: [WantedParameter; 12] = [
    exactly("VISO_TYPE", 1.0, "poses of cameras come over MAVLink"),
    exactly("EK3_SRC1_POSXY", 6.0, "position from those poses"),
    exactly("EK3_SRC1_VELXY", 0.0, "they contain no velocity"),
    exactly("EK3_SRC1_POSZ", 6.0, "height from those poses"),
    exactly("EK3_SRC1_VELZ", 0.0, "they contain no velocity"),
    exactly("EK3_SRC1_YAW", 6.0, "heading from those poses"),
    exactly("GPS1_TYPE", 0.0, "no GPS indoors; takes a restart"),
    exactly("COMPASS_USE", 0.0, "steel bends the field indoors"),
    exactly("COMPASS_USE2", 0.0, "steel bends the field indoors"),
    exactly("COMPASS_USE3", 0.0, "steel bends the field indoors"),
    WantedParameter {
        name: "GUID_OPTIONS",
        value: WantedValue::Bits(8),
        reason: "thrust of a set-point is thrust; without bit 3 it is a climb rate",
    },
    WantedParameter {
        name: "GUID_TIMEOUT",
        value: WantedValue::AtMost(0.1),
        reason: "s without a set-point until the vehicle levels by itself",
    },
];

/// PX4 1.15 and later.
const PX4: [WantedParameter; 8] = [
    WantedParameter {
        name: "EKF2_EV_CTRL",
        value: WantedValue::Bits(11),
        reason: "position, height and heading from poses of cameras",
    },
    exactly("EKF2_HGT_REF", 3.0, "height is that of those poses"),
    exactly("EKF2_GPS_CTRL", 0.0, "no GPS indoors"),
    exactly("EKF2_MAG_TYPE", 5.0, "no compass: steel bends the field indoors"),
    exactly("EKF2_BARO_CTRL", 0.0, "pressure changes with every door"),
    exactly("EKF2_EV_DELAY", 0.0, "poses contain their time of capture"),
    WantedParameter {
        name: "COM_RCL_EXCEPT",
        value: WantedValue::Bits(4),
        reason: "Offboard continues without R/C",
    },
    WantedParameter {
        name: "COM_OF_LOSS_T",
        value: WantedValue::AtMost(0.1),
        reason: "s without a set-point until the vehicle leaves Offboard",
    },
];

/// Parameters with rules, for this autopilot.
pub fn wanted_parameters(kind: AutopilotKind) -> &'static [WantedParameter] {
    match kind {
        AutopilotKind::ArduPilot => &ARDUPILOT,
        AutopilotKind::Px4 => &PX4,
    }
}

/// Name of a parameter in earlier firmware; `None` if it was the same.
pub(crate) fn earlier_name(name: &str) -> Option<&'static str> {
    // Renamed in ArduCopter 4.6.
    (name == "GPS1_TYPE").then_some("GPS_TYPE")
}

/// Parameter with the time without set-points \[s\] after which an autopilot of this kind acts by itself.
pub(super) fn time_out_parameter(kind: AutopilotKind) -> &'static str {
    match kind {
        AutopilotKind::ArduPilot => "GUID_TIMEOUT",
        AutopilotKind::Px4 => "COM_OF_LOSS_T",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_wire::mavlink::ParameterName;

    #[test]
    fn set_values_satisfy_the_rule_and_keep_other_bits() {
        for kind in [AutopilotKind::ArduPilot, AutopilotKind::Px4] {
            for wanted in wanted_parameters(kind) {
                assert!(ParameterName::new(wanted.name).is_some(), "{}", wanted.name);
                for found in [0.0, 1.0, 3.0, 100.0] {
                    let set = f64::from(wanted.value.in_place_of(found) as f32);
                    assert!(wanted.value.is_met_by(set), "{}: {set}", wanted.name);
                }
            }
        }
        assert_eq!(WantedValue::Bits(8).in_place_of(1.0), 9.0);
        assert!(!WantedValue::AtMost(0.1).is_met_by(3.0));
    }
}
