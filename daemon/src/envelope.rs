//! The envelope of a command: the motion to which it leads, predicted with the vehicle's model, against limits from which the
//! fallback law recovers.
//!
//! A command that is sent now acts until the next one does, or the one after it if that one is lost: it is held for two periods.
//! Then the prediction turns the vehicle level, as the fallback law would, until the horizon, and on until it is level: a tilted
//! vehicle gains speed. In all that time tilt, rate, speed and heading must be within their limits, and from every point the vehicle
//! must come to rest inside the fence and above the floor: after the time in which it turns to the tilt that brakes, with part of
//! the acceleration that the position loops command. This is a test of one step: the state after it is one from which the
//! fallback recovers, so that the next tick may still refuse the law (L. Sha, *Using simplicity to control complexity*, IEEE
//! Software 18, 2001). Holding the command for the whole horizon instead would refuse every law that turns at full stick.

use nalgebra::Vector3;
use oqtal_bus::code::HandoverCause;
use oqtal_config::{Config, Interface};
use oqtal_control::controller::ControllerName;
use oqtal_control::euler::{EulerAngles, shorter_turn};
use oqtal_control::options::OptionError;
use oqtal_control::predictive::{
    Bias, Integration, ModelInput, Motion, MotionTracker, Rotation, VehicleModel,
};
use oqtal_control::quaternion::Attitude;
use oqtal_control::trajectory::Reference;

use crate::command::VehicleCommand;
use crate::command_model::CommandModel;
use crate::fence::Fence;

/// Time for which a command is held \[periods\].
const HELD_PERIODS: f64 = 2.0;
/// Step of the prediction \[s\].
const STEP_S: f64 = 0.02;
/// Lag of the rate in the prediction over that of the model \[-\]: at the end of their range the rotors turn the vehicle up to 0.1 s
/// later than the lag that the rate loop has for small commands, and a command that leads out of the envelope is mostly a full one.
const LAG_FACTOR: f64 = 2.0;
/// Gain of the levelling from the angle to the rate \[1/s\]: half of that of the laws.
const LEVEL_GAIN: f64 = 4.0;
/// Share of the available acceleration that is assumed for braking \[-\]. Less than 1 because the fallback law also returns to the
/// reference, and because a tilted or rotating vehicle must turn first.
const BRAKING_SHARE: f64 = 0.3;
/// Time after which the fallback law turns the vehicle to brake \[s\].
const REACTION_S: f64 = 0.1;
/// Cosine of the tilt below which a vehicle counts as level \[-\]: that of 10 degrees.
const LEVEL_COSINE: f64 = 0.985;
/// Longest prediction \[s\].
const LONGEST_S: f64 = 1.0;
/// Greatest turn from the reference \[rad\]: laws that turn about one axis to the reference lose the tilt over larger ones.
const GREATEST_TURN_RAD: f64 = std::f64::consts::FRAC_PI_3;
/// Least cosine of the tilt by which the thrust of a hover is divided \[-\].
const LEAST_COSINE: f64 = 0.5;

/// The envelope of `[envelope]`, for the vehicle of a configuration.
#[derive(Clone, Debug)]
pub struct Envelope {
    commands: CommandModel,
    fence: Fence,
    held_s: f64,
    horizon_s: f64,
    tilt_cosine: f64,
    rate: f64,
    speed: f64,
    margin_m: f64,
    /// Decelerations of the stop \[m/s^2\]: horizontal, of a climb, of a descent.
    braking: [f64; 3],
    /// Time until the vehicle brakes \[s\]: horizontally, vertically.
    reaction_s: [f64; 2],
    greatest_thrust_n: f64,
    /// Least lag of the rate while the fallback turns the vehicle level \[s\].
    recovery_lag_s: f64,
    /// Greatest demand about each axis \[rad/s or rad/s^2, body axes\].
    greatest_demand: Vector3<f64>,
}

/// A command about to be sent, and the motion at its effect.
#[derive(Clone, Copy, Debug)]
pub struct Candidate<'a> {
    /// The command.
    pub command: &'a VehicleCommand,
    /// The motion predicted for its effect.
    pub ahead: &'a Motion,
    /// The model and the bias of the prediction.
    pub tracker: &'a MotionTracker,
    /// Heading of the reference \[rad\].
    pub heading_rad: f64,
}

impl Envelope {
    /// The envelope of `config`.
    ///
    /// # Errors
    /// The vehicle has no model.
    pub fn new(config: &Config) -> Result<Self, OptionError> {
        let (vehicle, position, limits) = (&config.vehicle, &config.position, &config.envelope);
        let commands = CommandModel::new(config)?;
        let lift = vehicle.max_thrust_n / vehicle.mass_kg - vehicle.gravity_m_s2;
        let climb = position.vertical_acceleration_limit_m_s2;
        let sideways = vehicle.gravity_m_s2 * position.tilt_limit_deg.to_radians().tan();
        let [roll, pitch, _] = vehicle.rate_authority_rad_s;
        let turn_s = position.tilt_limit_deg.to_radians() / roll.min(pitch);
        let greatest_demand = match &commands.model.rotation {
            Rotation::RigidBody { inertia } => {
                (inertia.inverse() * Vector3::repeat(vehicle.max_torque_nm)).abs()
            }
            _ => vehicle.rate_authority_rad_s.into(),
        };
        Ok(Self {
            fence: Fence::new(&config.fence),
            held_s: HELD_PERIODS / config.control.rate_hz,
            horizon_s: limits.horizon_ms * 1e-3,
            tilt_cosine: limits.tilt_deg.to_radians().cos(),
            rate: limits.rate_rad_s,
            speed: limits.speed_m_s,
            margin_m: limits.fence_margin_m,
            braking: [sideways, climb, climb.min(lift)].map(|most| BRAKING_SHARE * most),
            reaction_s: [
                REACTION_S + turn_s + vehicle.rate_lag_ms * 1e-3,
                REACTION_S + vehicle.thrust_lag_ms * 1e-3,
            ],
            greatest_thrust_n: vehicle.max_thrust_n,
            recovery_lag_s: recovery_lag_s(config),
            greatest_demand,
            commands,
        })
    }

    /// Why `candidate` leads out of the envelope; [`HandoverCause::None`] if it does not.
    pub fn check(&self, candidate: &Candidate) -> HandoverCause {
        let Candidate { command, ahead, tracker, heading_rad } = *candidate;
        let [held_model, model] = [0.0, self.recovery_lag_s].map(|least_s| {
            let rotation = slowed(&tracker.model().rotation, least_s);
            VehicleModel { rotation, integration: Integration::Coarse, ..*tracker.model() }
        });
        let (bias, gain, floor_m) = (tracker.bias(), tracker.effect().gain, tracker.floor_m());
        let mut held = self.commands.input(command);
        held.demand = held.demand.component_mul(&gain);
        let (mut motion, mut t_s) = (*ahead, 0.0);
        loop {
            let upright = motion.attitude.to_world(&Vector3::z()).z;
            let cause = self.outside(&motion, (floor_m, heading_rad));
            let is_over = t_s >= self.horizon_s && upright >= LEVEL_COSINE || t_s >= LONGEST_S;
            if cause != HandoverCause::None || is_over {
                return cause;
            }
            let (model, input, end_s) = if t_s < self.held_s {
                (&held_model, held, (t_s + STEP_S).min(self.held_s))
            } else {
                (&model, self.level(&motion, &model, &bias), t_s + STEP_S)
            };
            motion = model.advance(&motion, &input, &bias, end_s - t_s);
            t_s = end_s;
        }
    }

    /// The limit that `motion` exceeds. Comparisons with NaN are false: a motion that is not finite is outside.
    fn outside(&self, motion: &Motion, (floor_m, heading_rad): (f64, f64)) -> HandoverCause {
        let upright = motion.attitude.to_world(&Vector3::z()).z;
        let yaw = EulerAngles::from_attitude(&motion.attitude).yaw;
        let turn = shorter_turn(yaw - heading_rad).abs();
        let rest = self.rest(motion);
        let is_within = |value: f64, limit: f64| value <= limit;
        let limits = [
            (HandoverCause::Tilt, is_within(self.tilt_cosine, upright)),
            (HandoverCause::Rate, is_within(motion.rate.amax(), self.rate)),
            (HandoverCause::Speed, is_within(motion.velocity.norm(), self.speed)),
            (HandoverCause::Fence, is_within(self.margin_m, self.fence.inside_m(&rest))),
            (HandoverCause::Floor, is_within(self.margin_m, rest.z - floor_m)),
            (HandoverCause::Heading, is_within(turn, GREATEST_TURN_RAD)),
        ];
        let exceeded = limits.into_iter().find(|(_, is_kept)| !is_kept);
        exceeded.map_or(HandoverCause::None, |(cause, _)| cause)
    }

    /// Where a vehicle that moves as `reference` would come to rest, if it brakes after the horizon: distance inside the fence and height in
    /// the world \[m\].
    pub(crate) fn stop_of(&self, reference: &Reference) -> [f64; 2] {
        let Reference { position, velocity, .. } = *reference;
        let position = position + velocity * self.horizon_s;
        let rest = self.rest(&Motion { position, velocity, ..Motion::default() });
        [self.fence.inside_m(&rest), rest.z]
    }

    /// Point at which the vehicle comes to rest from `motion` \[m, world\].
    fn rest(&self, motion: &Motion) -> Vector3<f64> {
        let [sideways, climb, descent] = self.braking;
        let (velocity, horizontal) = (motion.velocity, motion.velocity.xy().norm());
        let vertical = if velocity.z > 0.0 { climb } else { descent };
        let [turn_s, lift_s] = self.reaction_s;
        let h_s = turn_s + horizontal / (2.0 * sideways);
        let v_s = lift_s + velocity.z.abs() / (2.0 * vertical);
        motion.position + velocity.component_mul(&Vector3::new(h_s, h_s, v_s))
    }

    /// The input that turns the vehicle level at its heading and holds its height.
    fn level(&self, motion: &Motion, model: &VehicleModel, bias: &Bias) -> ModelInput {
        let up = motion.attitude.to_body(&Vector3::z());
        let axis = Vector3::z().cross(&up);
        let angle = axis.norm().atan2(up.z);
        let left = axis.try_normalize(f64::EPSILON).map_or(Vector3::zeros(), |axis| axis * angle);
        let rate = left * LEVEL_GAIN - bias.demand;
        let demand = match model.rotation {
            Rotation::RigidBody { .. } => (rate - motion.rate) * (2.0 * LEVEL_GAIN),
            _ => rate,
        };
        let weight_n = model.mass_kg * model.gravity_m_s2;
        let thrust_n = (weight_n / up.z.max(LEAST_COSINE)).min(self.greatest_thrust_n);
        let yaw = EulerAngles::from_attitude(&motion.attitude).yaw;
        ModelInput {
            demand: demand.zip_map(&self.greatest_demand, |demand, most| demand.clamp(-most, most)),
            attitude: Attitude::from_rotation_vector(Vector3::z() * yaw),
            thrust_n,
        }
    }
}

/// Lag of the rate under the fallback of `config` \[s\]; 0 for a law whose commands the vehicle follows with its own lag. INDI is a
/// rate loop around that of the vehicle, and may be slower.
fn recovery_lag_s(config: &Config) -> f64 {
    let control = config.control.of_fallback().unwrap_or(config.control);
    match (config.vehicle.interface, control.built_in()) {
        (Interface::Rate, ControllerName::Indi) => 1.0 / control.indi.rate_gain_per_s,
        _ => 0.0,
    }
}

/// `rotation` with [`LAG_FACTOR`] times the lag of the rate, at least `least_s` \[s\].
fn slowed(rotation: &Rotation, least_s: f64) -> Rotation {
    let mut slowed = *rotation;
    if let Rotation::RateLoop { lag_s } | Rotation::AttitudeLoop { lag_s, .. } = &mut slowed {
        *lag_s = (*lag_s * LAG_FACTOR).max(least_s);
    }
    slowed
}
