//! Messages between the processes: plain data in SI units, with unit and frame at every field.
//!
//! A message is sent as a typed [`Header`] and the bytes of its body. Both sides of a topic must have been built from the same
//! definitions: a service is opened with [`Message::SCHEMA`] as an attribute, and every header repeats it. Enumerations are sent
//! as `u8`, since a value from another process may be invalid; [`crate::code`] decodes them.

mod bodies;
mod control;
mod definition;
mod external;
mod field;
mod header;
mod schema;
#[cfg(test)]
mod tests;
mod vehicle;

pub use bodies::{
    CommandV1, HealthV1, InputV1, PoseV1, ReferenceV1, TelemetryV1, TimeAdvanceV1, TruthV1,
    TurnDoneV1, VehicleV1,
};
pub use control::{AS_STARTED, ControlRequestV1, ControlResponseV1, EventV1, NO_USER, UNCHANGED};
pub use external::{ExternalV1, StateV1};
pub use field::{Field, FieldType};
pub use header::{Header, Stamps};
pub use schema::{AnyMessage, FNV_OFFSET, Message, fnv1a};
pub(crate) use schema::{SHORT_DIGITS, short_digits};
