//! Conversion between counts and SI units, radians, body axes x forward, y left, z up.
//!
//! | count | unit | source |
//! |---|---|---|
//! | stick as a body rate | 1/2047 of the rate at full stick | Eq. (61) |
//! | stick as an angle | `K_stick` 25 mdeg, so 40 counts per degree | asctec_mav_framework |
//! | yaw stick beside it | `K_stick_yaw` 120 mdeg/s | asctec_mav_framework; asctec_drivers has 254.760 deg/s at full stick, 124.5 |
//! | thrust | by a table, see [`ThrustTable`] | the paper, section VII.A |
//!
//! Signs: asctec_drivers negates roll and yaw of the telemetry to reach these axes, and sends commands unchanged;
//! asctec_mav_framework calls the 2012 firmware's axes north-east-down. Signs are therefore configured: check which way the vehicle
//! tilts before it flies.

use serde::{Deserialize, Serialize};

use super::invalid_scale::InvalidScale;
use super::{ControlInput, FULL_STICK, FULL_THRUST, ImuCalc, LlStatus, ThrustTable};

/// Scale of the body rates in `IMU_CALCDATA` \[counts per deg/s\].
const RATE_COUNTS_PER_DEG_S: f64 = 64.8;

/// Quantity that the roll and pitch sticks command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StickMeaning {
    /// Body rate, as a fraction of the rate at full stick, Eq. (61): the paper's vehicle.
    #[default]
    BodyRate,
    /// Angle; yaw is a rate: a Hummingbird with AutoPilot.
    Attitude,
}

/// Stick positions and thrust, in body axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sticks {
    /// Roll, about x: `delta_r` \[-1..1\] if sticks are body rates, else the roll angle \[rad\].
    pub roll: f64,
    /// Pitch, about y: `delta_p` \[-1..1\] if sticks are body rates, else the pitch angle \[rad\].
    pub pitch: f64,
    /// Yaw, about z: `delta_y` \[-1..1\] if sticks are body rates, else the yaw rate \[rad/s\].
    pub yaw: f64,
    /// Thrust, along z: `delta_c`, a fraction of maximum thrust \[-, 0..1\].
    pub thrust: f64,
}

/// Sign of each of the vehicle's axes against the body axes: 1, or -1 if opposite \[-\].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct AxisSigns {
    /// Roll, about x \[-\].
    pub roll: i8,
    /// Pitch, about y \[-\].
    pub pitch: i8,
    /// Yaw, about z \[-\].
    pub yaw: i8,
}

impl Default for AxisSigns {
    fn default() -> Self {
        Self { roll: -1, pitch: 1, yaw: -1 }
    }
}

/// Greatest counts sent on each axis; asctec_drivers has roll and pitch 300, yaw 600, thrust 2200.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct CountLimits {
    /// Roll, magnitude \[counts\].
    pub roll: i16,
    /// Pitch, magnitude \[counts\].
    pub pitch: i16,
    /// Yaw, magnitude \[counts\].
    pub yaw: i16,
    /// Thrust \[counts\].
    pub thrust: i16,
}

impl Default for CountLimits {
    fn default() -> Self {
        Self { roll: FULL_STICK, pitch: FULL_STICK, yaw: FULL_STICK, thrust: FULL_THRUST }
    }
}

/// Scales of counts; both ends of a link need the same.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Scales {
    /// Quantity that the sticks command.
    pub sticks: StickMeaning,
    /// Roll and pitch angle of one count, AscTec's `K_stick` \[mdeg\]; for sticks that command an attitude.
    pub angle_per_count_mdeg: f64,
    /// Yaw rate of one count, AscTec's `K_stick_yaw` \[mdeg/s\]; for sticks that command an attitude.
    pub yaw_rate_per_count_mdeg_s: f64,
    /// Signs of commands.
    pub command_signs: AxisSigns,
    /// Signs of telemetry.
    pub telemetry_signs: AxisSigns,
    /// Greatest counts of commands.
    pub limit_counts: CountLimits,
    /// Calibration points `[delta_c, counts]` \[-, counts\].
    pub thrust_table: ThrustTable,
    /// Yaw stick that, held without thrust, starts and stops the motors \[counts\]; asctec_drivers has -2047,
    /// asctec_mav_framework 2047.
    pub motor_yaw_counts: i16,
}

impl Default for Scales {
    fn default() -> Self {
        Self {
            sticks: StickMeaning::BodyRate,
            angle_per_count_mdeg: 25.0,
            yaw_rate_per_count_mdeg_s: 120.0,
            command_signs: AxisSigns::default(),
            telemetry_signs: AxisSigns::default(),
            limit_counts: CountLimits::default(),
            thrust_table: ThrustTable::default(),
            motor_yaw_counts: -FULL_STICK,
        }
    }
}

/// State of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    /// Battery voltage \[V\].
    pub battery_v: f64,
    /// Whether the motors run.
    pub motors_on: bool,
    /// Whether the vehicle reports that it flies.
    pub flying: bool,
}

impl From<LlStatus> for Status {
    fn from(wire: LlStatus) -> Self {
        let battery_v = f64::from(wire.battery_1_mv) / 1000.0;
        Self { battery_v, motors_on: wire.motors_on != 0, flying: wire.flying != 0 }
    }
}

impl From<Status> for LlStatus {
    fn from(status: Status) -> Self {
        Self {
            battery_1_mv: (status.battery_v * 1000.0).round() as i16,
            cpu_load: 1000,
            flying: i8::from(status.flying),
            motors_on: i8::from(status.motors_on),
            ..Self::default()
        }
    }
}

/// Fused inertial measurements of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Imu {
    /// Euler angles 3-2-1 `[roll, pitch, yaw]` \[rad, body to a level frame whose heading is the compass's\].
    pub angles: [f64; 3],
    /// Body rate \[rad/s, body\].
    pub rate: [f64; 3],
    /// Height, fused \[m, up\].
    pub height: f64,
    /// Climb rate, fused \[m/s, up\].
    pub climb: f64,
}

impl Scales {
    /// Checks the scales.
    ///
    /// # Errors
    /// The first scale that breaks a rule.
    pub fn check(&self) -> Result<(), InvalidScale> {
        let per_count = 0.1..=1000.0;
        let plausible = |key, value: f64| match per_count.contains(&value) {
            true => Ok(()),
            false => Err(InvalidScale::new(key, "must lie between 0.1 and 1000")),
        };
        plausible("angle-per-count-mdeg", self.angle_per_count_mdeg)?;
        plausible("yaw-rate-per-count-mdeg-s", self.yaw_rate_per_count_mdeg_s)?;
        self.command_signs.check("command-signs")?;
        self.telemetry_signs.check("telemetry-signs")?;
        self.limit_counts.check()?;
        self.thrust_table.check()?;
        if (-FULL_STICK..=FULL_STICK).contains(&self.motor_yaw_counts) && self.motor_yaw_counts != 0
        {
            Ok(())
        } else {
            Err(InvalidScale::new("motor-yaw-counts", "must lie in -2047..2047 and not be 0"))
        }
    }

    /// Converts `sticks` to counts within the limits; the zero set-point if a value is not finite. Never a motor switch: without thrust
    /// the yaw stick stays within half of [`Scales::motor_yaw_counts`].
    pub fn encode(&self, sticks: &Sticks) -> ControlInput {
        let Sticks { roll, pitch, yaw, thrust } = *sticks;
        if ![roll, pitch, yaw, thrust].iter().all(|value| value.is_finite()) {
            return ControlInput::ZERO_SETPOINT;
        }
        let (signs, limits) = (&self.command_signs, &self.limit_counts);
        let (angle, rate) = (self.counts_per_angle(), self.counts_per_yaw());
        let thrust = stick(self.thrust_table.counts(thrust), limits.thrust).max(0);
        let half_switch = (self.motor_yaw_counts / 2).abs();
        let most_yaw = if thrust == 0 { limits.yaw.min(half_switch) } else { limits.yaw };
        ControlInput {
            roll: stick(f64::from(signs.roll) * roll * angle, limits.roll),
            pitch: stick(f64::from(signs.pitch) * pitch * angle, limits.pitch),
            yaw: stick(f64::from(signs.yaw) * yaw * rate, most_yaw),
            thrust,
            enabled: ControlInput::ENABLE_ALL,
        }
    }

    /// Converts counts to sticks; limited counts give the limited sticks.
    pub fn decode(&self, input: &ControlInput) -> Sticks {
        let (signs, angle) = (&self.command_signs, self.counts_per_angle());
        Sticks {
            roll: f64::from(signs.roll) * f64::from(input.roll) / angle,
            pitch: f64::from(signs.pitch) * f64::from(input.pitch) / angle,
            yaw: f64::from(signs.yaw) * f64::from(input.yaw) / self.counts_per_yaw(),
            thrust: self.thrust_table.delta(f64::from(input.thrust)),
        }
    }

    /// Control input that, held, starts or stops the motors: no thrust and full yaw. Roll and pitch stay with the remote control, as in
    /// asctec_drivers.
    pub fn motor_switch(&self) -> ControlInput {
        ControlInput {
            yaw: self.motor_yaw_counts,
            enabled: ControlInput::ENABLE_YAW | ControlInput::ENABLE_THRUST,
            ..ControlInput::ZERO_SETPOINT
        }
    }

    /// Whether `input` is a motor switch: no thrust, and the yaw stick at least at the switch position on its side.
    pub fn is_motor_switch(&self, input: &ControlInput) -> bool {
        let yaw = i32::from(input.yaw);
        let switch = i32::from(self.motor_yaw_counts);
        input.thrust == 0 && yaw.signum() == switch.signum() && yaw.abs() >= switch.abs()
    }

    /// Converts measurements on the wire to body axes.
    pub fn decode_imu(&self, wire: &ImuCalc) -> Imu {
        let signs = self.telemetry_signs.as_array();
        let angles = [wire.angle_roll, wire.angle_nick, wire.angle_yaw];
        let rates = [wire.rate_roll, wire.rate_nick, wire.rate_yaw];
        let signed = |axis: usize, counts: i32| signs[axis] * f64::from(counts);
        Imu {
            angles: [0, 1, 2].map(|axis| (signed(axis, angles[axis]) / 1000.0).to_radians()),
            rate: [0, 1, 2]
                .map(|axis| (signed(axis, rates[axis]) / RATE_COUNTS_PER_DEG_S).to_radians()),
            height: f64::from(wire.height) / 1000.0,
            climb: f64::from(wire.climb) / 1000.0,
        }
    }

    /// The inertial measurements as the vehicle sends them; what [`Imu`] does not hold is zero.
    pub fn encode_imu(&self, imu: &Imu) -> ImuCalc {
        let signs = self.telemetry_signs.as_array();
        let angle = |axis: usize| signs[axis] * imu.angles[axis].to_degrees() * 1000.0;
        let rate = |axis: usize| {
            (signs[axis] * imu.rate[axis].to_degrees() * RATE_COUNTS_PER_DEG_S).round() as i32
        };
        ImuCalc {
            angle_roll: angle(0).round() as i32,
            angle_nick: angle(1).round() as i32,
            angle_yaw: angle(2).round().rem_euclid(360_000.0) as i32,
            rate_roll: rate(0),
            rate_nick: rate(1),
            rate_yaw: rate(2),
            height: (imu.height * 1000.0).round() as i32,
            climb: (imu.climb * 1000.0).round() as i32,
            ..ImuCalc::default()
        }
    }

    /// Counts per unit of [`Sticks::roll`] and [`Sticks::pitch`].
    fn counts_per_angle(&self) -> f64 {
        match self.sticks {
            StickMeaning::BodyRate => f64::from(FULL_STICK),
            StickMeaning::Attitude => 1000.0_f64.to_degrees() / self.angle_per_count_mdeg,
        }
    }

    /// Counts per unit of [`Sticks::yaw`].
    fn counts_per_yaw(&self) -> f64 {
        match self.sticks {
            StickMeaning::BodyRate => f64::from(FULL_STICK),
            StickMeaning::Attitude => 1000.0_f64.to_degrees() / self.yaw_rate_per_count_mdeg_s,
        }
    }
}

impl AxisSigns {
    fn check(&self, key: &'static str) -> Result<(), InvalidScale> {
        if [self.roll, self.pitch, self.yaw].iter().all(|sign| [1, -1].contains(sign)) {
            Ok(())
        } else {
            Err(InvalidScale::new(key, "must be 1 or -1 each"))
        }
    }

    fn as_array(&self) -> [f64; 3] {
        [self.roll, self.pitch, self.yaw].map(f64::from)
    }
}

impl CountLimits {
    fn check(&self) -> Result<(), InvalidScale> {
        let sticks = [self.roll, self.pitch, self.yaw];
        let fits = sticks.iter().all(|limit| (1..=FULL_STICK).contains(limit))
            && (1..=FULL_THRUST).contains(&self.thrust);
        if fits {
            Ok(())
        } else {
            let rule = "must lie in 1..2047 for roll, pitch and yaw, in 1..4095 for thrust";
            Err(InvalidScale::new("limit-counts", rule))
        }
    }
}

/// Rounds to counts within `limit` in magnitude.
fn stick(counts: f64, limit: i16) -> i16 {
    let limit = f64::from(limit);
    counts.round().min(limit).max(-limit) as i16
}
