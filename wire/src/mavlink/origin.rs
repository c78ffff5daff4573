//! SET_GPS_GLOBAL_ORIGIN: the place on earth of the world's origin. Arbitrary, but an estimator without GPS wants one. The command
//! that supersedes the message is not known to the autopilots that need it.
#![expect(
    deprecated,
    reason = "autopilots in service know the message and not the command that supersedes it"
)]

use mavlink::dialects::common::{MavMessage, SET_GPS_GLOBAL_ORIGIN_DATA};

/// On no pole, and where autopilots have a model of the magnetic field \[1e-7 deg, mm\].
const ORIGIN: (i32, i32, i32) = (473_977_419, 85_455_938, 488_000);

/// The message to `system`.
pub(super) fn message(system: u8) -> MavMessage {
    let (latitude, longitude, altitude) = ORIGIN;
    MavMessage::SET_GPS_GLOBAL_ORIGIN(SET_GPS_GLOBAL_ORIGIN_DATA {
        latitude,
        longitude,
        altitude,
        target_system: system,
        ..SET_GPS_GLOBAL_ORIGIN_DATA::DEFAULT
    })
}

/// The system to which `message` is sent; `None` if it is another message.
pub(super) fn system(message: &MavMessage) -> Option<u8> {
    match message {
        MavMessage::SET_GPS_GLOBAL_ORIGIN(origin) => Some(origin.target_system),
        _ => None,
    }
}
