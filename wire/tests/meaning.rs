//! Conversion between counts and SI units: against figures of the sources, and there and back.

use std::f64::consts::{FRAC_PI_2, PI};

use oqtal_wire::asctec::{
    AxisSigns, ControlInput, CountLimits, FULL_STICK, FULL_THRUST, Imu, ImuCalc, LlStatus, Scales,
    Status, StickMeaning, Sticks, ThrustTable,
};
use proptest::prelude::*;

const STRAIGHT: AxisSigns = AxisSigns { roll: 1, pitch: 1, yaw: 1 };

fn rates() -> Scales {
    Scales { command_signs: STRAIGHT, telemetry_signs: STRAIGHT, ..Scales::default() }
}

fn attitude() -> Scales {
    Scales { sticks: StickMeaning::Attitude, ..rates() }
}

fn sign() -> impl Strategy<Value = i8> {
    prop::sample::select(vec![-1_i8, 1])
}

fn scales() -> impl Strategy<Value = Scales> {
    let meaning = prop::sample::select(vec![StickMeaning::BodyRate, StickMeaning::Attitude]);
    (meaning, sign(), sign(), sign()).prop_map(|(sticks, roll, pitch, yaw)| {
        let signs = AxisSigns { roll, pitch, yaw };
        Scales { sticks, command_signs: signs, telemetry_signs: signs, ..Scales::default() }
    })
}

fn counts() -> impl Strategy<Value = ControlInput> {
    let stick = || -FULL_STICK..=FULL_STICK;
    (stick(), stick(), stick(), 0..=FULL_THRUST).prop_map(|(pitch, roll, yaw, thrust)| {
        ControlInput { pitch, roll, yaw, thrust, enabled: ControlInput::ENABLE_ALL }
    })
}

#[test]
fn a_full_stick_is_2047_counts() {
    let sticks = Sticks { roll: 1.0, pitch: -1.0, yaw: 0.5, thrust: 1.0 };
    let input = rates().encode(&sticks);
    assert_eq!((input.roll, input.pitch, input.yaw, input.thrust), (2047, -2047, 1024, 4095));
    assert_eq!(input.enabled, 0b1111);
}

#[test]
fn an_attitude_is_40_counts_a_degree_and_its_yaw_rate_8_and_a_third() {
    let degrees = |angle: f64| angle.to_radians();
    let sticks =
        Sticks { roll: degrees(10.0), pitch: degrees(-5.0), yaw: degrees(90.0), thrust: 0.0 };
    let input = attitude().encode(&sticks);
    assert_eq!((input.roll, input.pitch, input.yaw), (400, -200, 750));
    // Full scale: 51.2 deg and 245.6 deg/s.
    let full =
        attitude().decode(&ControlInput { roll: 2047, yaw: 2047, ..ControlInput::ZERO_SETPOINT });
    assert!((full.roll.to_degrees() - 51.2).abs() < 0.05);
    assert!((full.yaw.to_degrees() - 245.6).abs() < 0.05);
}

#[test]
fn signs_are_those_that_are_set() {
    let sticks = Sticks { roll: 0.5, pitch: 0.5, yaw: 0.5, thrust: 0.1 };
    let input = Scales::default().encode(&sticks);
    assert_eq!((input.roll, input.pitch, input.yaw), (-1024, 1024, -1024));
}

#[test]
fn limits_hold_on_every_axis_on_its_own() {
    let limit_counts = CountLimits { roll: 300, pitch: 301, yaw: 600, thrust: 2200 };
    let scales = Scales { limit_counts, ..rates() };
    let input = scales.encode(&Sticks { roll: 1.0, pitch: -1.0, yaw: 7.0, thrust: 1.0 });
    assert_eq!((input.roll, input.pitch, input.yaw, input.thrust), (300, -301, 600, 2200));
}

#[test]
fn a_value_that_is_not_finite_gives_the_zero_set_point() {
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let good = Sticks { roll: 0.1, pitch: 0.2, yaw: 0.3, thrust: 0.4 };
        for sticks in [
            Sticks { roll: wrong, ..good },
            Sticks { pitch: wrong, ..good },
            Sticks { yaw: wrong, ..good },
            Sticks { thrust: wrong, ..good },
        ] {
            assert_eq!(Scales::default().encode(&sticks), ControlInput::ZERO_SETPOINT);
        }
    }
}

#[test]
fn the_motor_switch_is_that_of_asctec_drivers_and_is_recognised() {
    let scales = Scales::default();
    let switch = scales.motor_switch();
    assert_eq!((switch.yaw, switch.thrust, switch.enabled), (-2047, 0, 0b1100));
    assert!(scales.is_motor_switch(&switch));
    assert!(!scales.is_motor_switch(&ControlInput { yaw: 2047, ..switch }));
    assert!(!scales.is_motor_switch(&ControlInput { yaw: -2046, ..switch }));
    assert!(!scales.is_motor_switch(&ControlInput { thrust: 1, ..switch }));
    assert!(!scales.is_motor_switch(&ControlInput::ZERO_SETPOINT));
}

#[test]
fn the_default_thrust_is_the_square_of_the_counts() {
    let table = ThrustTable::default();
    table.check().unwrap();
    for (delta, counts) in [(0.0, 0.0), (0.25, 2048.0), (0.49, 2867.0), (1.0, 4095.0)] {
        assert!((table.counts(delta) - counts).abs() <= 0.5, "{delta}: {}", table.counts(delta));
    }
    assert_eq!((table.counts(-0.1), table.counts(1.1)), (0.0, 4095.0));
    assert_eq!((table.delta(-1.0), table.delta(5000.0)), (0.0, 1.0));
    // Halfway between two points of the table.
    let table = ThrustTable(vec![[0.0, 1000.0], [0.5, 2000.0], [1.0, 4000.0]]);
    assert_eq!((table.counts(0.75), table.delta(1500.0)), (3000.0, 0.25));
}

#[test]
fn scales_that_cannot_be_used_are_named() {
    let refused = |scales: Scales| scales.check().unwrap_err().to_string();
    let table = |points: &[[f64; 2]]| Scales {
        thrust_table: ThrustTable(points.to_vec()),
        ..Scales::default()
    };
    assert_eq!(Scales::default().check(), Ok(()));
    for (scales, named) in [
        (Scales { angle_per_count_mdeg: 0.0, ..rates() }, "angle-per-count-mdeg must lie"),
        (Scales { yaw_rate_per_count_mdeg_s: f64::NAN, ..rates() }, "yaw-rate-per-count-mdeg-s"),
        (Scales { command_signs: AxisSigns { roll: 0, ..STRAIGHT }, ..rates() }, "command-signs"),
        (
            Scales { telemetry_signs: AxisSigns { yaw: 2, ..STRAIGHT }, ..rates() },
            "telemetry-signs",
        ),
        (
            Scales { limit_counts: CountLimits { yaw: 2048, ..CountLimits::default() }, ..rates() },
            "limit-",
        ),
        (
            Scales { limit_counts: CountLimits { thrust: 0, ..CountLimits::default() }, ..rates() },
            "limit-",
        ),
        (Scales { motor_yaw_counts: 0, ..rates() }, "motor-yaw-counts"),
        (Scales { motor_yaw_counts: -2048, ..rates() }, "motor-yaw-counts"),
        (table(&[[0.0, 0.0]]), "2 to 256 points"),
        (table(&[[0.0, 0.0], [0.5, 0.0]]), "must rise"),
        (table(&[[0.5, 0.0], [0.5, 10.0]]), "must rise"),
        (table(&[[0.0, 0.0], [1.0, 4096.0]]), "counts in 0..4095"),
        (table(&[[f64::NAN, 0.0], [1.0, 10.0]]), "delta in -1..1"),
    ] {
        let message = refused(scales);
        assert!(message.contains(named), "{message}");
    }
}

#[test]
fn scales_are_read_from_kebab_case_and_unknown_keys_are_refused() {
    let text = "sticks = 'attitude'\nmotor-yaw-counts = 2047\nthrust-table = [[0, 0], [1, 4000]]\n\
                command-signs = { roll = 1, pitch = -1, yaw = 1 }";
    let scales: Scales = toml::from_str(text).unwrap();
    let command_signs = AxisSigns { roll: 1, pitch: -1, yaw: 1 };
    let thrust_table = ThrustTable(vec![[0.0, 0.0], [1.0, 4000.0]]);
    let motor_yaw_counts = 2047;
    let wanted = Scales { command_signs, thrust_table, motor_yaw_counts, ..attitude() };
    assert_eq!(scales, Scales { telemetry_signs: AxisSigns::default(), ..wanted });
    let written = toml::to_string(&scales).unwrap();
    assert_eq!(toml::from_str::<Scales>(&written).unwrap(), scales);
    assert!(toml::from_str::<Scales>("k-stick = 25").is_err());
}

#[test]
fn inertial_measurements_are_si_in_body_axes() {
    let wire = ImuCalc {
        angle_roll: 10_000,
        angle_nick: -20_000,
        angle_yaw: 90_000,
        rate_roll: 648,
        rate_yaw: -648,
        height: 1500,
        climb: -250,
        ..ImuCalc::default()
    };
    let imu = Scales::default().decode_imu(&wire);
    let wanted = [-10_f64, -20.0, -90.0].map(f64::to_radians);
    assert!(imu.angles.iter().zip(wanted).all(|(angle, wanted)| (angle - wanted).abs() < 1e-12));
    let wanted = [-10_f64, 0.0, 10.0].map(f64::to_radians);
    assert!(imu.rate.iter().zip(wanted).all(|(rate, wanted)| (rate - wanted).abs() < 1e-12));
    assert_eq!((imu.height, imu.climb), (1.5, -0.25));
}

proptest! {
    #[test]
    fn counts_come_back_as_they_went(scales in scales(), input in counts()) {
        prop_assume!(input.thrust > 0);
        prop_assert_eq!(scales.encode(&scales.decode(&input)), input);
    }

    #[test]
    fn sticks_come_back_within_half_a_count(
        scales in scales(),
        [roll, pitch, yaw] in prop::array::uniform3(-0.8..0.8_f64),
        thrust in 0.01..=1.0_f64,
    ) {
        let sent = Sticks { roll, pitch, yaw, thrust };
        let input = scales.encode(&sent);
        let received = scales.decode(&input);
        let count = scales.decode(&ControlInput { roll: 1, yaw: 1, ..ControlInput::ZERO_SETPOINT });
        let (angle, rate) = (0.5001 * count.roll.abs(), 0.5001 * count.yaw.abs());
        prop_assert!((received.roll - roll).abs() <= angle && (received.pitch - pitch).abs() <= angle);
        prop_assert!((received.yaw - yaw).abs() <= rate);
        let counts = scales.thrust_table.counts(received.thrust);
        prop_assert!((counts - scales.thrust_table.counts(thrust)).abs() <= 0.5001);
    }

    #[test]
    fn for_any_sticks_the_counts_are_in_range(
        scales in scales(),
        [roll, pitch, yaw, thrust] in prop::array::uniform4(any::<f64>()),
    ) {
        let input = scales.encode(&Sticks { roll, pitch, yaw, thrust });
        prop_assert!(input.in_range(), "{input:?}");
    }

    #[test]
    fn no_flight_command_is_the_motor_switch(
        scales in scales(),
        switch in (1..=FULL_STICK, sign()).prop_map(|(counts, sign)| counts * i16::from(sign)),
        yaw in -10.0..10.0_f64,
        thrust in prop_oneof![Just(0.0), -1e-6..1e-6, -0.1..1.0_f64],
    ) {
        let scales = Scales { motor_yaw_counts: switch, ..scales };
        let input = scales.encode(&Sticks { yaw, thrust, ..Sticks::default() });
        prop_assert!(!scales.is_motor_switch(&input), "{input:?}");
    }

    #[test]
    fn more_thrust_is_never_fewer_counts(low in -1.0..1.0_f64, more in 0.0..1.0_f64) {
        let table = ThrustTable::default();
        prop_assert!(table.counts(low + more) >= table.counts(low));
    }

    #[test]
    fn a_status_comes_back(millivolts in 0..15_000_i16, motors_on: bool, flying: bool) {
        let status = Status { battery_v: f64::from(millivolts) / 1000.0, motors_on, flying };
        let wire = LlStatus::from(status);
        prop_assert_eq!(wire.battery_1_mv, millivolts);
        prop_assert_eq!(Status::from(wire), status);
    }

    #[test]
    fn inertial_measurements_come_back(
        scales in scales(),
        ([roll, pitch], yaw) in (prop::array::uniform2(-FRAC_PI_2..FRAC_PI_2), -PI..PI),
        rate in prop::array::uniform3(-5.0..5.0_f64),
        [height, climb] in prop::array::uniform2(-5.0..5.0_f64),
    ) {
        let sent = Imu { angles: [roll, pitch, yaw], rate, height, climb };
        let received = scales.decode_imu(&scales.encode_imu(&sent));
        for (angle, wanted) in received.angles.into_iter().zip(sent.angles) {
            let off = (angle - wanted).rem_euclid(2.0 * PI);
            prop_assert!(off.min(2.0 * PI - off) < 1e-5);
        }
        let off = |axis: usize| (received.rate[axis] - sent.rate[axis]).abs();
        prop_assert!((0..3).all(|axis| off(axis) < 1.4e-4));
        prop_assert!((received.height - height).abs() < 6e-4 && (received.climb - climb).abs() < 6e-4);
    }
}
