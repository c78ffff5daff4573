//! The desired motion at one time of a flight.

use std::fmt;

use nalgebra::Vector3;

use crate::tracking_error::AttitudeReference;

/// The desired motion at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// Desired position \[m, world\].
    pub position: Vector3<f64>,
    /// Desired velocity \[m/s, world\]; zero where the position jumps.
    pub velocity: Vector3<f64>,
    /// Desired acceleration \[m/s^2, world\], for laws that feed it forward, like jerk and snap.
    pub acceleration: Vector3<f64>,
    /// Desired jerk \[m/s^3, world\].
    pub jerk: Vector3<f64>,
    /// Desired snap \[m/s^4, world\].
    pub snap: Vector3<f64>,
    /// Desired 3-2-1 yaw \[rad\].
    pub yaw_rad: f64,
    /// Rate of the desired yaw \[rad/s\]; zero where the yaw jumps. Used, like its acceleration, by laws with feed-forward.
    pub yaw_rate_rad_s: f64,
    /// Acceleration of the desired yaw \[rad/s^2\].
    pub yaw_acceleration_rad_s2: f64,
    /// Prescribed attitude in place of the horizontal position, with rate and acceleration for laws that feed them forward.
    pub attitude: Option<AttitudeReference>,
    /// Phase of the flight.
    pub phase: Phase,
}

impl Reference {
    /// A reference at rest at `position` \[m, world\], at zero yaw.
    pub fn rest(position: Vector3<f64>, phase: Phase) -> Self {
        Self::moving(
            [position, Vector3::zeros(), Vector3::zeros(), Vector3::zeros(), Vector3::zeros()],
            phase,
        )
    }

    /// A reference with this position and its first four derivatives \[m, s, world\], at zero yaw.
    pub fn moving(course: [Vector3<f64>; 5], phase: Phase) -> Self {
        let [position, velocity, acceleration, jerk, snap] = course;
        Self {
            position,
            velocity,
            acceleration,
            jerk,
            snap,
            yaw_rad: 0.0,
            yaw_rate_rad_s: 0.0,
            yaw_acceleration_rad_s2: 0.0,
            attitude: None,
            phase,
        }
    }

    /// The yaw with its first two derivatives \[rad, s\], extrapolated by `dt_s` \[s\].
    pub fn yaw_after(&self, dt_s: f64) -> [f64; 3] {
        let (rate, acceleration) = (self.yaw_rate_rad_s, self.yaw_acceleration_rad_s2);
        let yaw_rad = self.yaw_rad + (rate + acceleration * (dt_s / 2.0)) * dt_s;
        [yaw_rad, rate + acceleration * dt_s, acceleration]
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        let vectors = [self.position, self.velocity, self.acceleration, self.jerk, self.snap];
        vectors.iter().flatten().all(|number| number.is_finite())
            && self.yaw_after(1.0).iter().all(|number| number.is_finite())
            && self.attitude.is_none_or(|attitude| attitude.is_finite())
    }
}

/// Phase of a flight, in order of time. The numbers are used in messages and recordings and never change; 0 is not
/// used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Phase {
    /// Take-off, from the floor to the hover point.
    TakeOff = 1,
    /// At rest at the hover point.
    Settle = 2,
    /// The trajectory under test.
    Trajectory = 3,
    /// Down to the floor.
    Landing = 4,
}

impl Phase {
    /// The phase of that number.
    pub fn from_number(number: u8) -> Option<Self> {
        [Self::TakeOff, Self::Settle, Self::Trajectory, Self::Landing]
            .into_iter()
            .find(|phase| *phase as u8 == number)
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::TakeOff => "take-off",
            Self::Settle => "settle",
            Self::Trajectory => "trajectory",
            Self::Landing => "landing",
        })
    }
}
