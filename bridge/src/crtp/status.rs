//! State of a Crazyflie from its reports: battery, supervisor, gyroscope, its own estimate of its motion.

use oqtal_bus::time::{Span, Time};
use oqtal_control::euler::EulerAngles;
use oqtal_wire::crtp::{LogFields, Supervision};

use super::connection::{CrtpConnection, ESTIMATE_BLOCK, STATUS_BLOCK};
use super::names::{BATTERY, ESTIMATE, GYROSCOPE, MAX_NAMES, SUPERVISOR};

/// State of the vehicle.
#[derive(Clone, Copy, Debug)]
pub struct CrazyflieStatus {
    /// Arrival of the last report; unset before the first.
    pub reported_at: Time,
    values: [f64; MAX_NAMES],
}

/// Part of the state that a report updated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StatusUpdate {
    /// Battery, supervisor and gyroscope were reported.
    Status,
    /// The vehicle's estimate was reported.
    Estimate,
    /// No part: the report was not requested.
    Nothing,
}

impl CrazyflieStatus {
    /// State before the first report.
    pub const UNKNOWN: Self = Self { reported_at: Time::UNSET, values: [f64::NAN; MAX_NAMES] };

    /// Takes a report of log block `block`.
    pub fn take(
        &mut self,
        now: Time,
        (block, mut values): (u8, LogFields),
        connection: &CrtpConnection,
    ) -> StatusUpdate {
        if !connection.is_made(block) {
            return StatusUpdate::Nothing;
        }
        let mut read = self.values;
        for (place, kind) in connection.fields(block) {
            let Some(value) = values.next(kind) else { return StatusUpdate::Nothing };
            read[place] = value;
        }
        (self.values, self.reported_at) = (read, now);
        match block {
            STATUS_BLOCK => StatusUpdate::Status,
            ESTIMATE_BLOCK => StatusUpdate::Estimate,
            _ => StatusUpdate::Nothing,
        }
    }

    /// Whether reports have arrived, and none for longer than `silence`.
    pub fn is_silent(&self, now: Time, silence: Span) -> bool {
        self.reported_at.is_set() && now.since(self.reported_at) > silence
    }

    /// Battery voltage \[V\]; NaN if it is not reported, or reported as 0, which means not measured.
    pub fn battery_v(&self) -> f64 {
        let volts = self.values[BATTERY];
        if volts > 0.0 { volts } else { f64::NAN }
    }

    /// Bits of the supervisor; none before the first report.
    pub fn supervision(&self) -> Supervision {
        // `as` maps NaN to 0 and saturates numbers out of range.
        Supervision::from_wire(self.values[SUPERVISOR] as u16)
    }

    /// Body rate by the gyroscope \[rad/s, body\]; NaN if it is not reported. Its axes are ours: x forward, y left, z up.
    pub fn body_rate(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.values[GYROSCOPE + axis].to_radians())
    }

    /// Position \[m, world\] and attitude \[body to world\], scalar last, as the vehicle estimates them; `None` if it does not report
    /// them, or they are not finite.
    pub fn estimate(&self) -> Option<([f64; 3], [f64; 4])> {
        let values = &self.values[ESTIMATE..];
        let [x, y, z, roll, pitch, yaw, ..] = *values else { return None };
        let radians = [roll, -pitch, yaw].map(f64::to_radians);
        let is_finite = values.iter().all(|value| value.is_finite());
        let [roll, pitch, yaw] = radians;
        is_finite.then(|| ([x, y, z], EulerAngles { roll, pitch, yaw }.xyzw()))
    }
}
