//! Tests of the emulated cameras, of recordings, of the served camera systems, and of the program.

mod camera_peers;
mod cameras;
mod markers;
mod program;
mod recording_properties;
mod recordings;
mod room;
mod serve;
mod served;
mod turns;

use nalgebra::Vector3;
use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, MocapOptions, Setting};
use oqtal_control::quaternion::Attitude;

/// `[mocap]` with the defaults and these values.
fn mocap(settings: &[(&str, toml::Value)]) -> MocapOptions {
    let setting = |(key, value): &(&str, toml::Value)| {
        Setting::flag("test", &format!("mocap.{key}"), value.clone())
    };
    Config::from_settings(&settings.iter().map(setting).collect::<Vec<_>>()).unwrap().mocap
}

/// The truth at `frame` of a body at rest, at `position` \[m, world\] and turned by `rotation` \[rad\].
fn at_rest(frame: u64, position: [f64; 3], rotation: [f64; 3]) -> TruthV1 {
    TruthV1 {
        time: Time::VIRTUAL_START + Span::from_seconds(frame as f64 / 60.0),
        capture: frame,
        position,
        attitude: Attitude::from_rotation_vector(Vector3::from(rotation)).xyzw(),
        ..TruthV1::default()
    }
}
