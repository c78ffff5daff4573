//! One configuration for all processes: built-in values, presets, a file, `OQTAL_*` variables, flags, in this order.
//!
//! Every set value has an origin (`FILE:LINE`, the variable, the flag), and values are applied one at a time, so that every error
//! names the line to correct.
//!
//! | file | subject |
//! |---|---|
//! | `config.rs` | the effective configuration, composed of layers |
//! | `check.rs` | the rules of the effective configuration |
//! | `camera_rate.rs` | settings for the rate at which cameras send poses |
//! | `setting.rs`, `layer.rs`, `preset.rs` | values with their origins, from flags, files, the environment, presets |
//! | `place.rs` | the instance in a configuration with errors |
//! | `follow.rs` | keys that follow those of another section |
//! | `renamed.rs`, `nearest_key.rs` | keys of earlier versions; the key that an unknown one was meant to be |
//! | `origin.rs`, `error.rs` | origins of values, and the error that names them |
//! | `reason.rs` | reasons of the TOML reader in plain words |
//! | `source.rs` | comments that name the files of a configuration |
//! | `text.rs` | files read as text |
//! | `airframe.rs` | values common to `[vehicle]` and `[plant]` |
//! | `disturbance.rs`, `period.rs` | timed disturbances; the period of disturbances and faults |
//! | the others | one section each |

mod airframe;
mod asctec;
mod bridge;
mod camera_rate;
mod check;
mod config;
mod crtp;
mod disturbance;
mod error;
mod external;
mod fault;
mod fence;
mod follow;
mod instance;
mod layer;
mod live;
mod mavlink;
mod mocap;
mod mocap_cameras;
mod mocap_room;
mod mocap_serve;
mod msp;
mod named_file;
mod nearest_key;
mod origin;
mod period;
mod place;
mod plant;
mod plant_wire;
mod preset;
mod realtime;
mod reason;
mod receiver;
mod record;
mod reference;
mod renamed;
mod safety;
mod setting;
mod source;
mod text;
mod vehicle;

pub use airframe::Interface;
pub use asctec::{AsctecLimits, AsctecOptions, AsctecSigns};
pub use bridge::BridgeOptions;
pub use camera_rate::CameraRateAdvice;
pub use config::{Config, DEFAULTS, refuse_thrust_alone};
pub use crtp::{CrtpOptions, CrtpVehicleOptions};
pub use disturbance::{DisturbanceKind, TimedDisturbance};
pub use error::ConfigError;
pub use external::{EnvelopeOptions, ExternalOptions};
pub use fault::{Fault, FaultKind, FaultOptions, FaultTarget, FaultUnit, Magnitude};
pub use fence::FenceOptions;
pub use instance::{ClockKind, ClockOptions, InstanceOptions, LogLevel, LogOptions};
pub use mavlink::{MavlinkOptions, PlantMavlinkOptions};
pub use mocap::{CaptureStamp, MocapModel, MocapOptions};
pub use mocap_cameras::{CameraOptions, MarkerOptions};
pub use mocap_room::RoomOptions;
pub use mocap_serve::ServeOptions;
pub use msp::MspOptions;
pub use plant::{BatteryOptions, Fidelity, PlantOptions, ProbeOptions, RotorLayout, RotorOptions};
pub use plant_wire::PlantWireOptions;
pub use realtime::{RealtimeOptions, Scheduling};
pub use receiver::{ReceiverOptions, StampSource, UpAxis};
pub use record::{RecordOptions, RecordedFlights};
pub use reference::ReferenceOptions;
pub use safety::SafetyOptions;
pub use setting::{Setting, parse_option};
pub use source::{
    CHAIN_COMMENT, COPY_COMMENT, edited_sources, edited_waypoints, flight_comment, flight_of,
    is_copy, is_of_chain, is_of_reload, kept_source_comments, reread_comments, source_comments,
    waypoints_comment,
};
pub use text::{read_text, read_waypoints};
pub use vehicle::VehicleOptions;
