//! Constant description for a page: names, room, cameras, and the meaning of columns and codes.

use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_config::{Config, FenceOptions, Interface};
use oqtal_control::controller::ControllerName;
use oqtal_control::trajectory::{Phase, TrajectoryKind};
use oqtal_observe::latency::{AIR, HOPS, WIRE};
use serde::Serialize;

use crate::row::{TICK_COLUMNS, VEHICLE_COLUMNS};

/// Constant description of the subject of a page.
#[derive(Clone, Debug, Serialize)]
pub struct SceneDescription {
    title: String,
    /// Hash of the configuration.
    config_hash: String,
    pub(crate) controller: String,
    trajectory: TrajectoryKind,
    /// Whether the page shows a running instance, not a recording.
    is_live: bool,
    /// Whether commands can be sent.
    has_control: bool,
    command_unit: &'static str,
    rate_hz: f64,
    battery_low_v: f64,
    faults: Vec<String>,
    fence: FenceBorder,
    cameras: Vec<CameraPlace>,
    tick_columns: Vec<&'static str>,
    vehicle_columns: Vec<&'static str>,
    hops: Vec<&'static str>,
    modes: Vec<String>,
    states: Vec<String>,
    /// Words by code; empty for unused codes.
    causes: Vec<String>,
    phases: Vec<String>,
    /// Gains that an operator can change in flight.
    gains: Vec<Gain>,
}

/// A gain of a law.
#[derive(Clone, Debug, Serialize)]
struct Gain {
    law: &'static str,
    /// Key in the configuration.
    key: String,
    low: f64,
    high: f64,
}

/// The fence.
#[derive(Clone, Debug, Serialize)]
struct FenceBorder {
    /// Corners in order \[m, world\].
    corners: Vec<[f64; 2]>,
    /// Lower and upper limit along z \[m, world\].
    z: [f64; 2],
}

/// An emulated camera.
#[derive(Clone, Debug, Serialize)]
struct CameraPlace {
    /// Position \[m, world\].
    position: [f64; 3],
    /// Point at which the camera is aimed \[m, world\].
    aim: [f64; 3],
    /// Horizontal field of view \[deg\].
    view: f64,
    /// Whether the camera is covered.
    is_covered: bool,
}

impl SceneDescription {
    /// The description of a running instance.
    pub fn of_instance(config: &Config, has_control: bool) -> Self {
        let gains = if has_control { gains() } else { Vec::new() };
        let constant = Self::of_recording(config, &config.instance.name);
        Self { is_live: true, has_control, gains, ..constant }
    }

    /// The description of the recording named `title`.
    pub fn of_recording(config: &Config, title: &str) -> Self {
        Self {
            title: title.to_owned(),
            config_hash: format!("{:016x}", config.hash()),
            controller: config.control.controller.name().to_owned(),
            trajectory: config.trajectory.kind,
            is_live: false,
            has_control: false,
            command_unit: match config.vehicle.interface {
                Interface::Rate => "sticks −1…1",
                Interface::Torque => "torque, N m",
                Interface::Attitude => "attitude, deg",
            },
            rate_hz: config.loop_rate_hz(),
            battery_low_v: config.safety.battery_low_v,
            faults: config.fault.inject.iter().map(ToString::to_string).collect(),
            fence: FenceBorder::of(&config.fence),
            cameras: cameras(config),
            tick_columns: TICK_COLUMNS.to_vec(),
            vehicle_columns: VEHICLE_COLUMNS.to_vec(),
            hops: [&HOPS[..], &[WIRE, AIR]].concat(),
            modes: codes(Mode::from_code),
            states: codes(SafetyState::from_code),
            causes: codes(Cause::from_code),
            phases: codes(Phase::from_number),
            gains: Vec::new(),
        }
    }
}

/// The tuned gains of every law, with their tuning ranges.
fn gains() -> Vec<Gain> {
    let of_law = |law: ControllerName| {
        law.tuned_gains().iter().map(move |range| {
            let key = format!("control.{}.{}", law.name(), range.key);
            Gain { law: law.name(), key, low: range.low, high: range.high }
        })
    };
    ControllerName::ALL.into_iter().flat_map(of_law).collect()
}

impl FenceBorder {
    fn of(fence: &FenceOptions) -> Self {
        let [[x0, x1], [y0, y1]] = [fence.x_m, fence.y_m];
        let corners = match fence.polygon_m.is_empty() {
            true => vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]],
            false => fence.polygon_m.clone(),
        };
        Self { corners, z: fence.z_m }
    }
}

/// Cameras of the configuration; none if poses come from a real camera system or a recording.
fn cameras(config: &Config) -> Vec<CameraPlace> {
    if config.is_replay() || !config.receiver.link.is_empty() {
        return Vec::new();
    }
    let cameras = &config.mocap.cameras;
    let places = cameras.positions_m.iter().zip(&cameras.aims_m).enumerate();
    places
        .map(|(index, (&position, &aim))| CameraPlace {
            position,
            aim,
            view: cameras.field_of_view_deg,
            is_covered: cameras.covered.contains(&(index + 1)),
        })
        .collect()
}

/// Words of the codes from 0 to the last used one.
fn codes<T: ToString>(from_code: impl Fn(u8) -> Option<T>) -> Vec<String> {
    let last = (0..=u8::MAX).rev().find(|code| from_code(*code).is_some()).unwrap_or(0);
    let word = |code| from_code(code).map_or_else(String::new, |value| value.to_string());
    (0..=last).map(word).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_have_the_words_of_the_program() {
        let scene = SceneDescription::of_instance(&Config::default(), false);
        assert_eq!(scene.modes[Mode::Landing.code() as usize], "landing");
        assert_eq!(
            scene.causes[Cause::OtherConfig.code() as usize],
            "another configuration expected"
        );
        assert_eq!(scene.causes[34], "");
        assert_eq!(scene.phases, ["", "take-off", "settle", "trajectory", "landing"]);
    }

    #[test]
    fn cameras_are_shown_where_they_are_known() {
        let mut config = Config::default();
        config.mocap.cameras.covered = vec![2];
        let covered = |config: &Config| {
            let cameras = SceneDescription::of_instance(config, false).cameras;
            cameras.iter().map(|camera| camera.is_covered).collect::<Vec<_>>()
        };
        assert_eq!(covered(&config), [false, true, false, false, false, false]);
        config.receiver.link = "vrpn:cameras,body=quad".to_owned();
        assert!(covered(&config).is_empty());
    }

    #[test]
    fn a_polygon_takes_the_place_of_the_ranges() {
        let mut config = Config::default();
        let corners = |config: &Config| SceneDescription::of_instance(config, false).fence.corners;
        assert_eq!(corners(&config).len(), 4);
        config.fence.polygon_m = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        assert_eq!(corners(&config), config.fence.polygon_m);
    }
}
