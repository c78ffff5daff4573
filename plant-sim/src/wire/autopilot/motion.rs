//! Set-points of the emulated autopilot, and its behaviour without them.

use oqtal_bus::message::{CommandV1, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Interface};
use oqtal_control::euler::EulerAngles;
use oqtal_control::options::OptionError;
use oqtal_control::quaternion::Attitude;
use oqtal_wire::ThrustCurve;
use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::{AttitudeTarget, SetpointKind};

use crate::wire::command::{angles, attitude_command, rate_command};

/// Height below which the vehicle may have landed \[m\].
const FLOOR_M: f64 = 0.05;
/// Time below that height after which the vehicle counts as landed.
const LANDED_AFTER: Span = Span::from_millis(1000);
/// Gain from tilt to body rate of a vehicle that levels itself \[1/s\].
const LEVELLING: f64 = 4.0;
/// Thrust over weight with which PX4 sinks without a pilot's sticks \[-\].
const SINKING: f64 = 0.96;

/// Set-points, and their time-out.
#[derive(Debug)]
pub(super) struct SetpointFollower {
    kind: AutopilotKind,
    thrust: ThrustCurve,
    holds_attitude: bool,
    authority: [f64; 3],
    /// Hover thrust as a share of the greatest \[-\].
    hover: f64,
    newest: Option<(Time, AttitudeTarget)>,
    low_since: Option<Time>,
}

impl SetpointFollower {
    /// Follower of the simulated vehicle of `config`.
    pub(super) fn new(config: &Config, kind: AutopilotKind) -> Result<Self, OptionError> {
        let plant = &config.plant;
        let thrust = ThrustCurve::new(&plant.wire.mavlink.thrust_table).map_err(|error| {
            OptionError::new("plant.wire.mavlink.thrust-table", "unusable", error.to_string())
        })?;
        Ok(Self {
            kind,
            thrust,
            holds_attitude: plant.interface == Interface::Attitude,
            authority: plant.rate_authority_rad_s,
            hover: plant.mass_kg * plant.gravity_m_s2 / plant.max_thrust_n,
            newest: None,
            low_since: None,
        })
    }

    /// Takes a set-point; ignores one that is not finite.
    pub(super) fn take(&mut self, now: Time, target: &AttitudeTarget) {
        let is_finite = match target.kind {
            SetpointKind::Rates(rates) => rates.iter().all(|rate| rate.is_finite()),
            // ArduCopter: "The body rates are ill-defined".
            SetpointKind::Attitude { .. } if self.kind == AutopilotKind::ArduPilot => false,
            SetpointKind::Attitude { attitude, .. }
            | SetpointKind::AttitudeAndRates { attitude, .. } => {
                Attitude::from_xyzw(attitude).is_some()
            }
        };
        if is_finite && target.thrust.is_finite() {
            self.newest = Some((now, *target));
        }
    }

    /// Whether the age of the newest set-point is at most `age`.
    pub(super) fn flows(&self, now: Time, age: Span) -> bool {
        self.newest.is_some_and(|(at, _)| now.since(at) <= age)
    }

    /// Begins a flight at `now`: the vehicle has not yet detected that it stands.
    pub(super) fn begin(&mut self, now: Time) {
        self.low_since = self.low_since.map(|_| now);
    }

    /// Takes the height \[m, world z\], by which the vehicle detects that it has landed.
    pub(super) fn watch_height(&mut self, now: Time, height_m: f64) {
        self.low_since = if height_m < FLOOR_M { self.low_since.or(Some(now)) } else { None };
    }

    /// Whether the vehicle has detected that it stands.
    pub(super) fn has_landed(&self, now: Time) -> bool {
        self.low_since.is_some_and(|since| now.since(since) >= LANDED_AFTER)
    }

    /// Command for running motors: by set-points if `follows`, otherwise by the autopilot.
    pub(super) fn command(&self, now: Time, truth: &TruthV1, follows: bool) -> CommandV1 {
        match &self.newest {
            Some((_, target)) if follows => self.flight(target, truth),
            // Armed and not yet flown: the rotors idle.
            None => self.level(truth, 0.0),
            Some(_) if self.has_landed(now) => self.level(truth, 0.0),
            Some(_) if self.kind == AutopilotKind::Px4 => self.level(truth, SINKING * self.hover),
            Some(_) => self.level(truth, self.hover),
        }
    }

    fn flight(&self, target: &AttitudeTarget, truth: &TruthV1) -> CommandV1 {
        let thrust = self.thrust.delta(target.thrust);
        match target.kind {
            SetpointKind::Rates(rates) if !self.holds_attitude => {
                rate_command(rates, self.authority, thrust)
            }
            // A vehicle whose interface is the attitude stays level if it receives rates.
            SetpointKind::Rates(_) => self.level(truth, thrust),
            SetpointKind::Attitude { attitude, .. }
            | SetpointKind::AttitudeAndRates { attitude, .. } => attitude_command(attitude, thrust),
        }
    }

    /// Level at the present heading and at this thrust.
    fn level(&self, truth: &TruthV1, thrust: f64) -> CommandV1 {
        if self.holds_attitude {
            let EulerAngles { yaw, .. } = angles(truth.attitude);
            return attitude_command(EulerAngles { yaw, ..EulerAngles::default() }.xyzw(), thrust);
        }
        let [x, y, ..] = truth.attitude;
        rate_command([-2.0 * LEVELLING * x, -2.0 * LEVELLING * y, 0.0], self.authority, thrust)
    }
}

#[cfg(test)]
mod tests {
    use oqtal_wire::mavlink::MavlinkAddress;

    use super::*;

    #[test]
    fn a_vehicle_that_holds_attitudes_levels_at_its_heading() {
        let mut config = Config::default();
        config.plant.interface = Interface::Attitude;
        let mut follower = SetpointFollower::new(&config, AutopilotKind::Px4).unwrap();
        let now = Time::VIRTUAL_START;
        let attitude = EulerAngles { roll: 0.2, pitch: -0.1, yaw: 2.0 }.xyzw();
        let truth = TruthV1 { attitude, ..TruthV1::default() };
        let is_level = |command: CommandV1| {
            let EulerAngles { roll, pitch, yaw } = angles(command.attitude);
            assert!(roll.abs() < 1e-9 && pitch.abs() < 1e-9 && (yaw - 2.0).abs() < 1e-9, "{yaw}");
        };
        is_level(follower.command(now, &truth, false));
        let (kind, target) = (SetpointKind::Rates([0.0; 3]), MavlinkAddress::default());
        follower.take(now, &AttitudeTarget { target, time_ms: 0, kind, thrust: 0.5 });
        is_level(follower.command(now, &truth, true));
        is_level(follower.command(now, &truth, false));
    }
}
