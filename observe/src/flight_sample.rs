//! One tick of a recorded flight.

use nalgebra::Vector3;
use oqtal_bus::code::{Mode, SafetyState};
use oqtal_bus::message::{TelemetryV1, TruthV1};
use oqtal_control::quaternion::Attitude;

/// One tick of the daemon with the true state of the vehicle.
#[derive(Clone, Copy, Debug)]
pub struct FlightSample {
    /// Telemetry of the tick.
    pub telemetry: TelemetryV1,
    /// Truth at the tick; `None` if there is none (a recording, a real vehicle).
    pub truth: Option<TruthV1>,
}

/// Age of the last pose above which an estimate does not describe the vehicle \[s\].
const LONGEST_AGE_S: f64 = 0.5;

impl FlightSample {
    /// Whether the vehicle was armed in this tick.
    pub fn is_armed(&self) -> bool {
        self.telemetry.is_armed()
    }

    /// Whether errors are computed over this tick.
    pub fn is_scored(&self) -> bool {
        self.is_armed() && self.telemetry.scored != 0
    }

    /// Whether the fence holds the vehicle: the trajectory waits.
    pub fn is_held(&self) -> bool {
        [self.telemetry.mode, self.telemetry.state]
            == [Mode::Flying.code(), SafetyState::Hold.code()]
    }

    /// Whether the daemon is ending the flight.
    pub fn is_ended_by_daemon(&self) -> bool {
        (SafetyState::Land.code()..SafetyState::Stop.code()).contains(&self.telemetry.state)
    }

    /// Whether the vehicle's motion is known: by the truth, or by an estimate from poses that still come.
    pub fn is_located(&self) -> bool {
        self.truth.is_some() || self.telemetry.pose_age_s <= LONGEST_AGE_S
    }

    /// Position of the vehicle \[m, world\]: the truth if there is one, otherwise the estimate.
    pub fn position(&self) -> Vector3<f64> {
        Vector3::from(self.truth.map_or(self.telemetry.position, |truth| truth.position))
    }

    /// Velocity of the vehicle \[m/s, world\]: the truth if there is one, otherwise the estimate.
    pub fn velocity(&self) -> Vector3<f64> {
        Vector3::from(self.truth.map_or(self.telemetry.velocity, |truth| truth.velocity))
    }

    /// Attitude of the vehicle \[body to world\]: the truth if there is one, otherwise the estimate.
    pub fn attitude(&self) -> Attitude {
        let numbers = self.truth.map_or(self.telemetry.attitude, |truth| truth.attitude);
        Attitude::from_xyzw(numbers).unwrap_or_default()
    }

    /// Commanded attitude \[body to world\].
    pub fn attitude_command(&self) -> Attitude {
        Attitude::from_xyzw(self.telemetry.attitude_command).unwrap_or_default()
    }

    /// Position minus reference \[m, world\]: at the tick by the truth; without a truth at the capture of the newest pose, to which the
    /// estimate belongs. There the reference is extrapolated back; in a tick in which its velocity jumps, this is wrong by up to the jump
    /// times the age of the pose.
    pub fn position_error(&self) -> Vector3<f64> {
        let reference = Vector3::from(self.telemetry.reference_position);
        let age_s = if self.truth.is_some() { 0.0 } else { self.telemetry.pose_age_s };
        let moved = Vector3::from(self.telemetry.reference_velocity) * age_s;
        // The velocity of the reference is unknown when not flying, the age before the first pose.
        let moved = if moved.iter().all(|m| m.is_finite()) { moved } else { Vector3::zeros() };
        self.position() - (reference - moved)
    }

    /// Velocity minus the velocity commanded by the position loops in the tick \[m/s, world\]. Without a truth the velocity is that at the
    /// capture of the newest pose, some 15 ms earlier; the same holds for the attitude in [`FlightSample::attitude_error`].
    pub fn velocity_error(&self) -> Vector3<f64> {
        self.velocity() - Vector3::from(self.telemetry.velocity_command)
    }

    /// Rotation from the attitude commanded in the tick to the attitude \[rad, commanded body axes\].
    pub fn attitude_error(&self) -> Vector3<f64> {
        self.attitude_command().rotation_to(&self.attitude())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_estimate_is_compared_with_the_reference_at_its_capture() {
        let telemetry = TelemetryV1 {
            position: [0.97, 0.0, 1.0],
            reference_position: [1.0, 0.0, 1.0],
            reference_velocity: [2.0, 0.0, 0.0],
            pose_age_s: 0.015,
            ..TelemetryV1::default()
        };
        let mut sample = FlightSample { telemetry, truth: None };
        assert!(sample.position_error().norm() < 1e-9, "it followed exactly");
        sample.telemetry.reference_velocity = [f64::NAN; 3];
        assert!((sample.position_error().x + 0.03).abs() < 1e-9);
        let position = telemetry.reference_position;
        sample.truth = Some(TruthV1 { position, ..TruthV1::default() });
        assert_eq!(sample.position_error().norm(), 0.0);
    }
}
