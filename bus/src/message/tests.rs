//! Tests of the field tables, of the schemas and of the encoding.

use std::collections::BTreeSet;

use super::definition::{message, structure};
use super::field::{Value, total_size};
use super::header::HEADER_SCHEMA;
use super::schema::schema;
use super::*;
use crate::time::Time;

/// Every unit that a field may have.
const UNITS: [&str; 27] = [
    "-",
    "code",
    "flag",
    "text",
    "ns",
    "s",
    "m",
    "V",
    "0..1",
    "m, world",
    "m/s, world",
    "m/s^2, world",
    "m/s^3, world",
    "rad/s, world",
    "body to world",
    "rad/s, body",
    "rad, body",
    "N m, body",
    "-, body",
    "-1..1, body",
    "rad, world",
    "N, body",
    "-1..1 or N m, body",
    "rad/s or rad/s^2, body",
    "m/s^2",
    "N",
    "kg",
];

/// Name, schema and table of every message.
fn all() -> Vec<(&'static str, u64, &'static [Field])> {
    fn entry<M: Message>() -> (&'static str, u64, &'static [Field]) {
        (std::any::type_name::<M>(), M::SCHEMA, M::FIELDS)
    }
    vec![
        entry::<TruthV1>(),
        entry::<PoseV1>(),
        entry::<CommandV1>(),
        entry::<VehicleV1>(),
        entry::<TelemetryV1>(),
        entry::<InputV1>(),
        entry::<StateV1>(),
        entry::<ExternalV1>(),
        entry::<ReferenceV1>(),
        entry::<EventV1>(),
        entry::<HealthV1>(),
        entry::<ControlRequestV1>(),
        entry::<ControlResponseV1>(),
        entry::<TimeAdvanceV1>(),
        entry::<TurnDoneV1>(),
    ]
}

#[test]
fn every_schema_differs() {
    let distinct: BTreeSet<u64> = all().iter().map(|(_, schema, _)| *schema).collect();
    assert_eq!(distinct.len(), all().len());
}

#[test]
fn every_field_has_a_unit_and_a_description() {
    for (message, _, fields) in all() {
        for field in fields {
            assert!(UNITS.contains(&field.unit), "{message}.{}: `{}`", field.name, field.unit);
            assert!(!field.doc.is_empty(), "{message}.{} has no description", field.name);
            let is_byte = field.element == FieldType::U8;
            assert_eq!(
                is_byte,
                ["code", "flag", "text"].contains(&field.unit),
                "{message}.{}",
                field.name
            );
        }
    }
}

message! {
    /// A message for tests.
    ProbeV1 = "oqtal.Probe.v1" {
        /// A number.
        number: u8 ["code"],
        /// A vector
        /// over two lines.
        vector: [f64; 3] ["m, world"],
        /// An instant.
        time: Time ["ns"],
    }
}

const PROBE: ProbeV1 =
    ProbeV1 { number: 0xfe, vector: [1.0, -2.5, f64::MAX], time: Time::from_nanos(0x0102_0304) };

#[test]
fn a_schema_covers_the_header_and_the_stamps_before_the_body() {
    let stamps = "oqtal.Stamps.v1;captured_at:Time:ns;pose_received_at:Time:ns;pose_published_at:Time:ns;woken_at:Time:ns;computed_at:Time:ns;\
                  command_published_at:Time:ns;received_at:Time:ns;applied_at:Time:ns";
    let header = "oqtal.Header.v1;sequence:u64:-;pose_sequence:u64:-;schema:u64:-;source:u64:-";
    let body = "oqtal.Probe.v1;number:u8:code;vector:[f64; 3]:m, world;time:Time:ns";
    assert_eq!(ProbeV1::SCHEMA, fnv1a(FNV_OFFSET, [stamps, header, body].concat().as_bytes()));
}

#[test]
fn a_table_gives_the_offset_of_each_field() {
    let mut bytes = [0; ProbeV1::SIZE];
    PROBE.encode(&mut bytes);
    let [number, vector, time] = ProbeV1::FIELDS else { panic!("{:?}", ProbeV1::FIELDS) };
    assert_eq!((number.size(), vector.size(), time.size()), (1, 24, 8));
    assert_eq!((vector.name, vector.length, vector.unit), ("vector", 3, "m, world"));
    assert_eq!(vector.doc, "A vector over two lines.");
    assert_eq!(bytes[0], 0xfe);
    assert_eq!(bytes[9..17], (-2.5_f64).to_le_bytes());
    assert_eq!(bytes[25..], [4, 3, 2, 1, 0, 0, 0, 0]);
}

#[test]
fn a_body_survives_its_encoding() {
    let mut bytes = [0; ProbeV1::SIZE];
    PROBE.encode(&mut bytes);
    assert_eq!(ProbeV1::decode(&bytes), PROBE);
}

#[test]
fn a_request_is_repeated_while_the_vehicle_only_moves() {
    use crate::code::{Answer, Cause};
    use crate::obstacle::{ArmingObstacle, ArmingObstacles};
    let comes_to_rest = |obstacles: &[ArmingObstacle]| {
        let add = |set: ArmingObstacles, it: &ArmingObstacle| set.with(*it, true);
        let obstacles = obstacles.iter().fold(ArmingObstacles::default(), add).bits();
        let (answer, cause) = (Answer::Refused.code(), Cause::NotReady.code());
        ControlResponseV1 { answer, cause, obstacles, ..Default::default() }.comes_to_rest()
    };
    assert!(comes_to_rest(&[ArmingObstacle::Moving]), "also after a landing");
    assert!(!comes_to_rest(&[ArmingObstacle::Moving, ArmingObstacle::OutsideFence]));
    assert!(comes_to_rest(&[ArmingObstacle::Stopped, ArmingObstacle::Tilted]));
    assert!(!comes_to_rest(&[ArmingObstacle::Tilted]) && !comes_to_rest(&[]));
}
